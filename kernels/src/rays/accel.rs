//! Rays from Python: the tree as a class, and its queries.

use super::bvh::Nearest;
use super::lanes::{LANES, Simd, Work, dispatch};
use super::packet::Packet;
use super::scene::{Scene, Scratch};
use super::{CHUNK, Flag, Floats, bytes, in_parallel, three, triples};
use crate::geometry::Geometry;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use std::sync::Arc;

type Integers<'py> = Bound<'py, PyArray1<i32>>;

/// Geometry prepared for rays. While it lives, its geometry cannot change.
#[pyclass(frozen)]
pub struct Accel {
    pub(super) scene: Arc<Scene>,
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
    fn run<S: Simd>(self, simd: S) {
        let mut scratch = Scratch::default();
        for first in (0..self.origins.len()).step_by(LANES) {
            let mut packet = Packet::EMPTY;
            let mut nearest = Nearest::NONE;
            let rays = first..(first + LANES).min(self.origins.len());
            for (lane, ray) in rays.enumerate() {
                let (origin, direction) = (self.origins[ray], self.directions[ray]);
                let finite = origin
                    .iter()
                    .chain(&direction)
                    .fold(true, |f, x| f & x.is_finite());
                if finite && self.t_max[ray] > 0.0 {
                    packet.add(lane, origin, direction, self.t_max[ray].min(f32::MAX));
                }
            }
            packet.prepare();
            let scene = self.scene;
            scene.trace::<S, NEAREST>(simd, self.casters, &mut packet, &mut scratch, &mut nearest);
            (self.done)(first, &packet, &nearest);
        }
    }
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
                            *result = packet.hit >> lane & 1 != 0;
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
