//! What the points of a tile have in common: which blocks of a map may matter to any of them.

use super::level::{BLOCK, Block};
use super::light::{Seen, dot};
use super::open::Open;
use super::plain::OWN_SURFACE;
use super::prepare::PreparedMap;
use super::region::Search;
use super::window::Window;

/// Ranges over a tile's points.
pub struct Spread {
    /// Least and greatest window x and y, relative to the origin.
    pub x: [f64; 2],
    pub y: [f64; 2],
    pub rise: [f32; 2],
    pub unit: [f32; 2],
    /// Left, right, bottom, top that hold every point's light.
    pub bounds: [f32; 4],
    /// All points lie in the first one's tangent plane.
    pub one_plane: bool,
}

impl Spread {
    pub fn of(points: &[Open], orthographic: bool) -> Spread {
        let first = &points[0].seen;
        // An orthographic view's `base` is the same for all points.
        let place = |seen: &Seen| match orthographic {
            true => [seen.window_x as f32, seen.window_y as f32, -seen.rise],
            false => seen.base,
        };
        let tangent = |seen: &Seen| dot(seen.geometric_normal, place(seen));
        let (offset, size) = (tangent(first), dot(place(first), place(first)).sqrt());
        let mut spread = Spread {
            x: [first.window_x; 2],
            y: [first.window_y; 2],
            rise: [first.rise; 2],
            unit: [points[0].unit; 2],
            bounds: first.bounds,
            one_plane: true,
        };
        for point in points {
            let seen = &point.seen;
            let grow = |range: &mut [f64; 2], value: f64| *range = [range[0].min(value), range[1].max(value)];
            grow(&mut spread.x, seen.window_x);
            grow(&mut spread.y, seen.window_y);
            spread.rise = [spread.rise[0].min(seen.rise), spread.rise[1].max(seen.rise)];
            spread.unit = [spread.unit[0].min(point.unit), spread.unit[1].max(point.unit)];
            let [left, right, bottom, top] = spread.bounds;
            spread.bounds = [
                left.min(seen.bounds[0]),
                right.max(seen.bounds[1]),
                bottom.min(seen.bounds[2]),
                top.max(seen.bounds[3]),
            ];
            let turned = (0..3).any(|i| (seen.geometric_normal[i] - first.geometric_normal[i]).abs() > 1e-6);
            spread.one_plane &= !turned && (tangent(seen) - offset).abs() <= 4e-6 * size;
        }
        spread
    }

    /// Whether the light's rays up to `above` the points cross no texel that reaches out of the inner window, which is
    /// relative to the origin.
    pub fn is_within(&self, inner: Window<f32>, above: f32, texel: [f64; 2]) -> bool {
        let [left, right, bottom, top] = self.bounds.map(|side| side * above);
        let [width, height] = [self.x, self.y].map(|[from, to]| (to - from) as f32);
        // A hundredth of a texel for rounding, as in `Seam`.
        let [texel_x, texel_y] = texel.map(|size| 1.01 * size as f32);
        left - texel_x > inner[0]
            && width + right + texel_x < inner[1]
            && bottom - texel_y > inner[2]
            && height + top + texel_y < inner[3]
    }
}

/// Largest rise of what may hide the light from any of the points: `Search::new` for many.
pub fn highest_above(map: &PreparedMap, spread: &Spread, refinements: usize) -> Option<f32> {
    let mut nearest = map.nearest();
    let mut highest = nearest[0];
    for round in 0.. {
        if nearest[1] <= spread.rise[0] {
            return None;
        }
        highest = highest.min(nearest[0]);
        if round == refinements {
            break;
        }
        let region = texels_around(map, spread, highest - spread.rise[0], 0)?;
        nearest = Search::nearest_in(map, region.map(|side| side as i32));
    }
    Some(highest)
}

