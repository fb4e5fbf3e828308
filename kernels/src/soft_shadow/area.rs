//! The thesis's own method: clamped areas of backprojected texels, summed (section 5.3.5 and its listing).

use super::light::Seen;
use super::prepare::{EMPTY, PreparedMap, unpack_tilt};
use super::region::Region;

/// 1 - the sum over texels of the area that the farthest occluding layer covers; overlaps count twice.
/// The last stored depth only serves as the next one of the layer before it.
pub fn visibility(map: &PreparedMap, seen: &Seen, region: &Region) -> f32 {
    let level = &map.levels[region.level];
    let [texel_x, texel_y] = map.texel_size(region.level);
    let [u, v] = map.place(seen, region.level);
    let [left, right, bottom, top] = seen.bounds;
    let share_x = texel_x as f32 / (right - left);
    let share_y = texel_y as f32 / (top - bottom);
    let (start_x, start_y) = (left / (right - left), bottom / (top - bottom));
    let mut hidden = 0.0;
    for row in region.y0..region.y1 {
        for column in region.x0..region.x1 {
            for layer in (0..map.layers - 1).rev() {
                let texel = level.index(layer, row as usize, column as usize);
                let rise = level.rise[texel];
                let next = level.rise[texel + level.layer_stride()];
                let above = rise - seen.rise;
                let gradient = map.gradient_bias(rise, unpack_tilt(level.tilt[texel]));
                if above <= gradient.max(rise - midpoint(map.view.orthographic, rise, next)) {
                    continue;
                }
                let covered = |offset: f32, share: f32, start: f32| {
                    let from = (offset / above * share - start).clamp(0.0, 1.0);
                    let to = ((offset + 1.0) / above * share - start).clamp(0.0, 1.0);
                    to - from
                };
                let across = covered(column as f32 - u, share_x, start_x);
                let area = across * covered(row as f32 - v, share_y, start_y);
                if area > 0.0 {
                    hidden += area;
                    break;
                }
            }
        }
    }
    (1.0 - hidden).max(0.0)
}

/// Rise half way in depth between two surfaces; that of the first where nothing is behind it.
fn midpoint(orthographic: bool, rise: f32, next: f32) -> f32 {
    if next == EMPTY {
        rise
    } else if orthographic {
        0.5 * (rise + next)
    } else {
        2.0 * rise * next / (rise + next)
    }
}
