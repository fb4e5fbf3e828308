//! A light's layered depth map made ready for backprojection: slopes, coarser maps, nearest-depth pyramid.
//!
//! Depths are kept as `rise`, a number that grows towards the light and is linear over planes: 1/depth in
//! a perspective view, -depth in an orthographic one. With it both kinds of view share one backprojection:
//! a texel at window position t and rise g, seen from a point at p and rise h, covers (t - p) / (g - h) of
//! the light's plane (thesis eq. 5.3 for any window; for a sun the plane at unit distance).

use super::light::Seen;
use crate::cancel::CancelFlag;
use crate::view::View;
use pyo3::PyResult;
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

    /// Fills rows of blocks in parallel: `texel` (layer, row, column) gives rise and tilt.
    fn filled(
        width: usize,
        height: usize,
        layers: usize,
        texel: impl Fn(usize, usize, usize) -> (f32, u32) + Sync,
    ) -> Level {
        let (blocks_x, blocks_y) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        let count = layers * blocks_x * blocks_y;
        let mut level = Level {
            width,
            height,
            blocks_x,
            blocks_y,
            rise: vec![EMPTY; count * BLOCK_TEXELS],
            tilt: vec![0; count * BLOCK_TEXELS],
            blocks: vec![Block::NOTHING; count],
        };
        let rise = level.rise.par_chunks_mut(blocks_x * BLOCK_TEXELS);
        let tilt = level.tilt.par_chunks_mut(blocks_x * BLOCK_TEXELS);
        let blocks = level.blocks.par_chunks_mut(blocks_x);
        let lines = rise.zip(tilt).zip(blocks).enumerate();
        lines.for_each(|(line, ((rise, tilt), blocks))| {
            let (layer, first_row) = (line / blocks_y, line % blocks_y * BLOCK);
            for y in 0..BLOCK.min(height - first_row) {
                for column in 0..width {
                    let at = column / BLOCK * BLOCK_TEXELS + y * BLOCK + column % BLOCK;
                    (rise[at], tilt[at]) = texel(layer, first_row + y, column);
                }
            }
            let texels = rise.as_chunks::<BLOCK_TEXELS>().0.iter();
            for (block, rise) in blocks.iter_mut().zip(texels) {
                *block = Block::around(rise);
            }
        });
        level
    }
}

impl Block {
    const NOTHING: Block = Block {
        highest: EMPTY,
        lowest: f32::INFINITY,
        cover: [EMPTY, 0.0, 0.0],
    };

    /// Its cover has the slope between opposite sides if those are whole, and just clears the highest texel.
    fn around(rise: &[f32; BLOCK_TEXELS]) -> Block {
        let (mut highest, mut lowest) = (EMPTY, f32::INFINITY);
        for &rise in rise {
            highest = highest.max(rise);
            lowest = lowest.min(if rise == EMPTY { f32::INFINITY } else { rise });
        }
        if highest == EMPTY {
            return Block::NOTHING;
        }
        let last = BLOCK - 1;
        let across = (rise[4 * BLOCK + last] - rise[4 * BLOCK]) / last as f32;
        let along = (rise[last * BLOCK + 4] - rise[4]) / last as f32;
        let whole = |slope: f32| if slope.is_finite() { slope } else { 0.0 };
        let (across, along) = (whole(across), whole(along));
        let middle = 0.5 * last as f32;
        let mut clear = EMPTY;
        for (i, &rise) in rise.iter().enumerate() {
            let (x, y) = ((i % BLOCK) as f32 - middle, (i / BLOCK) as f32 - middle);
            clear = clear.max(rise - (across * x + along * y));
        }
        Block {
            highest,
            lowest,
            cover: [clear, across, along],
        }
    }
}

/// The upper halves of two floats: 8 bits of precision, any size.
fn pack_tilt(along_x: f32, along_y: f32) -> u32 {
    let round = |v: f32| v.to_bits().wrapping_add(0x8000);
    (round(along_x) & 0xffff_0000) | (round(along_y) >> 16)
}

