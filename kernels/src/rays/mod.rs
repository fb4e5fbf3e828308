//! Rays against the scene's triangles. On the CPU only: the GPU has no tree.
//!
//! Visibility is by the geometry: a direction at or below the geometric horizon of a shading point is in
//! shadow without a ray. All entries work on arrays, sixteen rays at a time, chunks of them on all threads.

#![allow(clippy::needless_range_loop)] // a lane is the same index in several arrays

mod bvh;
pub mod lanes;
mod packet;
mod pattern;
mod scene;
mod triangle;
mod visibility;

use crate::cancel::CancelFlag;
use crate::emitter::Emitter;
use crate::geometry::Geometry;
use bvh::Nearest;
use lanes::{LANES, Work, dispatch};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use packet::{HIT, IDLE, Packet};
use pattern::Pattern;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use scene::{Scene, Scratch};
use std::sync::Arc;
use visibility::{Points, Query, Screen, Visibility};

/// Rays or points that one task handles between two looks at the cancel flag.
const CHUNK: usize = 512;
/// Of the light's samples, as many candidates to draw one from; see [`ray_screen`].
const CANDIDATES: usize = 64;

type Floats<'py> = Bound<'py, PyArray1<f32>>;
type Integers<'py> = Bound<'py, PyArray1<i32>>;
type Flag<'py> = Option<PyRef<'py, CancelFlag>>;

fn triples<'a>(array: &'a PyReadonlyArray2<'_, f32>, rows: usize, what: &str) -> PyResult<&'a [[f32; 3]]> {
    let slice = array.as_slice()?;
    if slice.len() != 3 * rows || array.as_array().ncols() != 3 {
        return Err(PyValueError::new_err(format!(
            "{what} is ({rows}, 3), not this shape"
        )));
    }
    Ok(slice.as_chunks::<3>().0)
}

fn three(values: &PyReadonlyArray1<'_, f64>, what: &str) -> PyResult<[f64; 3]> {
    match *values.as_slice()? {
        [x, y, z] if x.is_finite() && y.is_finite() && z.is_finite() => Ok([x, y, z]),
        _ => Err(PyValueError::new_err(format!("{what} is three finite numbers"))),
    }
}

fn bytes<'a>(casters: &'a Option<PyReadonlyArray1<'_, u8>>, instances: usize) -> PyResult<&'a [u8]> {
    match casters {
        None => Ok(&[]),
        Some(array) if array.len()? == instances => Ok(array.as_slice()?),
        Some(_) => Err(PyValueError::new_err(format!(
            "casters has one entry for each of the {instances} instances"
        ))),
    }
}

/// Geometry prepared for rays. While it lives, its geometry cannot change.
#[pyclass(frozen)]
pub struct Accel {
    scene: Arc<Scene>,
}

/// Rays of a chunk, to be traced one packet after the other.
struct Rays<'a, const NEAREST: bool> {
    scene: &'a Scene,
    casters: &'a [u8],
    origins: &'a [[f32; 3]],
    directions: &'a [[f32; 3]],
    t_max: &'a [f32],
    /// Called with the first ray's index, the traced packet and its nearest hits.
    done: &'a mut dyn FnMut(usize, &Packet, &Nearest),
}

impl<const NEAREST: bool> Work for Rays<'_, NEAREST> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut scratch = Scratch::default();
        for first in (0..self.origins.len()).step_by(LANES) {
            let mut packet = Packet::EMPTY;
            let mut nearest = Nearest::NONE;
            let rays = first..(first + LANES).min(self.origins.len());
            let mut shared = true;
            for (lane, ray) in rays.enumerate() {
                let (origin, direction) = (self.origins[ray], self.directions[ray]);
                let finite = origin
                    .iter()
                    .chain(&direction)
                    .fold(true, |f, x| f & x.is_finite());
                let traced = finite && self.t_max[ray] > 0.0;
                shared &= origin == self.origins[first];
                if finite {
                    let t_max = if traced {
                        self.t_max[ray].min(f32::MAX)
                    } else {
                        IDLE
                    };
                    packet.set(lane, origin, direction, t_max);
                }
            }
            packet.prepare();
            if shared {
                let (c, s) = (self.casters, &mut scratch);
                self.scene.trace::<true, NEAREST>(c, &mut packet, s, &mut nearest);
            } else {
                let (c, s) = (self.casters, &mut scratch);
                self.scene
                    .trace::<false, NEAREST>(c, &mut packet, s, &mut nearest);
            }
            (self.done)(first, &packet, &nearest);
        }
    }
}

