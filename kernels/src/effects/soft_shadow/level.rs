//! One resolution of a light's map.
//!
//! Depths are kept as `rise`, a number that grows towards the light and is linear over planes: 1/depth in
//! a perspective view, -depth in an orthographic one. With it both kinds of view share one backprojection:
//! a texel at window position t and rise g, seen from a point at p and rise h, covers (t - p) / (g - h) of
//! the light's plane (thesis eq. 5.3 for any window; for a sun the plane at unit distance).

use crate::simd::{Simd, Work, dispatch};
use rayon::prelude::*;

/// Rise of a texel that holds nothing; never above a shading point's.
pub const EMPTY: f32 = f32::NEG_INFINITY;

/// Texels on a block's side.
pub const BLOCK: usize = 8;

/// Texels of a block.
pub const BLOCK_TEXELS: usize = BLOCK * BLOCK;

/// One resolution of the map. Level 0 is the map itself, level n keeps one texel of each 2^n x 2^n. Texels
/// are stored block by block; those beyond the map's sides are EMPTY.
pub struct Level {
    pub width: usize,
    pub height: usize,
    pub blocks_x: usize,
    pub blocks_y: usize,
    /// (layers, blocks_y, blocks_x, BLOCK, BLOCK): where the surface is.
    pub rise: Vec<f32>,
    /// Shaped alike: how `rise` changes to the next column and row, see [`pack_tilt`].
    pub tilt: Vec<u32>,
    /// (layers, blocks_y, blocks_x).
    pub blocks: Vec<Block>,
}

/// What a block's texels have in common.
#[derive(Clone, Copy)]
pub struct Block {
    /// Largest rise, EMPTY if the block is; and smallest of those that are not EMPTY.
    pub highest: f32,
    pub lowest: f32,
    /// A plane no texel is above: rise at the block's middle, and its change to the next column and row.
    pub cover: [f32; 3],
}

impl Level {
    pub fn index(&self, layer: usize, row: usize, column: usize) -> usize {
        let block = self.block(layer, row / BLOCK, column / BLOCK);
        block * BLOCK_TEXELS + row % BLOCK * BLOCK + column % BLOCK
    }

    pub fn block(&self, layer: usize, block_row: usize, block_column: usize) -> usize {
        (layer * self.blocks_y + block_row) * self.blocks_x + block_column
    }

    /// From one layer's texel to the next layer's.
    pub fn layer_stride(&self) -> usize {
        self.blocks_x * self.blocks_y * BLOCK_TEXELS
    }

    /// Fills lines of blocks in parallel, neighbouring lines of all layers together: `fill` (first row, lines by
    /// layer) writes every rise and tilt within the map's sides.
    pub fn filled(
        width: usize,
        height: usize,
        layers: usize,
        fill: impl Fn(usize, &mut [Line<'_>]) + Sync,
    ) -> Level {
        let (blocks_x, blocks_y) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        let count = layers * blocks_x * blocks_y;
        // Zeros come from the system untouched, so that the threads that write a page are first to meet it.
        let mut level = Level {
            width,
            height,
            blocks_x,
            blocks_y,
            rise: vec![0.0; count * BLOCK_TEXELS],
            tilt: vec![0; count * BLOCK_TEXELS],
            blocks: vec![Block::NOTHING; count],
        };
        let mut by_row: Vec<Vec<Line<'_>>> = (0..blocks_y).map(|_| Vec::with_capacity(layers)).collect();
        let rise = level.rise.chunks_mut(blocks_x * BLOCK_TEXELS);
        let tilt = level.tilt.chunks_mut(blocks_x * BLOCK_TEXELS);
        let blocks = level.blocks.chunks_mut(blocks_x);
        for (number, ((rise, tilt), blocks)) in rise.zip(tilt).zip(blocks).enumerate() {
            by_row[number % blocks_y].push(Line { rise, tilt, blocks });
        }
        let is_whole = |row: usize| width.is_multiple_of(BLOCK) && (row + 1) * BLOCK <= height;
        by_row.into_par_iter().enumerate().for_each(|(row, mut lines)| {
            if !is_whole(row) {
                lines.iter_mut().for_each(|line| line.rise.fill(EMPTY));
            }
            fill(row * BLOCK, &mut lines);
            dispatch(Around(&mut lines));
        });
        level
    }
}

/// Blocks side by side in one layer.
pub struct Line<'a> {
    pub rise: &'a mut [f32],
    pub tilt: &'a mut [u32],
    blocks: &'a mut [Block],
}

/// Looks what the blocks' texels have in common.
struct Around<'a, 'b>(&'a mut [Line<'b>]);

