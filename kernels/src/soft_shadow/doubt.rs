//! Where a map is too coarse to be believed: around the point's own texel, before any occluder is looked at.
//!
//! A texel far from the point errs by a part of itself on a light that covers many. Near the point a single
//! texel covers the whole light, so that a gap between paving stones, an edge or a leaf decides between light
//! and shadow by where texel middles happen to fall. Such points are left to rays.

use super::light::{Seen, dot};
use super::prepare::PreparedMap;

/// Distance of a texel's middle from the tangent plane, in texels, up to which it is the point's own surface.
const OWN: f32 = 0.5;
/// Distance above the tangent plane, in texels, from which an occluder is large enough to be believed.
const CONTACT: f32 = 16.0;

/// Whether one of the 3 x 3 texels around the point does not know the point's surface (it bends, ends, or lies
/// under more layers than are kept), or knows an occluder almost in contact with it.
pub fn near_contact(map: &PreparedMap, seen: &Seen) -> bool {
    let level = &map.levels[0];
    let [texel_x, texel_y] = map.texel_size(0);
    let u = (seen.window_x - map.view.window[0]) / texel_x;
    let v = (seen.window_y - map.view.window[2]) / texel_y;
    let (column, row) = (u.floor(), v.floor());
    let inside =
        column >= 1.0 && row >= 1.0 && column + 2.0 <= level.width as f64 && row + 2.0 <= level.height as f64;
    if !inside {
        return true; // also where u or v is not a number
    }
    let (column, row) = (column as usize, row as usize);
    let texel = texel_x.max(texel_y) as f32;
    let [base_x, base_y, base_z] = seen.base;
    for y in row - 1..=row + 1 {
        for x in column - 1..=column + 1 {
            let across_x = ((x as f64 + 0.5 - u) * texel_x) as f32;
            let across_y = ((y as f64 + 0.5 - v) * texel_y) as f32;
            let mut own = false;
            for layer in 0..map.layers {
                let above = level.rise[level.index(layer, y, x)] - seen.rise;
                // From the point to the texel's surface, times its rise: then a texel is `texel` long.
                let offset = [
                    across_x - above * base_x,
                    across_y - above * base_y,
                    -above * base_z,
                ];
                let height = dot(seen.geometric_normal, offset);
                if height.abs() <= OWN * texel {
                    own = true;
                } else if height > 0.0 && height <= CONTACT * texel {
                    return true;
                }
            }
            if !own {
                return true;
            }
        }
    }
    false
}