/// Runs `work` on each index of chunks in parallel, until the flag is raised.
fn in_parallel<T: Send>(
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

#[pymethods]
impl Accel {
    /// Builds the tree. `origin` (3,) f64: the point in the world that rays are relative to, best the camera's
    /// eye; `casters` (instances,) u8: zero leaves an instance out; None: all are in.
    ///
    /// Triangles without area or farther than 1e12 m and instances with a singular matrix are left out.
    #[new]
    #[pyo3(signature = (geometry, origin, casters=None))]
    fn new(
        py: Python<'_>,
        geometry: PyRef<'_, Geometry>,
        origin: PyReadonlyArray1<'_, f64>,
        casters: Option<PyReadonlyArray1<'_, u8>>,
    ) -> PyResult<Self> {
        let data = geometry.data();
        let casters = bytes(&casters, data.instances.len())?;
        let origin = three(&origin, "origin")?;
        let scene = py
            .detach(|| Scene::build(data, origin, casters))
            .map_err(PyValueError::new_err)?;
        Ok(Accel {
            scene: Arc::new(scene),
        })
    }

    /// Triangles in the trees; a mesh that was not copied for each of its instances counts once.
    fn triangle_count(&self) -> usize {
        self.scene.triangle_count()
    }

    /// Instances that refer to a shared tree instead of being copied into the flat one.
    fn instanced_count(&self) -> usize {
        self.scene.placed_count()
    }

    /// Whether something lies between the ends of each segment: (N,) bool. `origins` (N, 3) f32 relative to
    /// `origin`; `directions` (N, 3) f32 of any length; `t_max` (N,) f32 in lengths of the direction, infinity
    /// allowed. `casters` (instances,) u8: zero lets light through; None: all stop it. A ray that is not finite
    /// is free. A surface that the origin lies in, up to rounding, does not stop the ray. Sixteen consecutive
    /// rays of one origin are fastest. Raises Cancelled.
    #[pyo3(signature = (casters, origins, directions, t_max, cancel=None))]
    fn occluded<'py>(
        &self,
        py: Python<'py>,
        casters: Option<PyReadonlyArray1<'py, u8>>,
        origins: PyReadonlyArray2<'py, f32>,
        directions: PyReadonlyArray2<'py, f32>,
        t_max: PyReadonlyArray1<'py, f32>,
        cancel: Flag<'py>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let scene = &self.scene;
        let t_max = t_max.as_slice()?;
        let casters = bytes(&casters, scene.data.instances.len())?;
        let origins = triples(&origins, t_max.len(), "origins")?;
        let directions = triples(&directions, t_max.len(), "directions")?;
        let cancel = cancel.map(|c| c.clone());
        let result = py.detach(|| {
            let mut result = vec![false; t_max.len()];
            in_parallel(result.par_chunks_mut(CHUNK), &cancel, |chunk, result| {
                let range = chunk * CHUNK..chunk * CHUNK + result.len();
                dispatch(Rays::<false> {
                    scene,
                    casters,
                    origins: &origins[range.clone()],
                    directions: &directions[range.clone()],
                    t_max: &t_max[range],
                    done: &mut |first, packet, _| {
                        for (lane, result) in result[first..].iter_mut().take(LANES).enumerate() {
                            *result = packet.t_max[lane] == HIT;
                        }
                    },
                });
            })?;
            PyResult::Ok(result)
        })?;
        Ok(result.into_pyarray(py))
    }

    /// The nearest hit of each ray: t (N,) f32, infinity for none, instance (N,) i32 and triangle (N,) i32, -1 for
    /// none. Arguments as for `occluded`.
    #[pyo3(signature = (casters, origins, directions, t_max, cancel=None))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        casters: Option<PyReadonlyArray1<'py, u8>>,
        origins: PyReadonlyArray2<'py, f32>,
        directions: PyReadonlyArray2<'py, f32>,
        t_max: PyReadonlyArray1<'py, f32>,
        cancel: Flag<'py>,
    ) -> PyResult<(Floats<'py>, Integers<'py>, Integers<'py>)> {
        let scene = &self.scene;
        let t_max = t_max.as_slice()?;
        let casters = bytes(&casters, scene.data.instances.len())?;
        let origins = triples(&origins, t_max.len(), "origins")?;
        let directions = triples(&directions, t_max.len(), "directions")?;
        let cancel = cancel.map(|c| c.clone());
        let hits = py.detach(|| {
            let mut hits = vec![(f32::INFINITY, -1, -1); t_max.len()];
            in_parallel(hits.par_chunks_mut(CHUNK), &cancel, |chunk, hits| {
                let range = chunk * CHUNK..chunk * CHUNK + hits.len();
                dispatch(Rays::<true> {
                    scene,
                    casters,
                    origins: &origins[range.clone()],
                    directions: &directions[range.clone()],
                    t_max: &t_max[range],
                    done: &mut |first, packet, nearest| {
                        for (lane, hit) in hits[first..].iter_mut().take(LANES).enumerate() {
                            if nearest.instance[lane] != u32::MAX {
                                let ids = (nearest.instance[lane] as i32, nearest.triangle[lane] as i32);
                                *hit = (packet.t_max[lane], ids.0, ids.1);
                            }
                        }
                    },
                });
            })?;
            PyResult::Ok(hits)
        })?;
        let column = |f: fn(&(f32, i32, i32)) -> i32| hits.iter().map(f).collect::<Vec<i32>>();
        let (instances, triangles) = (column(|h| h.1), column(|h| h.2));
        let t: Vec<f32> = hits.iter().map(|h| h.0).collect();
        Ok((
            t.into_pyarray(py),
            instances.into_pyarray(py),
            triangles.into_pyarray(py),
        ))
    }
}

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
        samples: usize,
        seed: u64,
    ) -> PyResult<Self> {
        let count = position.as_array().nrows();
        if !(1..=4096).contains(&samples) {
            return Err(PyValueError::new_err("samples is 1 to 4096"));
        }
        Ok(Request {
            casters: bytes(casters, accel.scene.data.instances.len())?,
            emitter: Emitter::from_packed(emitter.as_slice()?)?,
            eye: three(eye, "eye")?,
            positions: triples(position, count, "position")?,
            geometric_normals: triples(geometric_normal, count, "geometric_normal")?,
            shading_normals: triples(shading_normal, count, "shading_normal")?,
            pattern: Pattern::new(samples, seed),
            seed,
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
            positions: &self.positions[range.clone()],
            geometric_normals: &self.geometric_normals[range.clone()],
            shading_normals: &self.shading_normals[range],
        }
    }
}

