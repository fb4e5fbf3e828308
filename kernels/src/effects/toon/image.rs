//! Images from Python, checked and filled in parallel.

use crate::cancel::CancelFlag;
use numpy::{Element, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Pixels between two looks at the cancel flag.
pub const CHUNK: usize = 8192;

/// The values of an image whose first sides are `shape`, after a check that they are.
pub fn pixels<'a, T: Element, D: numpy::ndarray::Dimension>(
    image: &'a PyReadonlyArray<'_, T, D>,
    shape: &[usize],
    what: &str,
) -> PyResult<&'a [T]> {
    if image.shape() != shape {
        return Err(PyValueError::new_err(format!(
            "{what} is {:?}, not {shape:?}",
            image.shape()
        )));
    }
    Ok(image.as_slice()?)
}

/// Fills an image a piece at a time: `fill(first pixel, piece)`.
pub fn fill<T: Send, F>(image: &mut [T], cancel: &CancelFlag, fill: F) -> PyResult<()>
where
    F: Fn(usize, &mut [T]) + Sync,
{
    image
        .par_chunks_mut(CHUNK)
        .enumerate()
        .try_for_each(|(index, piece)| {
            cancel.check()?;
            fill(index * CHUNK, piece);
            Ok(())
        })
}

/// Fills an image some rows at a time, pixel by pixel: `at(column, row, pixel, value)`.
pub fn fill_pixels<T: Send, F>(image: &mut [T], width: usize, cancel: &CancelFlag, at: F) -> PyResult<()>
where
    F: Fn(usize, usize, usize, &mut T) + Sync,
{
    let rows = CHUNK.div_ceil(width.max(1));
    image
        .par_chunks_mut(rows * width.max(1))
        .enumerate()
        .try_for_each(|(index, piece)| {
            cancel.check()?;
            for (row, values) in (index * rows..).zip(piece.chunks_mut(width)) {
                for (column, value) in values.iter_mut().enumerate() {
                    at(column, row, row * width + column, value);
                }
            }
            Ok(())
        })
}

#[inline(always)]
pub fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// 0 below 0, 1 above 1, smooth between: 3 x^2 - 2 x^3.
#[inline(always)]
pub fn smooth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
