//! Rays against the scene's triangles. On the CPU only: the GPU has no tree.
//!
//! Visibility is by the geometry: a direction at or below the geometric horizon of a shading point is in
//! shadow without a ray, but where rays begin above a smooth surface. All entries work on arrays, sixteen rays at a
//! time, chunks of them on all threads.

#![allow(clippy::needless_range_loop)] // a lane is the same index in several arrays

mod accel;
mod arguments;
mod bvh;
mod clear;
mod leaves;
mod lift;
mod look;
mod packet;
mod pattern;
mod scene;
mod towards;
mod trace;
mod triangle;
mod visibility;

use crate::emitter::Emitter;
use crate::simd::dispatch;
use accel::Accel;
use arguments::{CHUNK, Flag, Floats, bytes, in_parallel, quadruples, three, triples};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pattern::Pattern;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use scene::Scene;
use visibility::{Points, Query, Screen, Visibility};

/// Of the light's samples, as many candidates to draw one from; see [`ray_screen`].
const CANDIDATES: usize = 64;

/// What `ray_visibility` and `ray_screen` have in common, checked.
struct Request<'a> {
    casters: &'a [u8],
    emitter: Emitter,
    eye: [f64; 3],
    positions: &'a [[f32; 3]],
    geometric_normals: &'a [[f32; 3]],
    shading_normals: &'a [[f32; 3]],
    pattern: Pattern,
    seed: u64,
    numbers: Option<&'a [u32]>,
    lifts: Option<&'a [[f32; 4]]>,
}

impl<'a> Request<'a> {
    fn new(
        accel: &Accel,
        casters: &'a Option<PyReadonlyArray1<'_, u8>>,
        emitter: &PyReadonlyArray1<'_, f64>,
        eye: &PyReadonlyArray1<'_, f64>,
        position: &'a PyReadonlyArray2<'_, f32>,
        geometric_normal: &'a PyReadonlyArray2<'_, f32>,
        shading_normal: &'a PyReadonlyArray2<'_, f32>,
        first: u32,
        samples: usize,
        seed: u64,
        lifts: &'a Option<PyReadonlyArray2<'_, f32>>,
    ) -> PyResult<Self> {
        let count = position.as_array().nrows();
        if !(1..=4096).contains(&samples) {
            return Err(PyValueError::new_err("samples is 1 to 4096"));
        }
        if first.checked_add(samples as u32).is_none() {
            return Err(PyValueError::new_err("samples end below number 2^32"));
        }
        Ok(Request {
            casters: bytes(casters, accel.scene.data.instances.len())?,
            emitter: Emitter::from_packed(emitter.as_slice()?)?,
            eye: three(eye, "eye")?,
            positions: triples(position, count, "position")?,
            geometric_normals: triples(geometric_normal, count, "geometric_normal")?,
            shading_normals: triples(shading_normal, count, "shading_normal")?,
            pattern: Pattern::new(first, samples, seed),
            seed,
            numbers: None,
            lifts: match lifts {
                Some(lifts) => Some(quadruples(lifts, count, "lifts")?),
                None => None,
            },
        })
    }

    fn query<'b>(&'b self, scene: &'b Scene) -> Query<'b> {
        Query {
            scene,
            casters: self.casters,
            emitter: &self.emitter,
            eye: self.eye,
            pattern: &self.pattern,
            seed: self.seed,
        }
    }

    fn points(&self, chunk: usize, length: usize) -> Points<'_> {
        let range = chunk * CHUNK..chunk * CHUNK + length;
        Points {
            first: range.start,
            numbers: self.numbers.map(|numbers| &numbers[range.clone()]),
            lifts: self.lifts.map(|lifts| &lifts[range.clone()]),
            positions: &self.positions[range.clone()],
            geometric_normals: &self.geometric_normals[range.clone()],
            shading_normals: &self.shading_normals[range],
        }
    }
}

/// Visibility by `samples` rays a point, to well-spread light samples weighted by what they would bring: returns
/// visibility (N,) f32, 1 where no light could arrive, and weight (N,) f32, the unshadowed irradiance at radiance 1.
///
/// `casters` (instances,) u8 or None; `emitter` (18,) f64 packed; `eye` (3,) f64, the world position that `position`
/// (N, 3) f32 is relative to; `geometric_normal` and `shading_normal` (N, 3) f32, unit. A position that is not finite
/// (a miss) gives 1 and 0. The same `seed` gives the same bits; a point's number is part of its hash: of `numbers` (N,)
/// u32, its index if None. `lifts` (N, 4) f32 or None: near the terminator rays begin so far from the point, metres, which is
/// all of the way from geometric cosines of 0 down and none of it from the fourth number up. `first`: number of the first
/// sample in its point's sequence, so that several calls may go on with one, which is well spread as a whole. Raises Cancelled.
#[pyfunction]
#[pyo3(signature = (accel, casters, emitter, eye, position, geometric_normal, shading_normal, samples, seed, numbers=None,
    lifts=None, first=0, cancel=None))]
