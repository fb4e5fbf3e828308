//! The fast bitmask method over neighbouring points, which share the blocks of the map that may hide the light.

use super::fast::{self, Place};
use super::light::{Light, Seen};
use super::plain::{Bits, OWN_SURFACE};
use super::prepare::{BLOCK, Block, PreparedMap};
use super::region::{MOST_LEVELS, Search};
use super::simd::{MOST_LANES, Vector};

/// A point that the light may be hidden from.
pub struct Open {
    pub seen: Seen,
    /// Samples hidden so far.
    pub hidden: Bits,
    /// The rise above the point at which texels of level 0 are as fine as they need be.
    pub unit: f32,
    /// Where the result goes.
    pub place: usize,
}

/// Blocks worth a look, in arrays of their own so that a register of them is tested at once.
#[derive(Default)]
pub struct Candidates {
    highest: Vec<f32>,
    lowest: Vec<f32>,
    /// Left, right, bottom, top in the window, relative to `origin`.
    sides: [Vec<f32>; 4],
    /// The level's band, in units of the point's own.
    from: Vec<f32>,
    to: Vec<f32>,
    /// Level, block, and its first row and column.
    which: Vec<(usize, usize, [usize; 2])>,
    origin: [f64; 2],
}

/// Points of a tile so far apart that they share more blocks than this are taken in halves.
const MOST_SHARED: usize = 768;

/// Adds to `hidden` of every point what the map hides.
#[inline(always)]
pub fn hide<V: Vector>(
    vector: V,
    map: &PreparedMap,
    refinements: usize,
    points: &mut [Open],
    candidates: &mut Candidates,
) {
    // A stack of halves still to do; at most one per halving.
    let mut ranges = [(0, 0); usize::BITS as usize];
    ranges[0] = (0, points.len());
    let mut waiting = 1;
    while waiting > 0 {
        waiting -= 1;
        let (start, end) = ranges[waiting];
        let points = &mut points[start..end];
        if points.is_empty() {
            continue;
        }
        if !candidates.gather(map, refinements, points) {
            let middle = (start + end) / 2;
            ranges[waiting] = (start, middle);
            ranges[waiting + 1] = (middle, end);
            waiting += 2;
            continue;
        }
        if !candidates.which.is_empty() {
            for point in points {
                candidates.hide(vector, map, point);
            }
        }
    }
}

/// Ranges over a tile's points.
struct Spread {
    /// Least and greatest window x and y, relative to the origin.
    x: [f64; 2],
    y: [f64; 2],
    rise: [f32; 2],
    unit: [f32; 2],
    /// Left, right, bottom, top that hold every point's light.
    bounds: [f32; 4],
    /// All points lie in the first one's tangent plane.
    one_plane: bool,
}

impl Spread {
    fn of(points: &[Open]) -> Spread {
        let first = &points[0].seen;
        let tangent = |seen: &Seen| super::light::dot(seen.geometric_normal, seen.base);
        let (offset, size) = (tangent(first), super::light::dot(first.base, first.base).sqrt());
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
}

impl Candidates {
    fn clear(&mut self) {
        self.which.clear();
        let arrays = [&mut self.highest, &mut self.lowest, &mut self.from, &mut self.to];
        for array in arrays.into_iter().chain(&mut self.sides) {
            array.clear();
        }
    }

    /// Collects the blocks that may hide the light from any of the points. False: too many, take fewer points.
    fn gather(&mut self, map: &PreparedMap, refinements: usize, points: &[Open]) -> bool {
        self.clear();
        let spread = Spread::of(points);
        let Some(highest) = highest_above(map, &spread, refinements) else {
            return true;
        };
        self.origin = [spread.x[0], spread.y[0]];
        let own_plane = spread.one_plane.then(|| OwnPlane::of(&points[0].seen));
        let levels = map.levels.len();
        let mut looked_at = 0;
        for level in (0..levels).rev() {
            let (from, to) = band(level, levels);
            let (above_from, above_to) = (from * spread.unit[0], to * spread.unit[1]);
            let above = (highest - spread.rise[0]).min(above_to);
            let Some([x0, x1, y0, y1]) = blocks_around(map, &spread, above, level) else {
                continue;
            };
            looked_at += (x1 - x0) * (y1 - y0) * map.layers;
            if above <= above_from {
                continue;
            }
            if points.len() > 1 && looked_at > 8 * MOST_SHARED {
                return false;
            }
            let size = map.texel_size(level);
            for layer in 0..map.layers {
                for block_row in y0..y1 {
                    for block_column in x0..x1 {
                        let index = map.levels[level].block(layer, block_row, block_column);
                        let block = &map.levels[level].blocks[index];
                        let above = (block.highest - spread.rise[0]).min(above_to);
                        if above <= above_from || block.lowest - spread.rise[1] > above_to {
                            continue;
                        }
                        let first = [block_row * BLOCK, block_column * BLOCK];
                        let sides = self.sides_of(map, first, size);
                        let [left, right, bottom, top] = spread.bounds.map(|side| side * above);
                        let width = (spread.x[1] - spread.x[0]) as f32;
                        let height = (spread.y[1] - spread.y[0]) as f32;
                        if sides[0] - width >= right
                            || sides[1] <= left
                            || sides[2] - height >= top
                            || sides[3] <= bottom
                        {
                            continue;
                        }
                        if let Some(plane) = &own_plane
                            && plane.covers(&points[0].seen, block, self.origin, sides, size)
                        {
                            continue;
                        }
                        self.highest.push(block.highest);
                        self.lowest.push(block.lowest);
                        for (array, side) in self.sides.iter_mut().zip(sides) {
                            array.push(side);
                        }
                        self.from.push(from);
                        self.to.push(to);
                        self.which.push((level, index, first));
                    }
                }
            }
            if points.len() > 1 && self.which.len() > MOST_SHARED {
                return false;
            }
        }
        // Whole registers, of which the rest never passes.
        for _ in 0..MOST_LANES {
            self.highest.push(f32::NEG_INFINITY);
            self.lowest.push(f32::INFINITY);
            self.from.push(0.0);
            self.to.push(0.0);
            for array in &mut self.sides {
                array.push(0.0);
            }
        }
        true
    }

