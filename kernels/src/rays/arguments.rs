//! What entries take from Python, checked, and how they share work out.

use crate::cancel::CancelFlag;
use numpy::{Element, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Rays or points that one task handles between two looks at the cancel flag.
pub const CHUNK: usize = 512;
pub type Floats<'py> = Bound<'py, PyArray1<f32>>;
pub type Flag<'py> = Option<PyRef<'py, CancelFlag>>;

pub fn triples<'a, T: Element>(
    array: &'a PyReadonlyArray2<'_, T>,
    rows: usize,
    what: &str,
) -> PyResult<&'a [[T; 3]]> {
    let slice = array.as_slice()?;
    if slice.len() != 3 * rows || array.as_array().ncols() != 3 {
        return Err(PyValueError::new_err(format!(
            "{what} is ({rows}, 3), not this shape"
        )));
    }
    Ok(slice.as_chunks::<3>().0)
}

pub fn quadruples<'a>(
    array: &'a PyReadonlyArray2<'_, f32>,
    rows: usize,
    what: &str,
) -> PyResult<&'a [[f32; 4]]> {
    let slice = array.as_slice()?;
    if slice.len() != 4 * rows || array.as_array().ncols() != 4 {
        return Err(PyValueError::new_err(format!(
            "{what} is ({rows}, 4), not this shape"
        )));
    }
    Ok(slice.as_chunks::<4>().0)
}

pub fn three(values: &PyReadonlyArray1<'_, f64>, what: &str) -> PyResult<[f64; 3]> {
    match *values.as_slice()? {
        [x, y, z] if x.is_finite() && y.is_finite() && z.is_finite() => Ok([x, y, z]),
        _ => Err(PyValueError::new_err(format!("{what} is three finite numbers"))),
    }
}

pub fn bytes<'a>(casters: &'a Option<PyReadonlyArray1<'_, u8>>, instances: usize) -> PyResult<&'a [u8]> {
    match casters {
        None => Ok(&[]),
        Some(array) if array.len()? == instances => Ok(array.as_slice()?),
        Some(_) => Err(PyValueError::new_err(format!(
            "casters has one entry for each of the {instances} instances"
        ))),
    }
}

/// Runs `work` on each index of chunks in parallel, until the flag is raised.
pub fn in_parallel<T: Send>(
    chunks: impl IndexedParallelIterator<Item = T>,
    cancel: &Option<CancelFlag>,
    work: impl Fn(usize, T) + Sync,
) -> PyResult<()> {
    chunks.enumerate().for_each(|(index, chunk)| {
        if !cancel.as_ref().is_some_and(CancelFlag::is_set) {
            work(index, chunk);
        }
    });
    cancel.as_ref().map_or(Ok(()), CancelFlag::check)
}
