//! Where a map is too coarse to be believed: around the point's own texel, before any occluder is looked at.
//!
//! A texel far from the point errs by a part of itself on a light that covers many. Near the point a single
//! texel covers the whole light, so that a gap between paving stones, an edge or a leaf decides between light
//! and shadow by where texel middles happen to fall. Such points are left to rays.

use super::light::{Seen, dot};
use super::prepare::PreparedMap;
use super::region::unit;

/// Distance of a texel's middle from the tangent plane, in texels, up to which it is the point's own surface.
const OWN: f32 = 0.5;
/// Distance above the tangent plane, in texels, from which an occluder is large enough to be believed.
const CONTACT: f32 = 16.0;
/// Distance above the tangent plane, in texels, from which a texel shades the place beneath it. Lower ones are the steps
/// of a bent surface.
const SHADES: f32 = 0.15;
/// Texels that the light covers, seen past an occluder, from which that one's edge is a penumbra to the map: two by two.
const HARD: usize = 4;

/// What the 3 x 3 texels around a point know.
pub struct Around {
    /// Some do not know the point's surface (it bends, ends, or lies under more layers than are kept), or know an occluder
    /// almost in contact with it.
    pub near_contact: bool,
    /// Some are shaded and some are not, past an occluder so close that two texels cover the light: by as much as the
    /// edge is off in the map, a point is wholly lit or wholly dark.
    pub at_hard_edge: bool,
}

impl Around {
    pub fn of(map: &PreparedMap, seen: &Seen) -> Around {
        let level = &map.levels[0];
        let [texel_x, texel_y] = map.texel_size(0);
        let u = (seen.window_x - map.view.window[0]) / texel_x;
        let v = (seen.window_y - map.view.window[2]) / texel_y;
        let (column, row) = (u.floor(), v.floor());
        let inside = column >= 1.0
            && row >= 1.0
            && column + 2.0 <= level.width as f64
            && row + 2.0 <= level.height as f64;
        if !inside {
            // Also where u or v is not a number.
            return Around {
                near_contact: true,
                at_hard_edge: false,
            };
        }
        let (column, row) = (column as usize, row as usize);
        let texel = texel_x.max(texel_y) as f32;
        let [normal_x, normal_y, _] = seen.geometric_normal;
        let along = dot(seen.geometric_normal, seen.base);
        let (mut near_contact, mut shaded, mut nearest) = (false, 0, f32::INFINITY);
        for y in row - 1..=row + 1 {
            for x in column - 1..=column + 1 {
                let across_x = ((x as f64 + 0.5 - u) * texel_x) as f32;
                let across_y = ((y as f64 + 0.5 - v) * texel_y) as f32;
                let across = normal_x * across_x + normal_y * across_y;
                let (mut own, mut shades) = (false, false);
                let rises = level.rise[level.index(0, y, x)..]
                    .iter()
                    .step_by(level.layer_stride());
                for rise in rises {
                    let above = rise - seen.rise;
                    // Of the texel's surface, times its rise: then a texel is `texel` long.
                    let height = across - above * along;
                    own |= height.abs() <= OWN * texel;
                    near_contact |= height > OWN * texel && height <= CONTACT * texel;
                    if height > SHADES * texel && above > seen.rounding {
                        shades = true;
                        nearest = nearest.min(above);
                    }
                }
                near_contact |= !own;
                shaded += shades as u32;
            }
        }
        Around {
            near_contact,
            at_hard_edge: (1..9).contains(&shaded) && nearest < unit(seen, HARD, map),
        }
    }
}
