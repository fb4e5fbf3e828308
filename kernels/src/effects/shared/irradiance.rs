//! What a light would send to shading points if nothing cast a shadow: for pictures of the whole.

use crate::cancel::CancelFlag;
use crate::emitter::{Emitter, EmitterKind, Samples, on_disk};
use crate::simd::{LANES, Lanes, Simd, Work, dispatch};
use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Points between two looks at the cancel flag.
const CHUNK: usize = 4096;

struct Chunk<'a> {
    emitter: &'a Emitter,
    eye: [f64; 3],
    positions: &'a [[f32; 3]],
    normals: &'a [[f32; 3]],
    irradiance: &'a mut [f32],
}

impl Work for Chunk<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        // One sample in each cell of a 4 x 4 grid.
        let u: Lanes = std::array::from_fn(|lane| ((lane % 4) as f32 + 0.5) / 4.0);
        let v: Lanes = std::array::from_fn(|lane| ((lane / 4) as f32 + 0.5) / 4.0);
        let disk = on_disk(&u, &v);
        let count = if self.emitter.is_single() { 1 } else { LANES };
        let mut samples = Samples::default();
        // Of what is infinitely far away, all but the normal is the same for all points.
        let is_far = self.emitter.kind == EmitterKind::DistantDisk;
        let mut seen = self.emitter.seen_from(self.eye);
        seen.aim(&u, &v, &disk, &mut samples);
        let far_weight = samples.weight;
        for (index, result) in self.irradiance.iter_mut().enumerate() {
            let position = self.positions[index];
            let normal = self.normals[index];
            if normal == [0.0; 3] || position.iter().any(|x| !x.is_finite()) {
                continue;
            }
            let at = |axis: usize| self.eye[axis] + f64::from(position[axis]);
            let world = [at(0), at(1), at(2)];
            if self.emitter.surely_misses(world, normal) {
                continue;
            }
            if is_far {
                samples.weight = far_weight;
            } else {
                seen = self.emitter.seen_from(world);
                seen.aim(&u, &v, &disk, &mut samples);
            }
            seen.face(normal, &mut samples);
            *result = samples.weight[..count].iter().sum::<f32>() / count as f32;
        }
    }
}

/// Unshadowed irradiance of points (h, w, 3) f32 relative to `eye` with shading normals (h, w, 3), per unit of
/// radiance (per unit of intensity for an emitter of no size): (h, w) f32. Misses have none.
#[pyfunction]
#[pyo3(signature = (position, shading_normal, eye, emitter, cancel=None))]
fn irradiance<'py>(
    py: Python<'py>,
    position: PyReadonlyArray3<'py, f32>,
    shading_normal: PyReadonlyArray3<'py, f32>,
    eye: [f64; 3],
    emitter: PyReadonlyArray1<'py, f64>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let emitter = Emitter::from_packed(emitter.as_slice()?)?;
    let shape = position.shape();
    if shape[2] != 3 || shading_normal.shape() != shape {
        return Err(PyValueError::new_err(
            "position and shading_normal are (h, w, 3), the same for both",
        ));
    }
    let size = [shape[0], shape[1]];
    let positions = position.as_slice()?.as_chunks::<3>().0;
    let normals = shading_normal.as_slice()?.as_chunks::<3>().0;
    let cancel = CancelFlag::of(cancel);
    let mut result = vec![0.0; positions.len()];
    py.detach(|| {
        result
            .par_chunks_mut(CHUNK)
            .zip(positions.par_chunks(CHUNK))
            .zip(normals.par_chunks(CHUNK))
            .try_for_each(|((irradiance, positions), normals)| {
                cancel.check()?;
                dispatch(Chunk {
                    emitter: &emitter,
                    eye,
                    positions,
                    normals,
                    irradiance,
                });
                PyResult::Ok(())
            })
    })?;
    result.into_pyarray(py).reshape(size)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(irradiance, module)?)
}
