//! The toon image: the ramp's colour over the material's.

use super::image::{dot, fill, pixels};
use super::ramp::{Ramp, ramps};
use crate::cancel::CancelFlag;
use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// How the ramp's colour meets the material's.
#[derive(Clone, Copy)]
enum Mix {
    SoftLight,
    Multiply,
    Ramp,
}

/// The ramp of an instance or a material that is not shaded.
const EXCLUDED: i32 = -2;
/// The material decides.
const BY_MATERIAL: i32 = -1;

/// Soft light of `b` over `a`, both in 0 to 1; `b` = 0.5 leaves `a` as it is. (The source prints a minus before
/// its second term, which is negative at b = 0 and does not meet the other branch.)
#[inline(always)]
fn soft_light(a: f32, b: f32) -> f32 {
    let (a, b) = (a.clamp(0.0, 1.0), b.clamp(0.0, 1.0));
    if b <= 0.5 {
        2.0 * a * b + a * a * (1.0 - 2.0 * b)
    } else {
        2.0 * a * (1.0 - b) + a.sqrt() * (2.0 * b - 1.0)
    }
}

impl Mix {
    #[inline(always)]
    fn of(self, base: f32, ramp: f32) -> f32 {
        match self {
            Mix::SoftLight => soft_light(base, 0.5 * ramp),
            Mix::Multiply => base * ramp,
            Mix::Ramp => ramp,
        }
    }
}

/// The material's or the instance's ramp, or EXCLUDED.
#[inline(always)]
fn look(pixel: usize, material: usize, by_instance: Option<(&[i32], &[i32])>, by_material: &[i32]) -> i32 {
    let own = by_instance.map_or(BY_MATERIAL, |(instances, looks)| {
        looks
            .get(instances[pixel] as usize)
            .copied()
            .unwrap_or(BY_MATERIAL)
    });
    if own == BY_MATERIAL || by_material[material] == EXCLUDED {
        by_material[material]
    } else {
        own
    }
}

/// Toon colours, (h, w, 4) f32: alpha 1 and linear RGB on a surface, 0 elsewhere and on what is excluded.
///
/// `light` (h, w) f32 positions on the ramp; `material` (h, w) i32, -1 where nothing is; `materials` (M, 6) f32 base
/// colour and emission; `material_ramps` (M,) i32 index of the ramp or -2 for excluded; `base` (h, w, 4) f32 is base
/// colour by pixel instead. `instance` (h, w) i32 with `instance_ramps` (I,) i32 goes before the material's (-1: the
/// material's counts). `pieces` (P, 17) f32, `piece_starts` (R + 1,) i32, `clamps` (R,) u8: see
/// addon/effects/toon/ramp_table.py.
/// `mix`: 0 soft light, 1 multiply, 2 the ramp alone. `emission` scales what is added after. `rim` (5,) f32: cosine
/// to the viewer below which it begins, strength, colour; it needs `position` and `normal` (h, w, 3) f32, and
/// `forward` (3,) f32 where the view is orthographic.
#[pyfunction]
#[pyo3(signature = (light, material, materials, material_ramps, pieces, piece_starts, clamps, mix, emission, rim,
    base=None, instance=None, instance_ramps=None, position=None, normal=None, forward=None, cancel=None))]
