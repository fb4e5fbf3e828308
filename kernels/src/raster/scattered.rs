//! Drawing a tile each of whose pixels is sampled at a place of its own: blocks that an outline may meet anywhere
//! within its pixels' reach, then each pixel exactly.

use super::bins::{Bins, Item};
use super::block::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, BLOCKS, BLOCKS_ACROSS, Block};
use super::clip::MAX_CORNERS;
use super::grid::{Point, SUBPIXELS, TILE};
use super::hit::Finder;
use super::places::Places;
use super::setup::Plane;
use super::sink::Sink;
use crate::simd::Eight;

/// One edge's half plane: inside where `at + dx * x + dy * y >= 0`, in subpixels from the tile's origin. Coordinates
/// are whole and below 2^25, so that double precision holds every product and sum exactly.
#[derive(Clone, Copy, Default)]
struct Edge {
    at: f64,
    dx: f64,
    dy: f64,
}

impl Edge {
    /// From `a` to `b`, inside on its left (y up); what lies on it belongs to it as edge.rs says.
    fn new(a: [f64; 2], b: [f64; 2]) -> Self {
        let (x, y) = (b[0] - a[0], b[1] - a[1]);
        let owns = y < 0.0 || (y == 0.0 && x < 0.0);
        Edge {
            at: y * a[0] - x * a[1] - f64::from(u8::from(!owns)),
            dx: -y,
            dy: x,
        }
    }

    #[inline(always)]
    fn value(&self, x: f64, y: f64) -> f64 {
        self.at + self.dx * x + self.dy * y
    }
}

struct Outline<'a, const N: usize> {
    /// Of those that there are not all is 0, which is inside.
    edges: [Edge; N],
    /// First and last block.
    blocks: [[i32; 2]; 2],
    plane: &'a Plane,
    id: u32,
    is_tested: bool,
}

impl<'a, const N: usize> Outline<'a, N> {
    /// None where it misses the tile.
    fn new(
        origin: [i32; 2],
        reach: i32,
        points: &[Point],
        plane: &'a Plane,
        id: u32,
        is_tested: bool,
    ) -> Option<Self> {
        let [ox, oy] = origin.map(|o| o * SUBPIXELS);
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        let mut edges = [Edge::default(); N];
        for (i, edge) in edges.iter_mut().enumerate().take(points.len()) {
            let next = points[if i + 1 == points.len() { 0 } else { i + 1 }];
            let [a, b] = [points[i], next].map(|p| [p[0] - ox, p[1] - oy]);
            low = [low[0].min(a[0]), low[1].min(a[1])];
            high = [high[0].max(a[0]), high[1].max(a[1])];
            *edge = Edge::new(a.map(f64::from), b.map(f64::from));
        }
        let block = |at: i32, side: usize| at.div_euclid(SUBPIXELS).div_euclid(side as i32);
        let sides = [BLOCK_WIDTH, BLOCK_HEIGHT];
        let first = [0, 1].map(|k| block(low[k] - reach, sides[k]).max(0));
        let last = [0, 1].map(|k| block(high[k] + reach, sides[k]).min((TILE / sides[k]) as i32 - 1));
        (first[0] <= last[0] && first[1] <= last[1]).then_some(Outline {
            edges,
            blocks: [first, last],
            plane,
            id,
            is_tested,
        })
    }
}

