//! Drawing a tile: coverage and depth in blocks of 4 x 2 pixels.

use super::bins::{Bins, Item};
use super::block::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, BLOCKS_ACROSS, Block};
use super::clip::MAX_CORNERS;
use super::edge::{Edge, edge};
use super::grid::{Point, SUBPIXEL_BITS, SUBPIXELS, TILE};
use super::hit::Finder;
use super::scattered;
use super::setup::{Plane, Triangle};
use super::sink::Sink;
use crate::simd::Eight;
use std::ops::Range;

/// Offsets of a block's pixels from its first one: lane = x + 4 y.
const LANE_X: Block<u32> = Block([0, 1, 2, 3, 0, 1, 2, 3]);
const LANE_Y: Block<u32> = Block([0, 0, 0, 0, 1, 1, 1, 1]);
const LANE_X_FLOAT: Block<f32> = Block([0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0]);
const LANE_Y_FLOAT: Block<f32> = Block([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);

/// First and last pixel, relative to the tile.
type Extent = [[i32; 2]; 2];

/// What is drawn of a triangle inside a tile.
struct Outline<'a, const N: usize> {
    extent: Extent,
    edges: [Edge<i32>; N],
    plane: &'a Plane,
    id: u32,
    /// Where each fragment has to be looked at.
    tested: Option<&'a Finder<'a>>,
}

/// Draws all items of a tile into the sink, in the order of their ids.
#[inline(always)]
pub fn draw_tile<V: Eight, S: Sink>(v: V, bins: &Bins, tile: usize, finder: &Finder, sink: &mut S) {
    if let Some(places) = finder.places {
        scattered::draw_tile(v, bins, tile, finder, places, sink);
    } else if finder.camera.orthographic {
        draw_items::<V, S, true>(v, bins, tile, finder, sink);
    } else {
        draw_items::<V, S, false>(v, bins, tile, finder, sink);
    }
}

#[inline(always)]
fn draw_items<V: Eight, S: Sink, const ORTHOGRAPHIC: bool>(
    v: V,
    bins: &Bins,
    tile: usize,
    finder: &Finder,
    sink: &mut S,
) {
    let origin = bins.grid.origin(tile);
    for chunk in &bins.chunks {
        for &item in chunk.items(tile) {
            match chunk.item(item) {
                Item::Triangle(t) => {
                    let outline = small(origin, t).or_else(|| {
                        let (extent, edges) = cover::<3>(origin, &t.points)?;
                        Some(Outline {
                            extent,
                            edges,
                            plane: &t.plane,
                            id: t.id,
                            tested: None,
                        })
                    });
                    if let Some(outline) = outline {
                        draw::<V, S, ORTHOGRAPHIC, 3>(v, origin, &outline, sink);
                    }
                }
                Item::Polygon(p) => {
                    if let Some((extent, edges)) = cover::<MAX_CORNERS>(origin, p.points()) {
                        let outline = Outline {
                            extent,
                            edges,
                            plane: &p.plane,
                            id: p.id,
                            tested: p.is_tested.then_some(finder),
                        };
                        draw::<V, S, ORTHOGRAPHIC, MAX_CORNERS>(v, origin, &outline, sink);
                    }
                }
            }
        }
    }
}

/// Pixels whose centres lie in the bounding box of points given relative to the tile, within the tile.
#[inline(always)]
fn extent(low: Point, high: Point) -> Extent {
    let first = |at: i32| ((at + SUBPIXELS - 1) >> SUBPIXEL_BITS).max(0);
    let last = |at: i32| (at >> SUBPIXEL_BITS).min(TILE as i32 - 1);
    [[first(low[0]), first(low[1])], [last(high[0]), last(high[1])]]
}

/// A triangle no larger than a tile: everything fits 32 bits, and no edge need be tested against the tile.
#[inline(always)]
fn small<'a>(origin: [i32; 2], t: &'a Triangle) -> Option<Outline<'a, 3>> {
    let [ox, oy] = origin.map(|o| o * SUBPIXELS);
    let [a, b, c] = t.points.map(|p| [p[0] - ox, p[1] - oy]);
    let low = [a[0].min(b[0]).min(c[0]), a[1].min(b[1]).min(c[1])];
    let high = [a[0].max(b[0]).max(c[0]), a[1].max(b[1]).max(c[1])];
    // Coordinates then stay below 2^15 and sides below 2^14: the products are below 2^30.
    const SIDE: i32 = TILE as i32 * SUBPIXELS;
    if high[0] - low[0] > SIDE || high[1] - low[1] > SIDE {
        return None;
    }
    Some(Outline {
        extent: extent(low, high),
        edges: [edge(a, b), edge(b, c), edge(c, a)],
        plane: &t.plane,
        id: t.id,
        tested: None,
    })
}

