//! The nearest depths of every texel, in one pass: a k-buffer a tile, owned by one task.

use super::bins::Bins;
use super::block::{BLOCK_PIXELS, BLOCK_WIDTH, BLOCKS, Block, quarter};
use super::grid::TILE;
use super::hit::Finder;
use super::sink::Sink;
use super::tile::draw_tile;
use crate::cancel::CancelFlag;
use crate::simd::{Eight, Simd, Work, dispatch};
use pyo3::prelude::*;
use rayon::prelude::*;

pub const MAX_LAYERS: usize = 16;

/// Sorted depths of a tile's texels: `layers` vectors a block.
///
/// Fragments are inserted by a chain of min and max, so a texel ends with the smallest depths of the
/// whole multiset, whatever the order of arrival: what is left of equal depths cannot differ.
struct KBuffer<'a> {
    depths: &'a mut [Block<f32>],
    layers: usize,
}

impl Sink for KBuffer<'_> {
    #[inline(always)]
    fn wants<V: Eight>(&self, v: V, block: usize, depths: V::Floats) -> bool {
        let last = &self.depths[block * self.layers + self.layers - 1];
        v.bits(v.less(depths, v.load(&last.0))) != 0
    }

    #[inline(always)]
    fn keep<V: Eight>(&mut self, v: V, block: usize, depths: V::Floats, _id: u32) {
        let mut falling = depths;
        for layer in &mut self.depths[block * self.layers..(block + 1) * self.layers] {
            let kept = v.load(&layer.0);
            v.store(v.min(kept, falling), &mut layer.0);
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
    depths: &'a mut [Block<f32>],
    /// This tile's part of each row, all rows of layer 0 first.
    rows: Vec<&'b mut [f32]>,
}

impl Work for DrawTile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        self.depths.fill(Block([f32::INFINITY; BLOCK_PIXELS]));
        let mut sink = KBuffer {
            depths: self.depths,
            layers: self.layers,
        };
        draw_tile(simd.eight(), self.bins, self.tile, self.finder, &mut sink);
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
    let buffer = || vec![Block([f32::INFINITY; BLOCK_PIXELS]); BLOCKS * layers];
    tiles
        .into_par_iter()
        .enumerate()
        .try_for_each_init(buffer, |depths, (tile, mut rows)| {
            cancel.check()?;
            if bins.is_empty(tile) {
                rows.iter_mut().for_each(|row| row.fill(f32::INFINITY));
            } else {
                dispatch(DrawTile {
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
