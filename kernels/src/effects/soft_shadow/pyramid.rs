//! Largest rises over squares of texels, all layers together: how near the light what is in a region may be.

use super::level::{BLOCK, BLOCK_TEXELS, Bias, EMPTY, Level, larger, unpack_tilt};
use crate::simd::{Simd, Work, dispatch};
use rayon::prelude::*;

/// Largest rise and largest biased rise of each node, over all layers; nodes of level n are 2^n texels wide.
pub struct PyramidLevel {
    pub width: usize,
    pub height: usize,
    pub nearest: Vec<[f32; 2]>,
}

/// All levels, down to a single node.
pub fn build(finest: &Level, layers: usize, orthographic: bool, bias: Bias) -> Vec<PyramidLevel> {
    let (width, height) = (finest.width, finest.height);
    let mut nearest = vec![[0.0; 2]; width * height];
    let rows = nearest.par_chunks_mut(BLOCK * width).enumerate();
    rows.for_each(|(block_row, nodes)| {
        dispatch(Nodes {
            finest,
            layers,
            orthographic,
            bias,
            block_row,
            nodes,
        })
    });
    let mut pyramid = vec![PyramidLevel {
        width,
        height,
        nearest,
    }];
    while pyramid[pyramid.len() - 1].nearest.len() > 1 {
        pyramid.push(halved(&pyramid[pyramid.len() - 1]));
    }
    pyramid
}

/// The nodes of a row of blocks.
struct Nodes<'a> {
    finest: &'a Level,
    layers: usize,
    orthographic: bool,
    bias: Bias,
    block_row: usize,
    nodes: &'a mut [[f32; 2]],
}

impl Work for Nodes<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let width = self.finest.width;
        for block_column in 0..self.finest.blocks_x {
            let (mut highest, mut biased) = ([EMPTY; BLOCK_TEXELS], [EMPTY; BLOCK_TEXELS]);
            for layer in 0..self.layers {
                let start = self.finest.block(layer, self.block_row, block_column) * BLOCK_TEXELS;
                let rises = &self.finest.rise[start..start + BLOCK_TEXELS];
                let tilts = &self.finest.tilt[start..start + BLOCK_TEXELS];
                for i in 0..BLOCK_TEXELS {
                    let rise = rises[i];
                    let start = rise - self.bias.of(self.orthographic, rise, unpack_tilt(tilts[i]));
                    highest[i] = larger(highest[i], rise);
                    biased[i] = larger(biased[i], start);
                }
            }
            let first = block_column * BLOCK;
            for (row, nodes) in self.nodes.chunks_exact_mut(width).enumerate() {
                for (column, node) in nodes[first..width.min(first + BLOCK)].iter_mut().enumerate() {
                    let texel = row * BLOCK + column;
                    *node = [highest[texel], biased[texel]];
                }
            }
        }
    }
}

fn halved(finer: &PyramidLevel) -> PyramidLevel {
    let (width, height) = (finer.width.div_ceil(2), finer.height.div_ceil(2));
    let mut nearest = vec![[0.0; 2]; width * height];
    nearest.par_chunks_mut(width).enumerate().for_each(|(row, out)| {
        // The last row and column of an odd number of them are taken twice.
        let line = |y: usize| &finer.nearest[y * finer.width..(y + 1) * finer.width];
        let (upper, lower) = (line(2 * row), line((2 * row + 1).min(finer.height - 1)));
        for (column, node) in out.iter_mut().enumerate() {
            let (x0, x1) = (2 * column, (2 * column + 1).min(finer.width - 1));
            let four = [upper[x0], upper[x1], lower[x0], lower[x1]];
            *node = [0, 1].map(|which| four.into_iter().map(|node| node[which]).fold(EMPTY, larger));
        }
    });
    PyramidLevel {
        width,
        height,
        nearest,
    }
}