/// The part of a tile that an outline may cover and the edges that cross it; edges that hold all over
/// the tile are left all zero, which is inside. None: the outline misses the tile.
fn cover<const N: usize>(origin: [i32; 2], points: &[Point]) -> Option<(Extent, [Edge<i32>; N])> {
    let [ox, oy] = origin.map(|o| o * SUBPIXELS);
    let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
    let mut edges = [Edge::default(); N];
    for (i, here) in edges.iter_mut().enumerate().take(points.len()) {
        let next = points[if i + 1 == points.len() { 0 } else { i + 1 }];
        let [a, b] = [points[i], next].map(|p| [p[0] - ox, p[1] - oy]);
        low = [low[0].min(a[0]), low[1].min(a[1])];
        high = [high[0].max(a[0]), high[1].max(a[1])];
        let exact = edge(a.map(i64::from), b.map(i64::from));
        if exact.largest([0; 2]) < 0 {
            return None;
        }
        if exact.smallest([0; 2]) < 0 {
            // The edge crosses the tile, so no value in it exceeds 63 (|dx| + |dy|) < 2^31.
            *here = Edge {
                at: exact.at as i32,
                dx: exact.dx as i32,
                dy: exact.dy as i32,
            };
        }
    }
    Some((extent(low, high), edges))
}

/// Blocks in a row beyond which looking for the ones that a triangle touches is quicker than trying all.
const NARROW: usize = 6;

/// The columns of the blocks starting at row `y` that no edge excludes.
#[inline(always)]
fn crossed<const N: usize>(edges: &[Edge<i32>; N], y: i32, columns: Range<i32>) -> Range<i32> {
    let (mut first, mut end) = (columns.start, columns.end);
    for edge in edges {
        // The largest value in column 0's block; it changes by `step` from column to column.
        let reach = (BLOCK_WIDTH as i32 - 1) * edge.dx.max(0) + (BLOCK_HEIGHT as i32 - 1) * edge.dy.max(0);
        let (most, step) = (edge.at + edge.dy * y + reach, BLOCK_WIDTH as i32 * edge.dx);
        match step.signum() {
            1 => first = first.max(-most.div_euclid(step)),
            -1 => end = end.min(most.div_euclid(-step) + 1),
            _ if most < 0 => end = first,
            _ => {}
        }
    }
    first..end
}

/// How much each edge's value changes from a block's first pixel to its others.
#[inline(always)]
fn edge_steps<V: Eight, const N: usize>(v: V, edges: &[Edge<i32>; N]) -> [V::Ints; N] {
    let mut steps = [v.splat_int(0); N];
    for (step, edge) in steps.iter_mut().zip(edges) {
        let along = v.mul_ints(v.splat_int(edge.dx), v.load_ints(&LANE_X.0));
        *step = v.add_ints(along, v.mul_ints(v.splat_int(edge.dy), v.load_ints(&LANE_Y.0)));
    }
    steps
}

#[inline(always)]
fn draw<V: Eight, S: Sink, const ORTHOGRAPHIC: bool, const N: usize>(
    v: V,
    origin: [i32; 2],
    outline: &Outline<'_, N>,
    sink: &mut S,
) {
    let Outline { edges, plane, id, .. } = outline;
    let [low, high] = outline.extent;
    let steps = edge_steps(v, edges);
    let plane_steps = v.splat(plane.dx as f32) * v.load(&LANE_X_FLOAT.0)
        + v.splat(plane.dy as f32) * v.load(&LANE_Y_FLOAT.0);
    let (nearest, farthest) = (v.splat(plane.nearest), v.splat(plane.farthest));
    const WIDTH: i32 = BLOCK_WIDTH as i32;
    const HEIGHT: i32 = BLOCK_HEIGHT as i32;
    for row in low[1].div_euclid(HEIGHT)..high[1].div_euclid(HEIGHT) + 1 {
        let y = row * HEIGHT;
        let mut columns = low[0].div_euclid(WIDTH)..high[0].div_euclid(WIDTH) + 1;
        if columns.len() > NARROW {
            columns = crossed(edges, y, columns);
        }
        for column in columns {
            let block = row as usize * BLOCKS_ACROSS + column as usize;
            if sink.hides(block, plane.nearest) {
                continue;
            }
            let x = column * WIDTH;
            let mut outside = v.splat_int(0);
            for (e, &step) in edges.iter().zip(&steps) {
                outside = v.or_ints(outside, v.add_ints(v.splat_int(e.at + e.dx * x + e.dy * y), step));
            }
            if v.bits(v.negative(outside)) == V::ALL {
                continue;
            }
            let pixel = [origin[0] + x, origin[1] + y];
            let mut depths = v.splat(plane.value(pixel) as f32) + plane_steps;
            if !ORTHOGRAPHIC {
                // What lies beyond infinity (a plane seen edge on) is far, not behind.
                depths = v.splat(1.0) / v.max(depths, v.splat(f32::MIN_POSITIVE));
            }
            depths = v.min(v.max(depths, nearest), farthest);
            depths = v.select(v.negative(outside), v.splat(f32::INFINITY), depths);
            if !sink.wants(v, block, depths) {
                continue;
            }
            if let Some(finder) = outline.tested {
                let mut cut = Block([0.0; BLOCK_PIXELS]);
                v.store(depths, &mut cut.0);
                finder.cut(&mut cut, *id, pixel);
                depths = v.load(&cut.0);
            }
            sink.keep(v, block, depths, *id);
        }
    }
}
