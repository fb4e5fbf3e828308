//! How much a surface faces the lights: what the ramp is looked up with.

use super::image::{CHUNK, dot, fill, pixels, smooth};
use crate::cancel::CancelFlag;
use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Numbers that describe a light (`addon/effects/toon/lights.py`).
const LIGHT: usize = 12;
const AREA: f32 = 1.0;
const SUN: f32 = 2.0;

#[derive(Clone, Copy)]
struct Light {
    /// Relative to the eye.
    centre: [f32; 3],
    weight: f32,
    forward: [f32; 3],
    kind: f32,
    cos_cone: f32,
    blend_scale: f32,
    spread_scale: f32,
}

impl Light {
    fn new(v: &[f32]) -> Self {
        Light {
            centre: [v[0], v[1], v[2]],
            weight: v[3],
            forward: [v[4], v[5], v[6]],
            kind: v[7],
            cos_cone: v[8],
            blend_scale: v[9],
            spread_scale: v[10],
        }
    }

    /// What a surface that faces the light would count for, and the share of that which arrives at one that
    /// faces `normal`.
    #[inline(always)]
    fn at(&self, position: [f32; 3], normal: [f32; 3]) -> (f32, f32) {
        if self.kind == SUN {
            return (self.weight, (-dot(self.forward, normal)).max(0.0));
        }
        let to: [f32; 3] = std::array::from_fn(|k| self.centre[k] - position[k]);
        let squared = dot(to, to).max(1e-20);
        let inverse = 1.0 / squared.sqrt();
        let cosine = (dot(to, normal) * inverse).max(0.0);
        let along = -dot(to, self.forward) * inverse;
        let mut shape = smooth((along - self.cos_cone) * self.blend_scale);
        if self.kind == AREA {
            let across = (1.0 - along * along).max(0.0).sqrt();
            shape = along.max(0.0) * (1.0 - across / along.max(1e-6) * self.spread_scale).max(0.0);
        }
        (self.weight / squared, cosine * shape)
    }
}

/// The share of the lights' full strength that surfaces get by facing them, (h, w) f32 in 0 to 1: the sum of weight *
/// cosine * visibility over the sum of weights, each at the point. One lamp alone gives the cosine itself.
///
/// `position` (h, w, 3) f32 relative to the eye, `normal` (h, w, 3) f32, zero where nothing is; `lights` (L, 12) f32:
/// centre relative to the eye, weight, direction it shines in, kind (0 point, 1 area, 2 sun), cosine of the
/// cone, 1 / width of its blend, cotangent of the half spread, and one unused. `visibility` (h, w) f32 or None for
/// each light. `instance` (h, w) i32 and `receives` (L, I) u8 leave out lights that do not light an instance.
#[pyfunction]
#[pyo3(signature = (position, normal, lights, visibility, instance=None, receives=None, cancel=None))]
pub fn toon_facing<'py>(
    py: Python<'py>,
    position: PyReadonlyArray3<'py, f32>,
    normal: PyReadonlyArray3<'py, f32>,
    lights: PyReadonlyArray2<'py, f32>,
    visibility: Vec<Option<PyReadonlyArray2<'py, f32>>>,
    instance: Option<PyReadonlyArray2<'py, i32>>,
    receives: Option<PyReadonlyArray2<'py, u8>>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let size = [position.shape()[0], position.shape()[1]];
    let whole = [size[0], size[1], 3];
    let positions = pixels(&position, &whole, "position")?.as_chunks::<3>().0;
    let normals = pixels(&normal, &whole, "normal")?.as_chunks::<3>().0;
    if lights.shape() != [visibility.len(), LIGHT] {
        return Err(PyValueError::new_err(
            "lights has 12 numbers a light, and visibility one entry a light",
        ));
    }
    let lights: Vec<Light> = lights
        .as_slice()?
        .as_chunks::<LIGHT>()
        .0
        .iter()
        .map(|v| Light::new(v))
        .collect();
    let visibility = visibility
        .iter()
        .map(|image| {
            image
                .as_ref()
                .map(|image| pixels(image, &size, "visibility"))
                .transpose()
        })
        .collect::<PyResult<Vec<_>>>()?;
    let linked = match (&instance, &receives) {
        (Some(instance), Some(receives)) => {
            if receives.shape()[0] != lights.len() {
                return Err(PyValueError::new_err("receives has one row a light"));
            }
            Some((
                pixels(instance, &size, "instance")?,
                receives.as_slice()?,
                receives.shape()[1],
            ))
        }
        _ => None,
    };
    let cancel = CancelFlag::of(cancel);
    let mut result = vec![0.0f32; positions.len()];
    py.detach(|| {
        fill(&mut result, &cancel, |first, piece| {
            debug_assert!(piece.len() <= CHUNK);
            for (offset, value) in piece.iter_mut().enumerate() {
                let pixel = first + offset;
                let (p, n) = (positions[pixel], normals[pixel]);
                if n == [0.0; 3] {
                    continue;
                }
                let (mut sum, mut full) = (0.0, 0.0);
                for (index, light) in lights.iter().enumerate() {
                    let (weight, share) = light.at(p, n);
                    let lit = linked.is_none_or(|(instances, receives, count)| {
                        let at = instances[pixel];
                        at >= 0 && (at as usize) < count && receives[index * count + at as usize] != 0
                    });
                    if lit {
                        full += weight;
                        sum += weight * share * visibility[index].map_or(1.0, |image| image[pixel]);
                    }
                }
                *value = if full > 0.0 { (sum / full).min(1.0) } else { 0.0 };
            }
        })
    })?;
    result.into_pyarray(py).reshape(size)
}