/// Change of rise per column and per row.
pub fn unpack_tilt(packed: u32) -> [f32; 2] {
    [f32::from_bits(packed & 0xffff_0000), f32::from_bits(packed << 16)]
}

/// Largest rise and largest biased rise of each node, over all layers; nodes of level n are 2^n texels wide.
pub struct PyramidLevel {
    pub width: usize,
    pub height: usize,
    pub nearest: Vec<[f32; 2]>,
}

/// How much farther from the light than its surface a texel starts to cast shadow (thesis section 5.3.4).
#[derive(Clone, Copy)]
pub struct Bias {
    /// Multiple of the depth difference to the neighbouring texel (thesis eq. 5.2).
    pub gradient_scale: f32,
    /// Metres that it never exceeds.
    pub gradient_cap: f32,
}

pub struct PreparedMap {
    pub view: View,
    pub bias: Bias,
    /// Stored depths per texel.
    pub layers: usize,
    pub levels: Vec<Level>,
    pub pyramid: Vec<PyramidLevel>,
}

impl PreparedMap {
    /// `depths` (layers, height, width), metres, ascending, infinite where empty.
    pub fn new(
        depths: &[f32],
        [layers, height, width]: [usize; 3],
        view: View,
        bias: Bias,
        cancel: &CancelFlag,
    ) -> PyResult<Self> {
        let source = Source {
            depths,
            layers,
            width,
            height,
            orthographic: view.orthographic,
        };
        let mut levels = vec![source.level()];
        cancel.check()?;
        while levels[levels.len() - 1]
            .width
            .min(levels[levels.len() - 1].height)
            >= 4 * BLOCK
        {
            levels.push(coarser(&levels[0], levels.len(), layers));
            cancel.check()?;
        }
        let mut map = PreparedMap {
            view,
            bias,
            layers,
            levels,
            pyramid: Vec::new(),
        };
        map.pyramid = map.build_pyramid();
        Ok(map)
    }

    /// Width and height of a level's texel in window units.
    pub fn texel_size(&self, level: usize) -> [f64; 2] {
        let [left, right, bottom, top] = self.view.window;
        let scale = (1u64 << level) as f64;
        [
            (right - left) / self.levels[0].width as f64 * scale,
            (top - bottom) / self.levels[0].height as f64 * scale,
        ]
    }

    /// Where a point is in texels of a level.
    pub fn place(&self, seen: &Seen, level: usize) -> [f32; 2] {
        let [texel_x, texel_y] = self.texel_size(level);
        [
            ((seen.window_x - self.view.window[0]) / texel_x) as f32,
            ((seen.window_y - self.view.window[2]) / texel_y) as f32,
        ]
    }

    /// Bias as a difference of rise: how far above a point a surface must be to shadow it. To first order
    /// the slope of rise gives it directly; of the cap, d(1/z) = dz / z^2.
    pub fn gradient_bias(&self, rise: f32, tilt: [f32; 2]) -> f32 {
        let metre = if self.view.orthographic { 1.0 } else { rise * rise };
        (self.bias.gradient_scale * tilt[0].abs().max(tilt[1].abs())).min(self.bias.gradient_cap * metre)
    }

    /// Largest rise of any texel, and largest biased rise.
    pub fn nearest(&self) -> [f32; 2] {
        self.pyramid[self.pyramid.len() - 1].nearest[0]
    }