/// Soft shadow by `samples` rays a point, well-spread light samples weighted by what they would bring: returns
/// visibility (N,) f32, 1 where no light could arrive, and weight (N,) f32, the unshadowed irradiance at radiance 1.
///
/// `casters` (instances,) u8 or None; `emitter` (18,) f64 packed; `eye` (3,) f64, the world position that `position`
/// (N, 3) f32 is relative to; `geometric_normal` and `shading_normal` (N, 3) f32, unit. A position that is not finite
/// (a miss) gives 1 and 0. The same `seed` gives the same bits; a point's index is part of its hash. Raises Cancelled.
#[pyfunction]
#[pyo3(signature = (accel, casters, emitter, eye, position, geometric_normal, shading_normal, samples, seed, cancel=None))]
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
    cancel: Flag<'py>,
) -> PyResult<(Floats<'py>, Floats<'py>)> {
    let request = Request::new(
        &accel,
        &casters,
        &emitter,
        &eye,
        &position,
        &geometric_normal,
        &shading_normal,
        samples,
        seed,
    )?;
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
/// and no more than such a ratio over 64 samples is: below 1e-3 in tests/test_rays.py. Arguments as for `ray_visibility`.
#[pyfunction]
#[pyo3(signature = (accel, casters, emitter, eye, position, geometric_normal, shading_normal, seed, cancel=None))]
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
        CANDIDATES,
        seed,
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
    module.add_function(wrap_pyfunction!(ray_screen, module)?)
}