pub fn toon_shade<'py>(
    py: Python<'py>,
    light: PyReadonlyArray2<'py, f32>,
    material: PyReadonlyArray2<'py, i32>,
    materials: PyReadonlyArray2<'py, f32>,
    material_ramps: PyReadonlyArray1<'py, i32>,
    pieces: PyReadonlyArray2<'py, f32>,
    piece_starts: PyReadonlyArray1<'py, i32>,
    clamps: PyReadonlyArray1<'py, u8>,
    mix: u32,
    emission: f32,
    rim: [f32; 5],
    base: Option<PyReadonlyArray3<'py, f32>>,
    instance: Option<PyReadonlyArray2<'py, i32>>,
    instance_ramps: Option<PyReadonlyArray1<'py, i32>>,
    position: Option<PyReadonlyArray3<'py, f32>>,
    normal: Option<PyReadonlyArray3<'py, f32>>,
    forward: Option<[f32; 3]>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let size = [light.shape()[0], light.shape()[1]];
    let lights = pixels(&light, &size, "light")?;
    let found = pixels(&material, &size, "material")?;
    let ramps: Vec<Ramp> = ramps(&pieces, &piece_starts, &clamps)?;
    let by_material = material_ramps.as_slice()?;
    if materials.shape() != [by_material.len(), 6] {
        return Err(PyValueError::new_err("materials has six numbers a material"));
    }
    let table = materials.as_slice()?.as_chunks::<6>().0;
    let bases = base
        .as_ref()
        .map(|image| pixels(image, &[size[0], size[1], 4], "base"))
        .transpose()?
        .map(|image| image.as_chunks::<4>().0);
    let instances = instance
        .as_ref()
        .map(|image| pixels(image, &size, "instance"))
        .transpose()?;
    let instance_looks = instance_ramps
        .as_ref()
        .map(|looks| looks.as_slice())
        .transpose()?;
    let by_instance = instances.zip(instance_looks);
    let known = |&look: &i32| look == EXCLUDED || (0..ramps.len() as i32).contains(&look);
    if !by_material.iter().all(known)
        || !instance_looks
            .unwrap_or(&[])
            .iter()
            .all(|look| *look == BY_MATERIAL || known(look))
    {
        return Err(PyValueError::new_err("a material or an instance names no ramp"));
    }
    let whole = [size[0], size[1], 3];
    let seen = match (&position, &normal) {
        (Some(position), Some(normal)) if rim[1] > 0.0 => Some((
            pixels(position, &whole, "position")?.as_chunks::<3>().0,
            pixels(normal, &whole, "normal")?.as_chunks::<3>().0,
        )),
        _ => None,
    };
    let mix = match mix {
        0 => Mix::SoftLight,
        1 => Mix::Multiply,
        2 => Mix::Ramp,
        other => return Err(PyValueError::new_err(format!("no mix {other}"))),
    };
    let cancel = CancelFlag::of(cancel);
    let mut result = vec![[0.0f32; 4]; lights.len()];
    py.detach(|| {
        fill(&mut result, &cancel, |first, piece| {
            for (offset, value) in piece.iter_mut().enumerate() {
                let pixel = first + offset;
                let Ok(of) = usize::try_from(found[pixel]) else {
                    continue;
                };
                if of >= table.len() {
                    continue;
                }
                let chosen = look(pixel, of, by_instance, by_material);
                if chosen == EXCLUDED {
                    continue;
                }
                let colour = ramps[chosen as usize].at(lights[pixel].clamp(0.0, 1.0));
                let row = &table[of];
                let base: [f32; 3] = bases.map_or([row[0], row[1], row[2]], |images| {
                    [images[pixel][0], images[pixel][1], images[pixel][2]]
                });
                // The ramp's alpha is how much of it there is.
                let share = colour[3];
                let mut rgb: [f32; 3] =
                    std::array::from_fn(|k| base[k] + (mix.of(base[k], colour[k]) - base[k]) * share);
                if let Some((positions, normals)) = &seen {
                    let towards = forward.unwrap_or(positions[pixel]);
                    let cosine = dot(towards, normals[pixel]).abs() / dot(towards, towards).sqrt();
                    if cosine < rim[0] {
                        rgb = std::array::from_fn(|k| rgb[k] + (rim[2 + k] - rgb[k]) * rim[1]);
                    }
                }
                *value = [
                    rgb[0] + row[3] * emission,
                    rgb[1] + row[4] * emission,
                    rgb[2] + row[5] * emission,
                    1.0,
                ];
            }
        })
    })?;
    result
        .into_flattened()
        .into_pyarray(py)
        .reshape([size[0], size[1], 4])
}