    fn sides_of(&self, map: &PreparedMap, [row, column]: [usize; 2], size: [f64; 2]) -> [f32; 4] {
        let left = map.view.window[0] - self.origin[0];
        let bottom = map.view.window[2] - self.origin[1];
        [
            (left + column as f64 * size[0]) as f32,
            (left + (column + BLOCK) as f64 * size[0]) as f32,
            (bottom + row as f64 * size[1]) as f32,
            (bottom + (row + BLOCK) as f64 * size[1]) as f32,
        ]
    }

    #[inline(always)]
    fn hide<V: Vector>(&self, vector: V, map: &PreparedMap, point: &mut Open) {
        let seen = &point.seen;
        let [left, right, bottom, top] = seen.bounds;
        let x = vector.splat((seen.window_x - self.origin[0]) as f32);
        let y = vector.splat((seen.window_y - self.origin[1]) as f32);
        let mut places = [None; MOST_LEVELS];
        let mut hidden = vector.load_bits(&point.hidden);
        for first in (0..self.which.len()).step_by(V::LANES) {
            let from = vector.mul(vector.load(&self.from[first..]), vector.splat(point.unit));
            let to = vector.mul(vector.load(&self.to[first..]), vector.splat(point.unit));
            let highest = vector.sub(vector.load(&self.highest[first..]), vector.splat(seen.rise));
            let lowest = vector.sub(vector.load(&self.lowest[first..]), vector.splat(seen.rise));
            let above = vector.min(highest, to);
            let mut found = vector.greater(highest, from)
                & !vector.greater(lowest, to)
                & vector.greater(
                    vector.mul(vector.splat(right), above),
                    vector.sub(vector.load(&self.sides[0][first..]), x),
                )
                & vector.greater(
                    vector.sub(vector.load(&self.sides[1][first..]), x),
                    vector.mul(vector.splat(left), above),
                )
                & vector.greater(
                    vector.mul(vector.splat(top), above),
                    vector.sub(vector.load(&self.sides[2][first..]), y),
                )
                & vector.greater(
                    vector.sub(vector.load(&self.sides[3][first..]), y),
                    vector.mul(vector.splat(bottom), above),
                )
                & V::ALL;
            while found != 0 {
                let lane = found.trailing_zeros() as usize;
                found &= found - 1;
                let (level, block, corner) = self.which[first + lane];
                let place = places[level].get_or_insert_with(|| {
                    let (from, to) = band(level, map.levels.len());
                    Place::new(map, seen, level, from * point.unit, to * point.unit)
                });
                hidden = fast::backproject_block(vector, map, seen, place, block, corner, hidden);
            }
            if vector.all_set(hidden) {
                break;
            }
        }
        vector.store_bits(hidden, &mut point.hidden);
    }
}

/// From and to which rise above a point a level answers, in units of the point's own.
pub fn band(level: usize, levels: usize) -> (f32, f32) {
    let start = |level: usize| {
        if level == 0 {
            0.0
        } else {
            0.5 * (1u32 << level) as f32
        }
    };
    let end = if level + 1 == levels {
        f32::INFINITY
    } else {
        start(level + 1)
    };
    (start(level), end)
}

/// Largest rise of what may hide the light from any of the points: `Search::new` for many.
fn highest_above(map: &PreparedMap, spread: &Spread, refinements: usize) -> Option<f32> {
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

fn blocks_around(map: &PreparedMap, spread: &Spread, above: f32, level: usize) -> Option<[usize; 4]> {
    let [x0, x1, y0, y1] = texels_around(map, spread, above, level)?;
    Some([x0 / BLOCK, x1.div_ceil(BLOCK), y0 / BLOCK, y1.div_ceil(BLOCK)])
}

/// The tangent plane that all points of a tile lie in: on flat ground it leaves out the ground itself.
struct OwnPlane {
    /// Height of (x, y, above) over the plane, up to a factor: the three products' sum.
    slope: [f32; 3],
}

impl OwnPlane {
    fn of(seen: &Seen) -> OwnPlane {
        let [x, y, _] = seen.geometric_normal;
        let along = -super::light::dot(seen.geometric_normal, seen.base);
        OwnPlane { slope: [x, y, along] }
    }

    /// Whether all texels of the block are in the plane or below it, so that all they hide is below the
    /// horizon. Allows for rounding, within what `plain::clears_own_surface` allows.
    fn covers(&self, seen: &Seen, block: &Block, origin: [f64; 2], sides: [f32; 4], size: [f64; 2]) -> bool {
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

/// Adds up what is left of the light.
#[inline(always)]
pub fn resolve<V: Vector>(vector: V, light: &Light, point: &Open) -> f32 {
    if point.hidden == Bits::default() {
        return 1.0;
    }
    fast::resolve(vector, light, &point.seen, &point.hidden)
}
