//! Layered soft shadow maps: thesis chapter 5, with the bitmask of Schwarz and Stamminger (2007).

mod area;
mod doubt;
mod evaluate;
mod fast;
mod light;
mod plain;
mod prepare;
mod region;
mod simd;
mod tile;

use crate::cancel::CancelFlag;
use crate::emitter::Emitter;
use crate::view::View;
use evaluate::{Method, Points, Settings};
use numpy::{
    IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use prepare::{Bias, PreparedMap};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;

/// A layered depth map with its biases, coarser levels and pyramid; made by `soft_shadow_prepare`.
#[pyclass(frozen)]
pub struct PreparedShadowMap {
    map: Arc<PreparedMap>,
}

/// Readies a layered depth map for backprojection. `depths` (layers + 1, height, width) f32, metres,
/// ascending, infinite where empty; `view` (19,) f64 (`View.packed()`). A texel shadows what lies behind it by
/// more than `gradient_scale` times its depth difference to the neighbours, at most `gradient_cap_m`
/// metres. Raises ValueError on bad shapes or values.
#[pyfunction]
#[pyo3(signature = (depths, view, gradient_scale=1.0, gradient_cap_m=f32::INFINITY, cancel=None))]
fn soft_shadow_prepare(
    py: Python<'_>,
    depths: PyReadonlyArray3<'_, f32>,
    view: PyReadonlyArray1<'_, f64>,
    gradient_scale: f32,
    gradient_cap_m: f32,
    cancel: Option<PyRef<'_, CancelFlag>>,
) -> PyResult<PreparedShadowMap> {
    let view = View::from_packed(view.as_slice()?)?;
    let &[stored, height, width] = depths.shape() else {
        unreachable!("three axes by type")
    };
    if stored < 2 || height == 0 || width == 0 || height.max(width) > 1 << 14 {
        return Err(PyValueError::new_err(
            "depths needs at least two layers and sides of 1 to 16384 texels",
        ));
    }
    if !(gradient_scale >= 0.0 && gradient_cap_m >= 0.0) {
        return Err(PyValueError::new_err(
            "gradient_scale and gradient_cap_m cannot be negative",
        ));
    }
    let depths = depths.as_slice()?;
    let cancel = cancel.map(|flag| flag.clone()).unwrap_or_default();
    let bias = Bias {
        gradient_scale,
        gradient_cap: gradient_cap_m,
    };
    let map = py.detach(|| PreparedMap::new(depths, [stored, height, width], view, bias, &cancel))?;
    Ok(PreparedShadowMap { map: Arc::new(map) })
}

type Shares<'py> = (Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<u8>>);

fn run<'py>(
    py: Python<'py>,
    [position, geometric_normal, shading_normal]: [&PyReadonlyArrayDyn<'py, f32>; 3],
    eye: &PyReadonlyArray1<'py, f64>,
    emitter: &PyReadonlyArray1<'py, f64>,
    maps: Vec<PyRef<'py, PreparedShadowMap>>,
    settings: Settings,
    cancel: Option<PyRef<'_, CancelFlag>>,
) -> PyResult<Shares<'py>> {
    let shape = position.shape();
    if shape.last() != Some(&3) {
        return Err(PyValueError::new_err("position has three numbers a point"));
    }
    if geometric_normal.shape() != shape || shading_normal.shape() != shape {
        return Err(PyValueError::new_err("normals are shaped like position"));
    }
    let &[x, y, z] = eye.as_slice()? else {
        return Err(PyValueError::new_err("eye is three numbers"));
    };
    if !(x + y + z).is_finite() {
        return Err(PyValueError::new_err("eye is not finite"));
    }
    if settings.max_samples == 0 {
        return Err(PyValueError::new_err("max_samples is at least 1"));
    }
    let emitter = Emitter::from_packed(emitter.as_slice()?)?;
    let points = Points {
        position: position.as_slice()?.as_chunks::<3>().0,
        geometric_normal: geometric_normal.as_slice()?.as_chunks::<3>().0,
        shading_normal: shading_normal.as_slice()?.as_chunks::<3>().0,
        width: if shape.len() == 3 { shape[1] } else { usize::MAX },
    };
    let maps: Vec<Arc<PreparedMap>> = maps.iter().map(|handle| handle.map.clone()).collect();
    let cancel = cancel.map(|flag| flag.clone()).unwrap_or_default();
    let (visibility, uncertain) = py.detach(|| {
        let maps: Vec<&PreparedMap> = maps.iter().map(|map| &**map).collect();
        evaluate::evaluate(&emitter, &maps, [x, y, z], points, settings, &cancel)
    })?;
    let points_shape = &shape[..shape.len() - 1];
    Ok((
        visibility
            .into_pyarray(py)
            .reshape(points_shape)?
            .to_dyn()
            .clone(),
        uncertain.into_pyarray(py).reshape(points_shape)?.to_dyn().clone(),
    ))
}

