//! Each pixel's own place to be sampled at, instead of one that all pixels share (GPU Zen III.2).

use super::block::{BLOCK_HEIGHT, BLOCK_WIDTH, BLOCKS, BLOCKS_ACROSS, Block};
use super::camera::MAX_JITTER;
use super::grid::{Grid, SUBPIXELS};
use super::wide::{Pixels, WIDE};
use crate::cancel::CancelFlag;
use crate::random::{pcg, scrambled};
use numpy::{PyArray1, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Offsets from the centres of a grid's pixels, in whole subpixels, so that edge functions stay exact.
pub struct Places {
    grid: Grid,
    offsets: Vec<[i16; 2]>,
}

impl Places {
    /// Reads (h, w, 2) f32 pixels, h and w as the grid has them, and tells the grid how far they reach.
    pub fn new(offsets: &PyReadonlyArray3<'_, f32>, grid: &mut Grid) -> PyResult<Self> {
        if offsets.shape() != [grid.height, grid.width, 2] {
            return Err(PyValueError::new_err(format!(
                "offsets are {:?}, not {:?}",
                offsets.shape(),
                [grid.height, grid.width, 2]
            )));
        }
        let pixels = offsets.as_slice()?.as_chunks::<2>().0;
        // Bits of numbers that are not negative are in their order, and those of NaN beyond all.
        let largest = |row: &[[f32; 2]]| row.iter().flatten().map(|o| o.abs().to_bits()).max();
        let farthest = pixels.par_chunks(grid.width).filter_map(largest).max();
        let farthest = f32::from_bits(farthest.unwrap_or(0));
        if farthest.is_nan() || f64::from(farthest) > MAX_JITTER {
            return Err(PyValueError::new_err("offsets are at most 64 pixels"));
        }
        grid.reach = (farthest * SUBPIXELS as f32).ceil() as i32;
        let snap = |offset: f32| (offset * SUBPIXELS as f32).round_ties_even() as i16;
        let mut offsets = vec![[0; 2]; pixels.len()];
        offsets
            .par_chunks_mut(grid.width)
            .zip(pixels.par_chunks(grid.width))
            .for_each(|(row, pixels)| {
                for (offset, pixel) in row.iter_mut().zip(pixels) {
                    *offset = pixel.map(snap);
                }
            });
        Ok(Places { grid: *grid, offsets })
    }

    /// In subpixels; of a pixel that nobody wants 0.
    #[inline(always)]
    fn offset(&self, pixel: [i32; 2]) -> [i16; 2] {
        let [x, y] = [0, 1].map(|axis| pixel[axis].wrapping_sub(self.grid.first[axis]) as usize);
        if x < self.grid.width && y < self.grid.height {
            self.offsets[y * self.grid.width + x]
        } else {
            [0; 2]
        }
    }

    /// Neighbouring pixels of a row, where they are sampled.
    #[inline(always)]
    pub fn pixels(&self, first: [i32; 2], wanted: [bool; WIDE]) -> Pixels {
        let mut pixels = Pixels::new(first, wanted);
        for l in 0..WIDE {
            let offset = self.offset([first[0] + l as i32, first[1]]);
            pixels.x[l] += f64::from(offset[0]) / f64::from(SUBPIXELS);
            pixels.y[l] += f64::from(offset[1]) / f64::from(SUBPIXELS);
        }
        pixels
    }

    /// Where the pixels of a tile are sampled, block by block, in subpixels from the centre of its first: exact.
    pub fn of_tile(&self, tile: usize, places: &mut [[Block<f32>; 2]; BLOCKS]) {
        let origin = self.grid.origin(tile);
        for (number, [x, y]) in places.iter_mut().enumerate() {
            let corner = [
                number % BLOCKS_ACROSS * BLOCK_WIDTH,
                number / BLOCKS_ACROSS * BLOCK_HEIGHT,
            ];
            for lane in 0..BLOCK_WIDTH * BLOCK_HEIGHT {
                let at = [corner[0] + lane % BLOCK_WIDTH, corner[1] + lane / BLOCK_WIDTH].map(|i| i as i32);
                let offset = self.offset([origin[0] + at[0], origin[1] + at[1]]);
                x.0[lane] = (at[0] * SUBPIXELS + i32::from(offset[0])) as f32;
                y.0[lane] = (at[1] * SUBPIXELS + i32::from(offset[1])) as f32;
            }
        }
    }
}

/// The second dimension of Sobol's (0, 2)-sequence; the first is the number's own bits, reversed.
fn sobol(number: u32) -> u32 {
    let (mut direction, mut value) = (1u32 << 31, 0);
    for bit in 0..32 {
        if number >> bit & 1 == 1 {
            value ^= direction;
        }
        direction ^= direction >> 1;
    }
    value
}

/// Where each pixel of some rows and columns has its sample of this number: offsets from its centre in pixels, (h, w, 2)
/// f32, whole multiples of 1/256. Twin of `addon/core/placement.py`, to the last bit, and of
/// `addon/effects/shared/offsets.glsl`.
///
/// A hash of `seed` and the pixel scrambles Sobol's (0, 2)-sequence as Owen does, for each pixel and axis anew, so
/// that the first 2^n samples of any pixel are strata of the filter, and those between nearly. `quantiles` (2^n,) i16:
/// 1/256 pixels that equal shares of the filter lie about. Raises ValueError on bad input, Cancelled when
/// `cancel` is set.
#[pyfunction]
#[pyo3(signature = (seed, sample, quantiles, rows, columns, cancel=None))]
fn pixel_offsets<'py>(
    py: Python<'py>,
    seed: u32,
    sample: u32,
    quantiles: PyReadonlyArray1<'py, i16>,
    rows: (i32, i32),
    columns: (i32, i32),
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let quantiles = quantiles.as_slice()?;
    if !quantiles.len().is_power_of_two() || quantiles.len() < 2 {
        return Err(PyValueError::new_err("as many quantiles as a power of two"));
    }
    if rows.0 >= rows.1 || columns.0 >= columns.1 {
        return Err(PyValueError::new_err("no rows or no columns"));
    }
    let cancel = CancelFlag::of(cancel);
    let (height, width) = ((rows.1 - rows.0) as usize, (columns.1 - columns.0) as usize);
    let shift = 32 - quantiles.len().trailing_zeros();
    let dimensions = [sample, sobol(sample).reverse_bits()];
    let offsets = py.detach(|| {
        let mut offsets = vec![[0.0f32; 2]; height * width];
        offsets
            .par_chunks_mut(width)
            .zip(rows.0..rows.1)
            .try_for_each(|(row, y)| {
                cancel.check()?;
                for (offset, x) in row.iter_mut().zip(columns.0..) {
                    let key = pcg(pcg(seed ^ x.cast_unsigned()) ^ y.cast_unsigned());
                    let bits = [scrambled(dimensions[0], pcg(key)), scrambled(dimensions[1], key)];
                    let place = |bits: u32| quantiles[(bits.reverse_bits() >> shift) as usize];
                    *offset = bits.map(|bits| f32::from(place(bits)) / SUBPIXELS as f32);
                }
                PyResult::Ok(())
            })?;
        PyResult::Ok(offsets)
    })?;
    PyArray1::from_vec(py, offsets.into_flattened()).reshape([height, width, 2])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(pixel_offsets, module)?)
}
