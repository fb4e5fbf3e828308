//! Drawing a tile: coverage and depth in blocks of 4 x 2 pixels.

use super::alpha::AlphaTest;
use super::bins::{Bins, Edge, Item, TILE};
use super::setup::{Plane, Point};

pub const BLOCK_WIDTH: usize = 4;
pub const BLOCK_HEIGHT: usize = 2;
pub const LANES: usize = BLOCK_WIDTH * BLOCK_HEIGHT;
pub const BLOCKS_ACROSS: usize = TILE / BLOCK_WIDTH;
/// Blocks in a tile.
pub const BLOCKS: usize = BLOCKS_ACROSS * (TILE / BLOCK_HEIGHT);

/// Depths of a block's pixels, `INFINITY` where the triangle is not; lane = x + 4 y.
pub type Depths = [f32; LANES];

/// Where a pixel of a tile is kept: block and lane.
#[inline(always)]
pub fn block_and_lane(x: usize, y: usize) -> (usize, usize) {
    (
        (y / BLOCK_HEIGHT) * BLOCKS_ACROSS + x / BLOCK_WIDTH,
        (y % BLOCK_HEIGHT) * BLOCK_WIDTH + x % BLOCK_WIDTH,
    )
}

/// Keeps what a tile's pixels need of the fragments. Owned by the one task that draws the tile.
pub trait Sink {
    /// Whether any of these depths would be kept.
    fn wants(&self, block: usize, depths: &Depths) -> bool;
    /// Keeps what it wants of a triangle's depths in a block.
    fn keep(&mut self, block: usize, depths: &Depths, id: u32);
}

/// Draws all items of a tile into the sink, in the order of their ids.
#[inline(always)]
pub fn draw_tile<S: Sink>(bins: &Bins, tile: usize, alpha: &AlphaTest, orthographic: bool, sink: &mut S) {
    if orthographic {
        draw_items::<S, true>(bins, tile, alpha, sink);
    } else {
        draw_items::<S, false>(bins, tile, alpha, sink);
    }
}

#[inline(always)]
fn draw_items<S: Sink, const ORTHOGRAPHIC: bool>(bins: &Bins, tile: usize, alpha: &AlphaTest, sink: &mut S) {
    let origin = bins.grid.origin(tile);
    for item in bins.items(tile) {
        match item {
            Item::Triangle(t) => {
                if let Some((box_, edges)) = cover::<3>(bins, origin, &t.points) {
                    blocks::<S, ORTHOGRAPHIC, 3>(origin, box_, &edges, &t.plane, t.id, None, sink);
                }
            }
            Item::Polygon(p) => {
                if let Some((box_, edges)) = cover::<9>(bins, origin, &p.points[..p.count]) {
                    let test = p.alpha_tested.then_some(alpha);
                    blocks::<S, ORTHOGRAPHIC, 9>(origin, box_, &edges, &p.plane, p.id, test, sink);
                }
            }
        }
    }
}

/// First and last pixel, relative to the tile.
type Box = [[usize; 2]; 2];

/// The part of a tile that an outline may cover and the edges that cross it; edges that hold all over
/// the tile are left all zero, which is inside. None: the outline misses the tile.
#[inline(always)]
fn cover<const N: usize>(bins: &Bins, origin: [usize; 2], points: &[Point]) -> Option<(Box, [Edge<i32>; N])> {
    let [low, high] = bins.grid.pixels(points)?;
    let first = |i: usize| (low[i] as usize).max(origin[i]) - origin[i];
    let last = |i: usize| (high[i] as usize).min(origin[i] + TILE - 1) - origin[i];
    let mut edges = [Edge::default(); N];
    for (i, edge) in edges.iter_mut().enumerate().take(points.len()) {
        let next = if i + 1 == points.len() { 0 } else { i + 1 };
        let exact = Edge::between(points[i], points[next]);
        if exact.largest(origin) < 0 {
            return None;
        }
        if exact.smallest(origin) < 0 {
            // The edge crosses the tile, so no value on it exceeds 63 (|dx| + |dy|) < 2^31.
            *edge = Edge {
                at: exact.value(origin[0] as i64, origin[1] as i64) as i32,
                dx: exact.dx as i32,
                dy: exact.dy as i32,
            };
        }
    }
    Some(([[first(0), first(1)], [last(0), last(1)]], edges))
}

/// Offsets of a block's pixels from its first one.
const LANE_X: [i32; LANES] = [0, 1, 2, 3, 0, 1, 2, 3];
const LANE_Y: [i32; LANES] = [0, 0, 0, 0, 1, 1, 1, 1];

#[inline(always)]
fn blocks<S: Sink, const ORTHOGRAPHIC: bool, const N: usize>(
    origin: [usize; 2],
    [low, high]: Box,
    edges: &[Edge<i32>; N],
    plane: &Plane,
    id: u32,
    alpha: Option<&AlphaTest>,
    sink: &mut S,
) {
    let edge_lanes: [[i32; LANES]; N] =
        std::array::from_fn(|e| std::array::from_fn(|l| edges[e].dx * LANE_X[l] + edges[e].dy * LANE_Y[l]));
    let (dx, dy) = (plane.dx as f32, plane.dy as f32);
    let plane_lanes: [f32; LANES] = std::array::from_fn(|l| dx * LANE_X[l] as f32 + dy * LANE_Y[l] as f32);
    for row in low[1] / BLOCK_HEIGHT..=high[1] / BLOCK_HEIGHT {
        for column in low[0] / BLOCK_WIDTH..=high[0] / BLOCK_WIDTH {
            let (x, y) = (column * BLOCK_WIDTH, row * BLOCK_HEIGHT);
            let mut outside = [0i32; LANES];
            for (edge, lanes) in edges.iter().zip(&edge_lanes) {
                let here = edge
                    .at
                    .wrapping_add(edge.dx.wrapping_mul(x as i32))
                    .wrapping_add(edge.dy.wrapping_mul(y as i32));
                for l in 0..LANES {
                    outside[l] |= here.wrapping_add(lanes[l]);
                }
            }
            if outside.iter().fold(-1, |all, o| all & o) < 0 {
                continue;
            }
            let here = plane.value(origin[0] + x, origin[1] + y) as f32;
            let mut depths = [0.0; LANES];
            for l in 0..LANES {
                let value = here + plane_lanes[l];
                let depth = if ORTHOGRAPHIC {
                    value
                } else {
                    // Beyond infinity (a plane seen edge on) is far, not behind.
                    1.0 / if value > f32::MIN_POSITIVE {
                        value
                    } else {
                        f32::MIN_POSITIVE
                    }
                };
                // Written so that NaN becomes `nearest`.
                let depth = if depth > plane.nearest {
                    depth
                } else {
                    plane.nearest
                };
                let depth = if depth < plane.farthest {
                    depth
                } else {
                    plane.farthest
                };
                depths[l] = if outside[l] < 0 { f32::INFINITY } else { depth };
            }
            let block = row * BLOCKS_ACROSS + column;
            if !sink.wants(block, &depths) {
                continue;
            }
            if let Some(alpha) = alpha {
                alpha.cut(&mut depths, id, origin[0] + x, origin[1] + y);
            }
            sink.keep(block, &depths, id);
        }
    }
}
