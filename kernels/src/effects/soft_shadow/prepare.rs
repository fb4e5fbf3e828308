//! A light's layered depth map made ready for backprojection: slopes, coarser maps, nearest-depth pyramid.

use super::finest::finest;
use super::level::{BLOCK, BLOCK_TEXELS, Bias, Level, pack_tilt, unpack_tilt};
use super::light::Seen;
use super::pyramid::{self, PyramidLevel};
use crate::cancel::CancelFlag;
use crate::view::View;
use pyo3::PyResult;

pub struct PreparedMap {
    pub view: View,
    pub bias: Bias,
    /// Stored depths per texel.
    pub layers: usize,
    pub levels: Vec<Level>,
    /// Width and height of each level's texels in window units.
    texels: Vec<[f64; 2]>,
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
        let mut levels = vec![finest(depths, [layers, height, width], view.orthographic)];
        cancel.check()?;
        while levels[levels.len() - 1]
            .width
            .min(levels[levels.len() - 1].height)
            >= 4 * BLOCK
        {
            levels.push(coarser(&levels[0], levels.len(), layers));
            cancel.check()?;
        }
        let [left, right, bottom, top] = view.window;
        let finest = [(right - left) / width as f64, (top - bottom) / height as f64];
        let texels = (0..levels.len()).map(|level| finest.map(|size| size * (1u64 << level) as f64));
        let texels = texels.collect();
        let pyramid = pyramid::build(&levels[0], layers, view.orthographic, bias);
        Ok(PreparedMap {
            view,
            bias,
            layers,
            levels,
            texels,
            pyramid,
        })
    }

    /// Width and height of a level's texel in window units.
    #[inline(always)]
    pub fn texel_size(&self, level: usize) -> [f64; 2] {
        self.texels[level]
    }

    /// Where a point is in texels of a level.
    pub fn place(&self, seen: &Seen, level: usize) -> [f32; 2] {
        let [texel_x, texel_y] = self.texel_size(level);
        [
            ((seen.window_x - self.view.window[0]) / texel_x) as f32,
            ((seen.window_y - self.view.window[2]) / texel_y) as f32,
        ]
    }

    pub fn gradient_bias(&self, rise: f32, tilt: [f32; 2]) -> f32 {
        self.bias.of(self.view.orthographic, rise, tilt)
    }

    /// Largest rise of any texel, and largest biased rise.
    pub fn nearest(&self) -> [f32; 2] {
        self.pyramid[self.pyramid.len() - 1].nearest[0]
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
    let (width, height) = (finest.width >> n, finest.height >> n);
    Level::filled(width, height, layers, |first_row, lines| {
        for (layer, line) in lines.iter_mut().enumerate() {
            for row in first_row..(first_row + BLOCK).min(height) {
                let shift_x = shift(row);
                for column in 0..width {
                    let shift_y = shift(column);
                    let x = (column << n) + shift_x as usize;
                    let y = (row << n) + shift_y as usize;
                    let from = finest.index(layer, y, x);
                    let [along_x, along_y] = unpack_tilt(finest.tilt[from]);
                    let at = column / BLOCK * BLOCK_TEXELS + row % BLOCK * BLOCK + column % BLOCK;
                    line.rise[at] =
                        finest.rise[from] + along_x * to_middle(shift_x) + along_y * to_middle(shift_y);
                    line.tilt[at] = pack_tilt(along_x * scale, along_y * scale);
                }
            }
        }
    })
}
