//! The nearest depths of every texel, in one pass: a k-buffer a tile, owned by one task.

use super::alpha::AlphaTest;
use super::bins::{Bins, TILE};
use super::simd::{Work, run_widest};
use super::tile::{BLOCKS, Depths, LANES, Sink, block_and_lane, draw_tile};
use crate::cancel::CancelFlag;
use pyo3::prelude::*;
use rayon::prelude::*;

pub const MAX_LAYERS: usize = 16;

/// Sorted depths of a tile's texels: `layers` vectors a block.
///
/// Fragments are inserted by a chain of min and max, so a texel ends with the smallest depths of the
/// whole multiset, whatever the order of arrival: what is left of equal depths cannot differ.
struct KBuffer {
    depths: Vec<Depths>,
    layers: usize,
}

impl Sink for KBuffer {
    #[inline(always)]
    fn wants(&self, block: usize, depths: &Depths) -> bool {
        let last = &self.depths[block * self.layers + self.layers - 1];
        let mut wanted = 0u32;
        for l in 0..LANES {
            wanted |= u32::from(depths[l] < last[l]);
        }
        wanted != 0
    }

    #[inline(always)]
    fn keep(&mut self, block: usize, depths: &Depths, _id: u32) {
        let mut falling = *depths;
        for kept in &mut self.depths[block * self.layers..(block + 1) * self.layers] {
            for l in 0..LANES {
                let (a, b) = (kept[l], falling[l]);
                kept[l] = if a < b { a } else { b };
                falling[l] = if a < b { b } else { a };
            }
        }
    }
}

struct DrawTile<'a, 'b> {
    bins: &'a Bins,
    alpha: &'a AlphaTest<'a>,
    tile: usize,
    orthographic: bool,
    layers: usize,
    /// This tile's part of each row, all rows of layer 0 first.
    rows: Vec<&'b mut [f32]>,
}

impl Work for DrawTile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let mut sink = KBuffer {
            depths: vec![[f32::INFINITY; LANES]; BLOCKS * self.layers],
            layers: self.layers,
        };
        draw_tile(self.bins, self.tile, self.alpha, self.orthographic, &mut sink);
        let count = self.rows.len() / self.layers;
        for (index, row) in self.rows.iter_mut().enumerate() {
            let (layer, y) = (index / count, index % count);
            for (x, out) in row.iter_mut().enumerate() {
                let (block, lane) = block_and_lane(x, y);
                *out = sink.depths[block * self.layers + layer][lane];
            }
        }
    }
}

/// Layer-major depths of the whole image: `layers * height * width`, ascending, INFINITY where there is no more.
pub fn layered_depth(
    bins: &Bins,
    alpha: &AlphaTest,
    orthographic: bool,
    layers: usize,
    height: usize,
    cancel: &CancelFlag,
) -> PyResult<Vec<f32>> {
    let grid = bins.grid;
    let mut image = vec![0.0f32; layers * height * grid.width];
    let mut tiles: Vec<Vec<&mut [f32]>> = Vec::new();
    tiles.resize_with(grid.count(), || Vec::with_capacity(TILE * layers));
    for (index, row) in image.chunks_mut(grid.width).enumerate() {
        let first = (index % height) / TILE * grid.columns;
        for (column, part) in row.chunks_mut(TILE).enumerate() {
            tiles[first + column].push(part);
        }
    }
    tiles.into_par_iter().enumerate().try_for_each(|(tile, rows)| {
        cancel.check()?;
        run_widest(DrawTile {
            bins,
            alpha,
            tile,
            orthographic,
            layers,
            rows,
        });
        Ok::<(), PyErr>(())
    })?;
    Ok(image)
}
