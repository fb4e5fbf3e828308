//! Rays from Python: the tree as a class, and its queries.

use super::arguments::{CHUNK, Flag, Floats, bytes, in_parallel, three, triples};
use super::bvh::Met;
use super::packet::Packet;
use super::scene::Scene;
use super::trace::Scratch;
use crate::geometry::Geometry;
use crate::random::Draw;
use crate::simd::{LANES, Simd, Work, dispatch};
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
pub(super) struct Rays<'a, const NEAREST: bool> {
    pub(super) scene: &'a Scene,
    pub(super) casters: &'a [u8],
    pub(super) origins: &'a [[f32; 3]],
    pub(super) directions: &'a [[f32; 3]],
    pub(super) t_max: &'a [f32],
    /// How rays that go on to their nearest hit decide whether what is partly opaque is there: seed, sample and pixel;
    /// None: each by itself.
    pub(super) draws: Option<&'a [[u32; 4]]>,
    /// Called with the first ray's index, the traced packet and what it met.
    pub(super) done: &'a mut dyn FnMut(usize, &Packet, &Met),
}

impl<const NEAREST: bool> Work for Rays<'_, NEAREST> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let vector = simd.sixteen();
        let mut scratch = Scratch::default();
        for first in (0..self.origins.len()).step_by(LANES) {
            let mut packet = Packet::EMPTY;
            let mut met = Met::NONE;
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
                if NEAREST {
                    let own = direction.map(f32::to_bits);
                    let [seed, sample, x, y] =
                        self.draws.map_or([own[0], 0, own[1], own[2]], |draws| draws[ray]);
                    met.draw[lane] = Draw { seed, sample };
                    met.pixel[lane] = [x.cast_signed(), y.cast_signed()];
                }
            }
            packet.prepare();
            let scene = self.scene;
            scene.trace::<_, NEAREST>(vector, self.casters, &mut packet, &mut scratch, &mut met);
            (self.done)(first, &packet, &met);
        }
    }
}

/// What `transmittance` and `nearest` are asked, checked.
struct Batch<'a> {
    scene: &'a Scene,
    casters: &'a [u8],
    origins: &'a [[f32; 3]],
    directions: &'a [[f32; 3]],
    t_max: &'a [f32],
}

impl<'a> Batch<'a> {
    fn new(
        scene: &'a Scene,
        casters: &'a Option<PyReadonlyArray1<'_, u8>>,
        origins: &'a PyReadonlyArray2<'_, f32>,
        directions: &'a PyReadonlyArray2<'_, f32>,
        t_max: &'a PyReadonlyArray1<'_, f32>,
    ) -> PyResult<Self> {
        let t_max = t_max.as_slice()?;
        Ok(Batch {
            scene,
            casters: bytes(casters, scene.data.instances.len())?,
            origins: triples(origins, t_max.len(), "origins")?,
            directions: triples(directions, t_max.len(), "directions")?,
            t_max,
        })
    }

    /// `length` rays of a chunk.
    fn chunk<'b, const NEAREST: bool>(
        &'b self,
        chunk: usize,
        length: usize,
        done: &'b mut dyn FnMut(usize, &Packet, &Met),
    ) -> Rays<'b, NEAREST> {
        let range = chunk * CHUNK..chunk * CHUNK + length;
        Rays {
            scene: self.scene,
            casters: self.casters,
            origins: &self.origins[range.clone()],
            directions: &self.directions[range.clone()],
            t_max: &self.t_max[range],
            draws: None,
            done,
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

    /// How much gets through between the ends of each segment: (N,) f32, 0 where something opaque lies there and the
    /// product of 1 - opacity of what is partly so; less than 1e-4 is 0. `origins` (N, 3) f32 relative to `origin`;
    /// `directions` (N, 3) f32 of any length; `t_max` (N,) f32 in lengths of the direction, infinity allowed. `casters`
    /// (instances,) u8: zero lets light through; None: all stop it. A ray that is not finite is free. A surface that
    /// the origin lies in, up to rounding, does not stop the ray. Sixteen consecutive rays of one origin are fastest.
    /// Raises Cancelled.
    #[pyo3(signature = (casters, origins, directions, t_max, cancel=None))]
    fn transmittance<'py>(
        &self,
        py: Python<'py>,
        casters: Option<PyReadonlyArray1<'py, u8>>,
        origins: PyReadonlyArray2<'py, f32>,
        directions: PyReadonlyArray2<'py, f32>,
        t_max: PyReadonlyArray1<'py, f32>,
        cancel: Flag<'py>,
    ) -> PyResult<Floats<'py>> {
        let scene = &self.scene;
        let batch = Batch::new(scene, &casters, &origins, &directions, &t_max)?;
        let cancel = cancel.map(|c| c.clone());
        let result = py.detach(|| {
            let mut result = vec![1.0; batch.t_max.len()];
            in_parallel(result.par_chunks_mut(CHUNK), &cancel, |chunk, result| {
                let length = result.len();
                let done = &mut |first: usize, packet: &Packet, met: &Met| {
                    for (lane, result) in result[first..].iter_mut().take(LANES).enumerate() {
                        *result = met.share(packet, lane);
                    }
                };
                dispatch(batch.chunk::<false>(chunk, length, done));
            })?;
            PyResult::Ok(result)
        })?;
        Ok(result.into_pyarray(py))
    }

    /// The nearest hit of each ray: t (N,) f32, infinity for none, instance (N,) i32 and triangle (N,) i32, -1 for
    /// none; what is partly opaque to cameras is there by chance. Arguments as for `transmittance`.
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
        let batch = Batch::new(scene, &casters, &origins, &directions, &t_max)?;
        let cancel = cancel.map(|c| c.clone());
        let hits = py.detach(|| {
            let mut hits = vec![(f32::INFINITY, -1, -1); batch.t_max.len()];
            in_parallel(hits.par_chunks_mut(CHUNK), &cancel, |chunk, hits| {
                let length = hits.len();
                let done = &mut |first: usize, packet: &Packet, met: &Met| {
                    for (lane, hit) in hits[first..].iter_mut().take(LANES).enumerate() {
                        if met.instance[lane] != u32::MAX {
                            let ids = (met.instance[lane] as i32, met.triangle[lane] as i32);
                            *hit = (packet.t_max[lane], ids.0, ids.1);
                        }
                    }
                };
                dispatch(batch.chunk::<true>(chunk, length, done));
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
