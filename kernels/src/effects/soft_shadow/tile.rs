//! The fast bitmask method over neighbouring points, which share the blocks of the map that may hide the light.

use super::choose::Served;
use super::fast::{self, Place};
use super::level::BLOCK;
use super::light::{Bits, Light, Seen};
use super::open::Open;
use super::prepare::PreparedMap;
use super::region::{MOST_LEVELS, band, unit};
use super::spread::{OwnPlane, Seam, Spread, blocks_around, highest_above};
use super::window::from_point;
use crate::simd::{Eight, LANES, Simd, Vector};

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
    which: Vec<Which>,
    origin: [f64; 2],
}

/// A block of a map.
struct Which {
    level: usize,
    block: usize,
    /// First row and column.
    corner: [usize; 2],
    /// Some of its texels may lie in the inner window.
    seam: bool,
}

/// Points of a tile.
pub const MOST_POINTS: usize = 64;

/// Points of a tile so far apart that they share more blocks than this are taken in parts.
const MOST_SHARED: usize = 768;

/// The same of blocks that lie between them, for each point: neighbours in the image may be a street apart.
const MOST_APART: usize = 16;

/// Adds to `hidden` of every point what the map hides outside its inner window.
#[inline(always)]
pub fn hide<S: Simd>(
    simd: S,
    served: &Served,
    refinements: usize,
    points: &mut [Open],
    candidates: &mut Candidates,
) {
    // A stack of parts still to do, none of them empty.
    let mut ranges = [(0, 0); MOST_POINTS];
    ranges[0] = (0, points.len());
    let mut waiting = 1;
    while waiting > 0 {
        waiting -= 1;
        let (start, end) = ranges[waiting];
        let points = &mut points[start..end];
        if points.is_empty() {
            continue;
        }
        let spread = Spread::of(points, served.map.view.orthographic);
        if !candidates.gather(served, refinements, &spread, points) {
            let middle = start + parted(points, &spread);
            ranges[waiting] = (start, middle);
            ranges[waiting + 1] = (middle, end);
            waiting += 2;
            continue;
        }
        if !candidates.which.is_empty() {
            for point in points {
                candidates.hide(simd, served, point);
            }
        }
    }
}

/// Whether a sun's rays to any of the points cross nothing of the map but what its inner window holds.
pub fn is_left_to_inner(served: &Served, max_samples: usize, points: &[Open]) -> bool {
    let map = served.map;
    let Some(first) = points.first() else { return true };
    if !map.view.orthographic {
        return false;
    }
    let spread = Spread::of(points, true);
    let inner = from_point(&served.inner, [spread.x[0], spread.y[0]]);
    let unit = unit(&first.seen, max_samples, map);
    let highest = map.nearest()[0] - spread.rise[0];
    let levels = map.levels.len();
    (0..levels).all(|level| {
        let (from, to) = band(level, levels);
        let above = highest.min(to * unit);
        above <= from * unit || spread.is_within(inner, above, map.texel_size(level))
    })
}

