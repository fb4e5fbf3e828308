//! The bitmask method, one texel at a time: the model of the shader and the oracle of `fast.rs`.

use super::choose::Served;
use super::level::unpack_tilt;
use super::light::{Bits, Light, SAMPLE_ROWS, SAMPLES, Seen, dot};
use super::region::Region;
use super::window::from_point;

/// Sine of the elevation, about, below which a texel belongs to the point's own surface.
pub const OWN_SURFACE: f32 = 0.01;

/// Smallest rise above the point that an edge of a tilted texel may come to, as a share of its middle's.
pub const LOWEST_EDGE: f32 = 1e-3;

/// Samples at or below the geometric horizon are hidden.
pub fn horizon(seen: &Seen) -> Bits {
    let mut hidden = Bits::default();
    for i in 0..SAMPLES {
        let (x, y) = seen.sample(i);
        if dot(seen.geometric_normal, seen.direction(x, y)) <= 0.0 {
            hidden[i / 32] |= 1 << (i % 32);
        }
    }
    hidden
}

/// Projects the texels of the region that are nearer to the light than the point back onto the light
/// (thesis eq. 5.3) and hides the samples they cover (Schwarz and Stamminger 2007).
///
/// Two things differ from the print. A texel lies in its surface, not parallel to the light: each of its four
/// edges is projected from its own depth, so that a smooth surface leaves neither gaps nor steps that shade
/// it. And a texel whose middle is not above the point's tangent plane is passed over: all it can hide is
/// below the horizon. Together they make the midpoint bias needless, and every stored layer casts shadow.
/// Texels that lie whole in the window of a smaller map are left to that one.
pub fn backproject(served: &Served, seen: &Seen, region: &Region, hidden: &mut Bits) {
    let map = served.map;
    let inner = from_point(&served.inner, [seen.window_x, seen.window_y]);
    let level = &map.levels[region.level];
    let [texel_x, texel_y] = map.texel_size(region.level);
    let [u, v] = map.place(seen, region.level);
    let (texel_x, texel_y) = (texel_x as f32, texel_y as f32);
    let [left, right, bottom, top] = seen.bounds;
    let samples_x = SAMPLES as f32 / (right - left);
    let samples_y = SAMPLES as f32 / (top - bottom);
    for row in region.y0..region.y1 {
        for column in region.x0..region.x1 {
            for layer in 0..map.layers {
                let texel = level.index(layer, row as usize, column as usize);
                let rise = level.rise[texel];
                let above = rise - seen.rise;
                let tilt = unpack_tilt(level.tilt[texel]);
                if above <= region.above_from
                    || above > region.above_to
                    || above <= map.gradient_bias(rise, tilt).max(seen.rounding)
                {
                    continue;
                }
                let (du, dv) = (column as f32 - u, row as f32 - v);
                if du * texel_x >= inner[0]
                    && (du + 1.0) * texel_x <= inner[1]
                    && dv * texel_y >= inner[2]
                    && (dv + 1.0) * texel_y <= inner[3]
                {
                    continue;
                }
                // Rays from the light to the point pass it by.
                if du * texel_x >= right * above
                    || (du + 1.0) * texel_x <= left * above
                    || dv * texel_y >= top * above
                    || (dv + 1.0) * texel_y <= bottom * above
                {
                    continue;
                }
                if !clears_own_surface(seen, (du + 0.5) * texel_x, (dv + 0.5) * texel_y, above) {
                    continue;
                }
                let edge = |offset: f32, texel: f32, above_edge: f32, start: f32, samples: f32| {
                    let covered = offset * texel / above_edge.max(LOWEST_EDGE * above) - start;
                    (covered * samples).clamp(0.0, SAMPLES as f32).round_ties_even() as u32
                };
                let (half_x, half_y) = (0.5 * tilt[0], 0.5 * tilt[1]);
                let x0 = edge(du, texel_x, above - half_x, left, samples_x);
                let x1 = edge(du + 1.0, texel_x, above + half_x, left, samples_x);
                let y0 = edge(dv, texel_y, above - half_y, bottom, samples_y);
                let y1 = edge(dv + 1.0, texel_y, above + half_y, bottom, samples_y);
                hide(hidden, x0.min(x1), x0.max(x1), y0.min(y1), y0.max(y1));
            }
        }
    }
}

/// Whether the middle of a texel, `x` and `y` from the point in the window, is above the tangent plane.
/// The direction to where it is projected, times `above`, needs no division.
pub fn clears_own_surface(seen: &Seen, x: f32, y: f32, above: f32) -> bool {
    let [base_x, base_y, base_z] = seen.base;
    let direction = [x - above * base_x, y - above * base_y, -above * base_z];
    let length = direction[0].abs() + direction[1].abs() + direction[2].abs();
    dot(seen.geometric_normal, direction) > OWN_SURFACE * length
}

/// Hides samples of columns `x0..x1` and rows `y0..y1`.
fn hide(hidden: &mut Bits, x0: u32, x1: u32, y0: u32, y1: u32) {
    for column in x0..x1 {
        let row = u32::from(SAMPLE_ROWS[column as usize]);
        if y0 <= row && row < y1 {
            hidden[column as usize / 32] |= 1 << (column % 32);
        }
    }
}

/// Share of the irradiance that is not hidden; 1 where there is none.
pub fn resolve(light: &Light, seen: &Seen, hidden: &Bits) -> f32 {
    let (mut open, mut all) = (0.0, 0.0);
    for i in 0..SAMPLES {
        let (x, y) = seen.sample(i);
        let weight = light.weight(seen, x, y);
        all += weight;
        if hidden[i / 32] >> (i % 32) & 1 == 0 {
            open += weight;
        }
    }
    if all > 0.0 { open / all } else { 1.0 }
}