impl Work for Around<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        for line in self.0 {
            let texels = line.rise.as_chunks::<BLOCK_TEXELS>().0.iter();
            for (block, rise) in line.blocks.iter_mut().zip(texels) {
                *block = Block::around(rise);
            }
        }
    }
}

impl Block {
    const NOTHING: Block = Block {
        highest: EMPTY,
        lowest: f32::INFINITY,
        cover: [EMPTY, 0.0, 0.0],
    };

    /// Its cover has the slope between opposite sides if those are whole, and just clears the highest texel.
    #[inline(always)]
    fn around(rise: &[f32; BLOCK_TEXELS]) -> Block {
        // Column by column, which the compiler makes registers of.
        let (mut highest, mut lowest) = ([EMPTY; BLOCK], [f32::INFINITY; BLOCK]);
        let rows = rise.as_chunks::<BLOCK>().0;
        for row in rows {
            for ((highest, lowest), &rise) in highest.iter_mut().zip(&mut lowest).zip(row) {
                *highest = larger(*highest, rise);
                let held = if rise == EMPTY { f32::INFINITY } else { rise };
                *lowest = if held < *lowest { held } else { *lowest };
            }
        }
        let highest = highest.into_iter().fold(EMPTY, larger);
        if highest == EMPTY {
            return Block::NOTHING;
        }
        let last = BLOCK - 1;
        let across = (rise[4 * BLOCK + last] - rise[4 * BLOCK]) / last as f32;
        let along = (rise[last * BLOCK + 4] - rise[4]) / last as f32;
        let whole = |slope: f32| if slope.is_finite() { slope } else { 0.0 };
        let (across, along) = (whole(across), whole(along));
        let middle = 0.5 * last as f32;
        let mut clear = [EMPTY; BLOCK];
        for (y, row) in rows.iter().enumerate() {
            let along_y = along * (y as f32 - middle);
            for (x, (clear, &rise)) in clear.iter_mut().zip(row).enumerate() {
                *clear = larger(*clear, rise - (across * (x as f32 - middle) + along_y));
            }
        }
        Block {
            highest,
            lowest: lowest.into_iter().fold(f32::INFINITY, f32::min),
            cover: [clear.into_iter().fold(EMPTY, larger), across, along],
        }
    }
}

/// Neither is a NaN.
#[inline(always)]
pub fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The upper halves of two floats: 8 bits of precision, any size.
#[inline(always)]
pub fn pack_tilt(along_x: f32, along_y: f32) -> u32 {
    let round = |v: f32| v.to_bits().wrapping_add(0x8000);
    (round(along_x) & 0xffff_0000) | (round(along_y) >> 16)
}

/// Change of rise per column and per row.
#[inline(always)]
pub fn unpack_tilt(packed: u32) -> [f32; 2] {
    [f32::from_bits(packed & 0xffff_0000), f32::from_bits(packed << 16)]
}

/// How much farther from the light than its surface a texel starts to cast shadow (thesis section 5.3.4).
#[derive(Clone, Copy)]
pub struct Bias {
    /// Multiple of the depth difference to the neighbouring texel (thesis eq. 5.2).
    pub gradient_scale: f32,
    /// Metres that it never exceeds.
    pub gradient_cap: f32,
}

impl Bias {
    /// As a difference of rise: how far above a point a surface must be to shadow it. To first order the
    /// slope of rise gives it directly; of the cap, d(1/z) = dz / z^2.
    #[inline(always)]
    pub fn of(&self, orthographic: bool, rise: f32, tilt: [f32; 2]) -> f32 {
        let metre = if orthographic { 1.0 } else { rise * rise };
        (self.gradient_scale * tilt[0].abs().max(tilt[1].abs())).min(self.gradient_cap * metre)
    }
}
