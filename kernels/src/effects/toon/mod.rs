//! Toon shading: light on a ramp, halftone dots, and outlines by inverted hulls.

mod dots;
mod edges;
mod facing;
mod halftone;
mod hull;
mod outline;
mod ramp;
mod shade;

use crate::cancel::CancelFlag;
use numpy::{Element, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Pixels between two looks at the cancel flag.
const CHUNK: usize = 8192;

/// The values of an image whose first sides are `shape`, after a check that they are.
fn pixels<'a, T: Element, D: numpy::ndarray::Dimension>(
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
fn fill<T: Send, F>(image: &mut [T], cancel: &CancelFlag, fill: F) -> PyResult<()>
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
fn fill_pixels<T: Send, F>(image: &mut [T], width: usize, cancel: &CancelFlag, at: F) -> PyResult<()>
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
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// 0 below 0, 1 above 1, smooth between: 3 x^2 - 2 x^3.
#[inline(always)]
fn smooth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(facing::toon_facing, module)?)?;
    module.add_function(wrap_pyfunction!(shade::toon_shade, module)?)?;
    module.add_function(wrap_pyfunction!(halftone::toon_halftone, module)?)?;
    module.add_function(wrap_pyfunction!(hull::toon_hull, module)?)?;
    module.add_function(wrap_pyfunction!(edges::toon_edges, module)?)?;
    module.add_function(wrap_pyfunction!(outline::toon_outline, module)?)
}
