//! Whether points see a place, a ray each: hard shadows, without a map.

use super::accel::{Accel, Rays};
use super::arguments::{CHUNK, Flag, bytes, in_parallel, three};
use super::lift::Lift;
use crate::simd::{LANES, dispatch};
use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// How much the points of an image see of a place, (h, w) f32, 1 or 0 or what gets through between: one ray each, and
/// none where the answer does not matter, that is 1 where `shading_normal` looks away from it; 0 where `geometric_normal` does
/// and no ray begins above the surface.
///
/// `place` (3,) f64 metres, relative to the eye that `accel` is relative to, or a unit direction if it `is_distant`;
/// `position`, `geometric_normal` and `shading_normal` (h, w, 3) f32, a normal is 0 where nothing is; `casters`
/// (instances,) u8 or None; `lifts` (h, w, 4) f32 or None, as `ray_visibility` has them. Raises ValueError on bad input,
/// Cancelled when `cancel` is set.
#[pyfunction]
#[pyo3(signature = (accel, casters, place, is_distant, position, geometric_normal, shading_normal, lifts=None,
    cancel=None))]
pub fn rays_towards<'py>(
    py: Python<'py>,
    accel: PyRef<'py, Accel>,
    casters: Option<PyReadonlyArray1<'py, u8>>,
    place: PyReadonlyArray1<'py, f64>,
    is_distant: bool,
    position: PyReadonlyArray3<'py, f32>,
    geometric_normal: PyReadonlyArray3<'py, f32>,
    shading_normal: PyReadonlyArray3<'py, f32>,
    lifts: Option<PyReadonlyArray3<'py, f32>>,
    cancel: Flag<'py>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let shape = [position.shape()[0], position.shape()[1], 3];
    let images = [&position, &geometric_normal, &shading_normal];
    if images.iter().any(|image| image.shape() != shape) {
        return Err(PyValueError::new_err(
            "position and normals are three images of one size",
        ));
    }
    if lifts
        .as_ref()
        .is_some_and(|lifts| lifts.shape() != [shape[0], shape[1], 4])
    {
        return Err(PyValueError::new_err(
            "lifts are an image of four numbers a pixel, of the same size",
        ));
    }
    let lifts = match &lifts {
        Some(lifts) => Some(lifts.as_slice()?.as_chunks::<4>().0),
        None => None,
    };
    let positions = position.as_slice()?.as_chunks::<3>().0;
    let normals = [
        geometric_normal.as_slice()?.as_chunks::<3>().0,
        shading_normal.as_slice()?.as_chunks::<3>().0,
    ];
    let place = three(&place, "place")?.map(|x| x as f32);
    let scene = accel.scene.clone();
    let casters = bytes(&casters, scene.data.instances.len())?;
    let cancel = cancel.map(|c| c.clone());
    let mut result = vec![1.0f32; positions.len()];
    py.detach(|| {
        in_parallel(result.par_chunks_mut(CHUNK), &cancel, |chunk, result| {
            let (mut pixels, mut origins, mut directions) = (Vec::new(), Vec::new(), Vec::new());
            for (pixel, seen) in result.iter_mut().enumerate() {
                let at = chunk * CHUNK + pixel;
                let p = positions[at];
                let towards = if is_distant {
                    place
                } else {
                    std::array::from_fn(|k| place[k] - p[k])
                };
                let [geometric, shading] = normals.map(|normal| dot(normal[at], towards));
                let lift = lifts.and_then(|lifts| Lift::of(lifts[at]));
                if shading > 0.0 && (geometric > 0.0 || lift.is_some()) {
                    let length = dot(towards, towards).sqrt();
                    let way = lift.map_or([0.0; 3], |lift| {
                        let direction = towards.map(|x| x / length);
                        lift.towards(normals[0][at], normals[1][at], direction)
                    });
                    let short = if is_distant { [0.0; 3] } else { way };
                    pixels.push(pixel);
                    origins.push(std::array::from_fn(|k| p[k] + way[k]));
                    directions.push(std::array::from_fn(|k| towards[k] - short[k]));
                } else if shading > 0.0 {
                    *seen = 0.0;
                }
            }
            let t_max = vec![if is_distant { f32::INFINITY } else { 1.0 }; pixels.len()];
            dispatch(Rays::<false> {
                scene: &scene,
                casters,
                origins: &origins,
                directions: &directions,
                t_max: &t_max,
                draws: None,
                done: &mut |first, packet, met| {
                    for (lane, &pixel) in pixels[first..].iter().take(LANES).enumerate() {
                        result[pixel] = met.share(packet, lane);
                    }
                },
            });
        })
    })?;
    result.into_pyarray(py).reshape([shape[0], shape[1]])
}