/// Columns and rows (first, end) of texels that the light's rays to any of the points may cross.
fn texels_around(map: &PreparedMap, spread: &Spread, above: f32, level: usize) -> Option<[usize; 4]> {
    let size = &map.levels[level];
    let [texel_x, texel_y] = map.texel_size(level);
    let [left, right, bottom, top] = spread.bounds.map(|side| f64::from(side * above));
    let cut = |from: f64, to: f64, start: f64, texel: f64, count: usize| {
        let limit = |place: f64| place.clamp(0.0, count as f64) as usize;
        (
            limit(((from - start) / texel).floor()),
            limit(((to - start) / texel).floor() + 1.0),
        )
    };
    let window = &map.view.window;
    let (x0, x1) = cut(
        spread.x[0] + left,
        spread.x[1] + right,
        window[0],
        texel_x,
        size.width,
    );
    let (y0, y1) = cut(
        spread.y[0] + bottom,
        spread.y[1] + top,
        window[2],
        texel_y,
        size.height,
    );
    (x0 < x1 && y0 < y1).then_some([x0, x1, y0, y1])
}

pub fn blocks_around(map: &PreparedMap, spread: &Spread, above: f32, level: usize) -> Option<[usize; 4]> {
    let [x0, x1, y0, y1] = texels_around(map, spread, above, level)?;
    Some([x0 / BLOCK, x1.div_ceil(BLOCK), y0 / BLOCK, y1.div_ceil(BLOCK)])
}

/// The tangent plane that all points of a tile lie in: on flat ground it leaves out the ground itself.
pub struct OwnPlane {
    /// Height of (x, y, above) over the plane, up to a factor: the three products' sum.
    slope: [f32; 3],
}

impl OwnPlane {
    pub fn of(seen: &Seen) -> OwnPlane {
        let [x, y, _] = seen.geometric_normal;
        let along = -dot(seen.geometric_normal, seen.base);
        OwnPlane { slope: [x, y, along] }
    }

    /// Whether all texels of the block are in the plane or below it, so that all they hide is below the
    /// horizon. Allows for rounding, within what `plain::clears_own_surface` allows.
    pub fn covers(
        &self,
        seen: &Seen,
        block: &Block,
        origin: [f64; 2],
        sides: [f32; 4],
        size: [f64; 2],
    ) -> bool {
        let [slope_x, slope_y, slope_above] = self.slope;
        if slope_above <= 0.0 {
            return false;
        }
        let x = 0.5 * (sides[0] + sides[1]) - (seen.window_x - origin[0]) as f32;
        let y = 0.5 * (sides[2] + sides[3]) - (seen.window_y - origin[1]) as f32;
        let terms = [
            slope_x * x,
            slope_y * y,
            slope_above * (block.cover[0] - seen.rise),
        ];
        let reach = 0.5 * (BLOCK - 1) as f32;
        let change_x = slope_x * size[0] as f32 + slope_above * block.cover[1];
        let change_y = slope_y * size[1] as f32 + slope_above * block.cover[2];
        let most = terms[0] + terms[1] + terms[2] + reach * (change_x.abs() + change_y.abs());
        most <= 0.1 * OWN_SURFACE * (terms[0].abs() + terms[1].abs() + terms[2].abs())
    }
}

/// How a block lies to the inner window.
#[derive(PartialEq)]
pub enum Seam {
    Outside,
    Across,
    Within,
}

impl Seam {
    /// Within a hundredth of a texel all is across: each texel is asked again, from the point.
    pub fn of(sides: [f32; 4], inner: Window<f32>, texel: [f64; 2]) -> Seam {
        let slack = texel.map(|size| 0.01 * size as f32);
        let (mut within, mut outside) = (true, false);
        for axis in 0..2 {
            let (from, to) = (
                sides[2 * axis] - inner[2 * axis],
                sides[2 * axis + 1] - inner[2 * axis + 1],
            );
            within &= from > slack[axis] && to < -slack[axis];
            let (beyond, before) = (
                sides[2 * axis] - inner[2 * axis + 1],
                sides[2 * axis + 1] - inner[2 * axis],
            );
            outside |= beyond > slack[axis] || before < -slack[axis];
        }
        match (within, outside) {
            (true, _) => Seam::Within,
            (_, true) => Seam::Outside,
            _ => Seam::Across,
        }
    }
}