/// Visible share V of a light's irradiance at shading points, and where to doubt it.
///
/// `position` (..., 3) f32 metres relative to `eye` (3,) f64 in the world; `geometric_normal` and
/// `shading_normal` (..., 3) f32, unit, facing the viewer; `emitter` (18,) f64; `maps` handles of
/// `soft_shadow_prepare`, smallest window first, none where nothing casts shadow. Occluders are read from a map
/// so coarse that about `max_samples` of its texels cover the light; `refinements` times the search region
/// shrinks to the nearest depth inside. Returns (visibility f32, uncertain u8), shaped like the points.
/// Points that are not finite get 1. With
/// `leave_uncertain`, uncertain points get 1 without a look, for rays to replace. `plain` runs the slow model of the method, for tests.
#[pyfunction]
#[pyo3(signature = (position, geometric_normal, shading_normal, eye, emitter, maps, max_samples=512, refinements=2,
    leave_uncertain=false, cancel=None, plain=false))]
fn soft_shadow_bitmask<'py>(
    py: Python<'py>,
    position: PyReadonlyArrayDyn<'py, f32>,
    geometric_normal: PyReadonlyArrayDyn<'py, f32>,
    shading_normal: PyReadonlyArrayDyn<'py, f32>,
    eye: PyReadonlyArray1<'py, f64>,
    emitter: PyReadonlyArray1<'py, f64>,
    maps: Vec<PyRef<'py, PreparedShadowMap>>,
    max_samples: usize,
    refinements: usize,
    leave_uncertain: bool,
    cancel: Option<PyRef<'_, CancelFlag>>,
    plain: bool,
) -> PyResult<Shares<'py>> {
    let settings = Settings {
        method: if plain {
            Method::PlainBitmask
        } else {
            Method::Bitmask
        },
        max_samples,
        refinements,
        leave_uncertain,
    };
    let surface = [&position, &geometric_normal, &shading_normal];
    run(py, surface, &eye, &emitter, maps, settings, cancel)
}

/// Visible share of a light by the thesis's sum of areas: uniform, without horizon. Arguments as
/// `soft_shadow_bitmask`, whose pair it returns; it is nowhere uncertain. The last stored depth only ends the
/// layer before it.
#[pyfunction]
#[pyo3(signature = (position, geometric_normal, shading_normal, eye, emitter, maps, max_samples=512, refinements=2,
    cancel=None))]
fn soft_shadow_area<'py>(
    py: Python<'py>,
    position: PyReadonlyArrayDyn<'py, f32>,
    geometric_normal: PyReadonlyArrayDyn<'py, f32>,
    shading_normal: PyReadonlyArrayDyn<'py, f32>,
    eye: PyReadonlyArray1<'py, f64>,
    emitter: PyReadonlyArray1<'py, f64>,
    maps: Vec<PyRef<'py, PreparedShadowMap>>,
    max_samples: usize,
    refinements: usize,
    cancel: Option<PyRef<'_, CancelFlag>>,
) -> PyResult<Shares<'py>> {
    let settings = Settings {
        method: Method::Area,
        max_samples,
        refinements,
        leave_uncertain: false,
    };
    let surface = [&position, &geometric_normal, &shading_normal];
    run(py, surface, &eye, &emitter, maps, settings, cancel)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PreparedShadowMap>()?;
    module.add_function(wrap_pyfunction!(soft_shadow_prepare, module)?)?;
    module.add_function(wrap_pyfunction!(soft_shadow_bitmask, module)?)?;
    module.add_function(wrap_pyfunction!(soft_shadow_area, module)?)
}