fn ray_visibility<'py>(
    py: Python<'py>,
    accel: PyRef<'py, Accel>,
    casters: Option<PyReadonlyArray1<'py, u8>>,
    emitter: PyReadonlyArray1<'py, f64>,
    eye: PyReadonlyArray1<'py, f64>,
    position: PyReadonlyArray2<'py, f32>,
    geometric_normal: PyReadonlyArray2<'py, f32>,
    shading_normal: PyReadonlyArray2<'py, f32>,
    samples: usize,
    seed: u64,
    numbers: Option<PyReadonlyArray1<'py, u32>>,
    lifts: Option<PyReadonlyArray2<'py, f32>>,
    first: u32,
    cancel: Flag<'py>,
) -> PyResult<(Floats<'py>, Floats<'py>)> {
    let mut request = Request::new(
        &accel,
        &casters,
        &emitter,
        &eye,
        &position,
        &geometric_normal,
        &shading_normal,
        first,
        samples,
        seed,
        &lifts,
    )?;
    if let Some(numbers) = &numbers {
        if numbers.len()? != request.positions.len() {
            return Err(PyValueError::new_err("numbers has one for each position"));
        }
        request.numbers = Some(numbers.as_slice()?);
    }
    let scene = accel.scene.clone();
    let cancel = cancel.map(|c| c.clone());
    let (visibility, weight) = py.detach(|| {
        let mut visibility = vec![1.0; request.positions.len()];
        let mut weight = vec![0.0; visibility.len()];
        let chunks = visibility.par_chunks_mut(CHUNK).zip(weight.par_chunks_mut(CHUNK));
        in_parallel(chunks, &cancel, |chunk, (visibility, weight)| {
            dispatch(Visibility {
                query: &request.query(&scene),
                points: request.points(chunk, weight.len()),
                visibility,
                weight,
            });
        })?;
        PyResult::Ok((visibility, weight))
    })?;
    Ok((visibility.into_pyarray(py), weight.into_pyarray(py)))
}

/// Two independent estimates of each point's visibility by one ray each, (N, 2) u8, 0 or 1, whose expectation is
/// V: over many points the mean of (v - b1)(v - b2) is the mean square error of v, free of the estimates' noise.
///
/// Each ray goes to one of 64 well-spread light samples, drawn in proportion to their weights. The expectation is
/// that of a ratio of two sums, so it is biased, but only where visibility and weight go together across the light
/// and no more than such a ratio over 64 samples is: below 1e-3 in tests/kernels/test_rays.py. Arguments as for `ray_visibility`.
#[pyfunction]
#[pyo3(signature = (accel, casters, emitter, eye, position, geometric_normal, shading_normal, seed, lifts=None,
    cancel=None))]
fn ray_screen<'py>(
    py: Python<'py>,
    accel: PyRef<'py, Accel>,
    casters: Option<PyReadonlyArray1<'py, u8>>,
    emitter: PyReadonlyArray1<'py, f64>,
    eye: PyReadonlyArray1<'py, f64>,
    position: PyReadonlyArray2<'py, f32>,
    geometric_normal: PyReadonlyArray2<'py, f32>,
    shading_normal: PyReadonlyArray2<'py, f32>,
    seed: u64,
    lifts: Option<PyReadonlyArray2<'py, f32>>,
    cancel: Flag<'py>,
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let request = Request::new(
        &accel,
        &casters,
        &emitter,
        &eye,
        &position,
        &geometric_normal,
        &shading_normal,
        0,
        CANDIDATES,
        seed,
        &lifts,
    )?;
    let scene = accel.scene.clone();
    let cancel = cancel.map(|c| c.clone());
    let estimates = py.detach(|| {
        let mut estimates = vec![[0u8; 2]; request.positions.len()];
        in_parallel(estimates.par_chunks_mut(CHUNK), &cancel, |chunk, estimates| {
            dispatch(Screen {
                query: &request.query(&scene),
                points: request.points(chunk, estimates.len()),
                estimates,
            });
        })?;
        PyResult::Ok(estimates)
    })?;
    let rows = estimates.len();
    estimates.into_flattened().into_pyarray(py).reshape([rows, 2])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Accel>()?;
    module.add_function(wrap_pyfunction!(ray_visibility, module)?)?;
    module.add_function(wrap_pyfunction!(ray_screen, module)?)?;
    module.add_function(wrap_pyfunction!(towards::rays_towards, module)?)?;
    module.add_function(wrap_pyfunction!(look::rays_surface, module)?)?;
    module.add_function(wrap_pyfunction!(look::chart_surface, module)?)
}
