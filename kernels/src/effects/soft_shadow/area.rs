//! The thesis's own method: clamped areas of backprojected texels, summed (section 5.3.5 and its listing).

use super::choose::Served;
use super::level::{EMPTY, unpack_tilt};
use super::light::Seen;
use super::plain::clears_own_surface;
use super::region::Region;
use super::window::from_point;

/// The sum over texels of the share of the light that the farthest occluding layer covers; overlaps count twice.
/// The last stored depth only serves as the next one of the layer before it. What of a texel lies in the window
/// of a smaller map is left to that one.
pub fn hidden(served: &Served, seen: &Seen, region: &Region) -> f32 {
    let map = served.map;
    let level = &map.levels[region.level];
    let [texel_x, texel_y] = map.texel_size(region.level);
    let [u, v] = map.place(seen, region.level);
    let [left, right, bottom, top] = seen.bounds;
    let share_x = texel_x as f32 / (right - left);
    let share_y = texel_y as f32 / (top - bottom);
    let (start_x, start_y) = (left / (right - left), bottom / (top - bottom));
    let inner = from_point(&served.inner, [seen.window_x, seen.window_y]);
    let inner_x = [inner[0] / texel_x as f32, inner[1] / texel_x as f32];
    let inner_y = [inner[2] / texel_y as f32, inner[3] / texel_y as f32];
    let mut hidden = 0.0;
    for row in region.y0..region.y1 {
        for column in region.x0..region.x1 {
            let (du, dv) = (column as f32 - u, row as f32 - v);
            for layer in (0..map.layers - 1).rev() {
                let texel = level.index(layer, row as usize, column as usize);
                let rise = level.rise[texel];
                let next = level.rise[texel + level.layer_stride()];
                let above = rise - seen.rise;
                let gradient = map.gradient_bias(rise, unpack_tilt(level.tilt[texel]));
                let bias = gradient.max(rise - midpoint(map.view.orthographic, rise, next));
                let middle = [(du + 0.5) * texel_x as f32, (dv + 0.5) * texel_y as f32];
                if above <= bias.max(seen.rounding) || !clears_own_surface(seen, middle[0], middle[1], above)
                {
                    continue;
                }
                let covered = |[from, to]: [f32; 2], share: f32, start: f32| {
                    let edge = |offset: f32| (offset / above * share - start).clamp(0.0, 1.0);
                    edge(to) - edge(from)
                };
                let (x, y) = ([du, du + 1.0], [dv, dv + 1.0]);
                let mut area = covered(x, share_x, start_x) * covered(y, share_y, start_y);
                let (x, y) = (common(x, inner_x), common(y, inner_y));
                if x[0] < x[1] && y[0] < y[1] {
                    area -= covered(x, share_x, start_x) * covered(y, share_y, start_y);
                }
                if area > 0.0 {
                    hidden += area;
                    break;
                }
            }
        }
    }
    hidden
}

/// What two ranges have in common.
fn common(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].max(b[0]), a[1].min(b[1])]
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