/// Brings the points on one side of the middle of where they are, seen from the light, before those on the other,
/// and tells how many those are: neither none nor all.
fn parted(points: &mut [Open], spread: &Spread) -> usize {
    let [wide, high] = [spread.x, spread.y].map(|[from, to]| to - from);
    let along = |seen: &Seen| if wide > high { seen.window_x } else { seen.window_y };
    let [from, to] = if wide > high { spread.x } else { spread.y };
    let middle = 0.5 * (from + to);
    let mut count = 0;
    for at in 0..points.len() {
        if along(&points[at].seen) <= middle {
            points.swap(count, at);
            count += 1;
        }
    }
    if count == 0 || count == points.len() {
        return points.len() / 2;
    }
    count
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
    fn gather(&mut self, served: &Served, refinements: usize, spread: &Spread, points: &[Open]) -> bool {
        self.clear();
        let map = served.map;
        let Some(highest) = highest_above(map, spread, refinements) else {
            return true;
        };
        self.origin = [spread.x[0], spread.y[0]];
        let inner = from_point(&served.inner, self.origin);
        let own_plane = spread.one_plane.then(|| OwnPlane::of(&points[0].seen));
        let levels = map.levels.len();
        let mut around = [[0; 4]; MOST_LEVELS];
        for (level, around) in around.iter_mut().enumerate().take(levels) {
            let (from, to) = band(level, levels);
            let above = (highest - spread.rise[0]).min(to * spread.unit[1]);
            if above > from * spread.unit[0] && !spread.is_within(inner, above, map.texel_size(level)) {
                *around = blocks_around(map, spread, above, level).unwrap_or_default();
            }
        }
        let count = |[x0, x1, y0, y1]: [usize; 4]| (x1 - x0) * (y1 - y0) * map.layers;
        let apart = blocks_around(map, spread, 0.0, 0).map_or(0, count);
        let looked_at: usize = around.into_iter().map(count).sum();
        if points.len() > 1 && (looked_at > 8 * MOST_SHARED || apart > MOST_APART * points.len()) {
            return false;
        }
        for level in (0..levels).rev() {
            let (from, to) = band(level, levels);
            let (above_from, above_to) = (from * spread.unit[0], to * spread.unit[1]);
            let [x0, x1, y0, y1] = around[level];
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
                        let seam = Seam::of(sides, inner, size);
                        if seam == Seam::Within {
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
                        self.which.push(Which {
                            level,
                            block: index,
                            corner: first,
                            seam: seam == Seam::Across,
                        });
                    }
                }
            }
            if points.len() > 1 && self.which.len() > MOST_SHARED {
                return false;
            }
        }
        // Whole registers, of which the rest never passes.
        for _ in 0..LANES {
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
    fn hide<S: Simd>(&self, simd: S, served: &Served, point: &mut Open) {
        let (vector, eight) = (simd.widest(), simd.eight());
        let (seen, map) = (&point.seen, served.map);
        let inner = from_point(&served.inner, [seen.window_x, seen.window_y]);
        let [left, right, bottom, top] = seen.bounds;
        let x = vector.splat((seen.window_x - self.origin[0]) as f32);
        let y = vector.splat((seen.window_y - self.origin[1]) as f32);
        let mut places = [None; MOST_LEVELS];
        let mut hidden = eight.load_ints(&point.hidden);
        for first in (0..self.which.len()).step_by(S::Widest::LANES) {
            let from = vector.load(&self.from[first..]) * vector.splat(point.unit);
            let to = vector.load(&self.to[first..]) * vector.splat(point.unit);
            let highest = vector.load(&self.highest[first..]) - vector.splat(seen.rise);
            let lowest = vector.load(&self.lowest[first..]) - vector.splat(seen.rise);
            let above = vector.min(highest, to);
            let mut found = vector.greater(highest, from)
                & !vector.greater(lowest, to)
                & vector.greater(
                    vector.splat(right) * above,
                    vector.load(&self.sides[0][first..]) - x,
                )
                & vector.greater(
                    vector.load(&self.sides[1][first..]) - x,
                    vector.splat(left) * above,
                )
                & vector.greater(
                    vector.splat(top) * above,
                    vector.load(&self.sides[2][first..]) - y,
                )
                & vector.greater(
                    vector.load(&self.sides[3][first..]) - y,
                    vector.splat(bottom) * above,
                )
                & S::Widest::ALL;
            while found != 0 {
                let lane = found.trailing_zeros() as usize;
                found &= found - 1;
                let which = &self.which[first + lane];
                let place = places[which.level].get_or_insert_with(|| {
                    let (from, to) = band(which.level, map.levels.len());
                    Place::new(map, seen, which.level, from * point.unit, to * point.unit)
                });
                let inner = which.seam.then_some(inner);
                hidden =
                    fast::backproject_block(simd, map, seen, place, which.block, which.corner, inner, hidden);
                // In full shadow the nearest layer is mostly enough.
                if eight.all_set(hidden) {
                    point.hidden = [u32::MAX; 8];
                    return;
                }
            }
        }
        eight.store_ints(hidden, &mut point.hidden);
    }
}

/// Adds up what is left of the light.
#[inline(always)]
pub fn resolve<V: Vector>(vector: V, light: &Light, point: &Open) -> f32 {
    let seen = &point.seen;
    if point.hidden == Bits::default() {
        return 1.0;
    }
    // In full shadow, as long as there was anything to hide.
    let shines = |sample: usize| {
        let (x, y) = seen.sample(sample);
        light.weight(seen, x, y) > 0.0
    };
    if point.hidden == [u32::MAX; 8] && [128, 96, 160].into_iter().any(shines) {
        return 0.0;
    }
    fast::resolve(vector, light, seen, &point.hidden)
}