/// Draws all items of a tile into the sink, in the order of their ids.
#[inline(always)]
pub fn draw_tile<V: Eight, S: Sink>(
    v: V,
    bins: &Bins,
    tile: usize,
    finder: &Finder,
    places: &Places,
    sink: &mut S,
) {
    if bins.is_empty(tile) {
        return;
    }
    let (origin, reach) = (bins.grid.origin(tile), bins.grid.reach);
    let mut at = Box::new([[Block([0.0; BLOCK_PIXELS]); 2]; BLOCKS]);
    places.of_tile(tile, &mut at);
    let orthographic = finder.camera.orthographic;
    for chunk in &bins.chunks {
        for &item in chunk.items(tile) {
            match chunk.item(item) {
                Item::Triangle(t) => {
                    let outline = Outline::<3>::new(origin, reach, &t.points, &t.plane, t.id, false);
                    if let Some(outline) = outline {
                        if orthographic {
                            draw::<V, S, true, 3>(v, origin, reach, &outline, &at, finder, sink);
                        } else {
                            draw::<V, S, false, 3>(v, origin, reach, &outline, &at, finder, sink);
                        }
                    }
                }
                Item::Polygon(p) => {
                    let outline =
                        Outline::<MAX_CORNERS>::new(origin, reach, p.points(), &p.plane, p.id, p.is_tested);
                    if let Some(outline) = outline {
                        if orthographic {
                            draw::<V, S, true, MAX_CORNERS>(v, origin, reach, &outline, &at, finder, sink);
                        } else {
                            draw::<V, S, false, MAX_CORNERS>(v, origin, reach, &outline, &at, finder, sink);
                        }
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn draw<V: Eight, S: Sink, const ORTHOGRAPHIC: bool, const N: usize>(
    v: V,
    origin: [i32; 2],
    reach: i32,
    outline: &Outline<'_, N>,
    at: &[[Block<f32>; 2]; BLOCKS],
    finder: &Finder,
    sink: &mut S,
) {
    let (edges, plane) = (&outline.edges, outline.plane);
    let per_subpixel = 1.0 / f64::from(SUBPIXELS);
    let (base, dx, dy) = (
        plane.value(origin),
        plane.dx * per_subpixel,
        plane.dy * per_subpixel,
    );
    // Half of what the samples of a block's pixels may span, and its middle from its first pixel's centre.
    let middle = [BLOCK_WIDTH, BLOCK_HEIGHT].map(|side| 0.5 * f64::from((side as i32 - 1) * SUBPIXELS));
    let half = middle.map(|m| m + f64::from(reach));
    let [first, last] = outline.blocks;
    for row in first[1]..last[1] + 1 {
        for column in first[0]..last[0] + 1 {
            let block = row as usize * BLOCKS_ACROSS + column as usize;
            if sink.hides(block, plane.nearest) {
                continue;
            }
            let pixel = [column * BLOCK_WIDTH as i32, row * BLOCK_HEIGHT as i32];
            let centre = [0, 1].map(|k| f64::from(pixel[k] * SUBPIXELS) + middle[k]);
            let (mut most, mut least) = (f64::INFINITY, f64::INFINITY);
            for edge in edges {
                let here = edge.value(centre[0], centre[1]);
                let span = edge.dx.abs() * half[0] + edge.dy.abs() * half[1];
                most = most.min(here + span);
                least = least.min(here - span);
            }
            if most < 0.0 {
                continue;
            }
            let [x, y] = &at[block];
            let (x, y) = (x.0.map(f64::from), y.0.map(f64::from));
            let mut inside = [f64::INFINITY; BLOCK_PIXELS];
            if least < 0.0 {
                for edge in edges {
                    for l in 0..BLOCK_PIXELS {
                        let here = edge.value(x[l], y[l]);
                        inside[l] = if here < inside[l] { here } else { inside[l] };
                    }
                }
            }
            let mut depths = Block([f32::INFINITY; BLOCK_PIXELS]);
            for l in 0..BLOCK_PIXELS {
                let depth = (base + dx * x[l] + dy * y[l]) as f32;
                let depth = if ORTHOGRAPHIC {
                    depth
                } else {
                    // What lies beyond infinity (a plane seen edge on) is far, not behind.
                    1.0 / depth.max(f32::MIN_POSITIVE)
                };
                let depth = depth.max(plane.nearest).min(plane.farthest);
                depths.0[l] = if inside[l] >= 0.0 { depth } else { f32::INFINITY };
            }
            if !sink.wants(v, block, v.load(&depths.0)) {
                continue;
            }
            if outline.is_tested {
                let pixel = [origin[0] + pixel[0], origin[1] + pixel[1]];
                finder.cut(&mut depths, outline.id, pixel);
            }
            sink.keep(v, block, v.load(&depths.0), outline.id);
        }
    }
}
