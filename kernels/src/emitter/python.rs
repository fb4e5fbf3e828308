//! Samples of a light from Python, for tests.

use super::sample::Samples;
use super::shape::Emitter;
use crate::simd::LANES;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Floats<'py> = Bound<'py, PyArray1<f32>>;

/// Directions, distances and weights of samples of a packed emitter, one a row: `points` (N, 3) f64 in world
/// space, `normals` (N, 3) f32 shading normals, `u` and `v` (N,) f32 in (0, 1). Returns (N, 3), (N,), (N,) f32.
#[pyfunction]
fn sample_emitter<'py>(
    py: Python<'py>,
    emitter: PyReadonlyArray1<'py, f64>,
    points: PyReadonlyArray2<'py, f64>,
    normals: PyReadonlyArray2<'py, f32>,
    u: PyReadonlyArray1<'py, f32>,
    v: PyReadonlyArray1<'py, f32>,
) -> PyResult<(Bound<'py, PyArray2<f32>>, Floats<'py>, Floats<'py>)> {
    let emitter = Emitter::from_packed(emitter.as_slice()?)?;
    let (points, normals) = (
        points.as_slice()?.as_chunks::<3>().0,
        normals.as_slice()?.as_chunks::<3>().0,
    );
    let (u, v) = (u.as_slice()?, v.as_slice()?);
    let count = points.len();
    if [normals.len(), u.len(), v.len()] != [count; 3] {
        return Err(PyValueError::new_err(
            "points, normals, u and v have as many rows",
        ));
    }
    let (mut directions, mut distances, mut weights) = (vec![], vec![], vec![]);
    let mut samples = Samples::default();
    for i in 0..count {
        let seen = emitter.seen_from(points[i]);
        seen.sample(normals[i], &[u[i]; LANES], &[v[i]; LANES], &mut samples);
        directions.extend(samples.direction.map(|d| d[0]));
        distances.push(samples.distance[0]);
        weights.push(samples.weight[0]);
    }
    Ok((
        directions.into_pyarray(py).reshape([count, 3])?,
        distances.into_pyarray(py),
        weights.into_pyarray(py),
    ))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(sample_emitter, module)?)
}