    fn build_pyramid(&self) -> Vec<PyramidLevel> {
        let level = &self.levels[0];
        let (width, height) = (level.width, level.height);
        let mut nearest = vec![[EMPTY; 2]; width * height];
        nearest.par_chunks_mut(width).enumerate().for_each(|(row, out)| {
            for layer in 0..self.layers {
                for (column, node) in out.iter_mut().enumerate() {
                    let texel = level.index(layer, row, column);
                    let rise = level.rise[texel];
                    let bias = self.gradient_bias(rise, unpack_tilt(level.tilt[texel]));
                    *node = [node[0].max(rise), node[1].max(rise - bias)];
                }
            }
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
}

fn halved(finer: &PyramidLevel) -> PyramidLevel {
    let (width, height) = (finer.width.div_ceil(2), finer.height.div_ceil(2));
    let mut nearest = vec![[EMPTY; 2]; width * height];
    nearest.par_chunks_mut(width).enumerate().for_each(|(row, out)| {
        for y in 2 * row..(2 * row + 2).min(finer.height) {
            let line = &finer.nearest[y * finer.width..(y + 1) * finer.width];
            for (node, pair) in out.iter_mut().zip(line.chunks(2)) {
                for from in pair {
                    *node = [node[0].max(from[0]), node[1].max(from[1])];
                }
            }
        }
    });
    PyramidLevel {
        width,
        height,
        nearest,
    }
}

/// A coarser level picks texels rather than averaging them: an average of two surfaces is neither. Of each
/// 2^n x 2^n it picks one whose column shifts with the row and whose row shifts with the column (in
/// bit-reversed order), so that an edge along an axis is met at 2^n places and not at one; along its slope
/// the surface is carried to the middle.
fn coarser(finest: &Level, n: usize, layers: usize) -> Level {
    let scale = (1u32 << n) as f32;
    let shift = |i: usize| (i as u32).reverse_bits() >> (u32::BITS as usize - n);
    let to_middle = |shift: u32| 0.5 * (scale - 1.0) - shift as f32;
    Level::filled(
        finest.width >> n,
        finest.height >> n,
        layers,
        |layer, row, column| {
            let (shift_x, shift_y) = (shift(row), shift(column));
            let x = (column << n) + shift_x as usize;
            let y = (row << n) + shift_y as usize;
            let from = finest.index(layer, y, x);
            let [along_x, along_y] = unpack_tilt(finest.tilt[from]);
            let rise = finest.rise[from] + along_x * to_middle(shift_x) + along_y * to_middle(shift_y);
            (rise, pack_tilt(along_x * scale, along_y * scale))
        },
    )
}

/// The map as it was rasterised.
struct Source<'a> {
    depths: &'a [f32],
    layers: usize,
    width: usize,
    height: usize,
    orthographic: bool,
}

impl Source<'_> {
    fn row(&self, layer: usize, row: usize) -> &[f32] {
        let start = (layer * self.height + row) * self.width;
        &self.depths[start..start + self.width]
    }

    fn rise(&self, depth: f32) -> f32 {
        if self.orthographic { -depth } else { 1.0 / depth }
    }

    fn level(&self) -> Level {
        Level::filled(self.width, self.height, self.layers, |layer, row, column| {
            let depth = self.row(layer, row)[column];
            if depth.is_finite() && (depth > 0.0 || self.orthographic) {
                (self.rise(depth), self.tilt(layer, row, column, depth))
            } else {
                (EMPTY, 0)
            }
        })
    }

    /// Slope of the texel's surface: of the neighbours on an axis and of their layers, the one closest in depth
    /// is taken to be the same surface, unless the next layer of the texel itself is closer (a thin wire).
    fn tilt(&self, layer: usize, row: usize, column: usize, depth: f32) -> u32 {
        let reach = if layer + 1 < self.layers {
            self.row(layer + 1, row)[column] - depth
        } else {
            f32::INFINITY
        };
        let towards = |neighbours: [Option<(usize, usize)>; 2]| {
            let (mut closest, mut slope) = (reach, 0.0);
            for (sign, neighbour) in [-1.0, 1.0].into_iter().zip(neighbours) {
                let Some((row, column)) = neighbour else { continue };
                for other in layer.saturating_sub(1)..(layer + 2).min(self.layers) {
                    let there = self.row(other, row)[column];
                    if (there - depth).abs() < closest {
                        closest = (there - depth).abs();
                        slope = sign * (self.rise(there) - self.rise(depth));
                    }
                }
            }
            slope
        };
        pack_tilt(
            towards([
                (column > 0).then(|| (row, column - 1)),
                (column + 1 < self.width).then_some((row, column + 1)),
            ]),
            towards([
                (row > 0).then(|| (row - 1, column)),
                (row + 1 < self.height).then_some((row + 1, column)),
            ]),
        )
    }
}
