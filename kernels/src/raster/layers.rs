//! The nearest depths of every texel, in one pass: a k-buffer a tile, owned by one task.

use super::bins::{Bins, TILE};
use super::hit::Finder;
use super::simd::{LANES, Lanes, Vector, Work, run_widest};
use super::tile::{BLOCK_WIDTH, BLOCKS, Sink, draw_tile, quarter};
use crate::cancel::CancelFlag;
use pyo3::prelude::*;
use rayon::prelude::*;

pub const MAX_LAYERS: usize = 16;

/// Sorted depths of a tile's texels: `layers` vectors a block.
///
/// Fragments are inserted by a chain of min and max, so a texel ends with the smallest depths of the
/// whole multiset, whatever the order of arrival: what is left of equal depths cannot differ.
struct KBuffer<'a> {
    depths: &'a mut [Lanes<f32>],
    layers: usize,
}

impl Sink for KBuffer<'_> {
    #[inline(always)]
    fn wants<V: Vector>(&self, v: V, block: usize, depths: V::Float) -> bool {
        let last = &self.depths[block * self.layers + self.layers - 1];
        v.bits(v.less(depths, v.floats(last))) != 0
    }

    #[inline(always)]
    fn keep<V: Vector>(&mut self, v: V, block: usize, depths: V::Float, _id: u32) {
        let mut falling = depths;
        for layer in &mut self.depths[block * self.layers..(block + 1) * self.layers] {
            let kept = v.floats(layer);
            v.store_floats(v.min(kept, falling), layer);
            falling = v.max(kept, falling);
        }
    }
}

struct DrawTile<'a, 'b> {
    bins: &'a Bins,
    finder: &'a Finder<'a>,
    tile: usize,
    layers: usize,
    /// Used again by the next tile.
    depths: &'a mut [Lanes<f32>],
    /// This tile's part of each row, all rows of layer 0 first.
    rows: Vec<&'b mut [f32]>,
}

impl Work for DrawTile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(mut self, v: V) {
        self.depths.fill(Lanes([f32::INFINITY; LANES]));
        let mut sink = KBuffer {
            depths: self.depths,
            layers: self.layers,
        };
        draw_tile(v, self.bins, self.tile, self.finder, &mut sink);
        let count = self.rows.len() / self.layers;
        let [columns, rows] = self.bins.grid.extent(self.tile);
        for (index, mut row) in self.rows.iter_mut().map(|row| &mut **row).enumerate() {
            let (layer, y) = (index / count, rows.start + index % count);
            let mut x = columns.start;
            while !row.is_empty() {
                let (block, lane) = quarter(x, y);
                let lanes = &sink.depths[block * self.layers + layer].0[lane..lane + BLOCK_WIDTH];
                let inside = &lanes[x % BLOCK_WIDTH..];
                let (part, rest) = row.split_at_mut(row.len().min(inside.len()));
                part.copy_from_slice(&inside[..part.len()]);
                (row, x) = (rest, x + part.len());
            }
        }
    }
}

/// Layer-major depths of the whole image: `layers * height * width`, ascending, INFINITY where there is no more.
pub fn layered_depth(bins: &Bins, finder: &Finder, layers: usize, cancel: &CancelFlag) -> PyResult<Vec<f32>> {
    let grid = bins.grid;
    let mut image = vec![0.0f32; layers * grid.height * grid.width];
    let mut tiles: Vec<Vec<&mut [f32]>> = Vec::new();
    tiles.resize_with(grid.count(), || Vec::with_capacity(TILE * layers));
    for layer in image.chunks_mut(grid.height * grid.width) {
        grid.deal(layer, |tile, _, part| tiles[tile].push(part));
    }
    let buffer = || vec![Lanes([f32::INFINITY; LANES]); BLOCKS * layers];
    tiles
        .into_par_iter()
        .enumerate()
        .try_for_each_init(buffer, |depths, (tile, mut rows)| {
            cancel.check()?;
            if bins.is_empty(tile) {
                rows.iter_mut().for_each(|row| row.fill(f32::INFINITY));
            } else {
                run_widest(DrawTile {
                    bins,
                    finder,
                    tile,
                    layers,
                    depths,
                    rows,
                });
            }
            Ok::<(), PyErr>(())
        })?;
    Ok(image)
}
