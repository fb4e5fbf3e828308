//! Layered soft shadow maps: thesis chapter 5, with the bitmask of Schwarz and Stamminger (2007).

mod area;
mod choose;
mod close_casters;
mod doubt;
mod evaluate;
mod fast;
mod finest;
mod interpolate;
mod level;
mod light;
mod open;
mod plain;
mod points;
mod prepare;
mod pyramid;
mod raised;
mod region;
mod spread;
mod tile;
mod window;

use crate::cancel::CancelFlag;
use crate::emitter::Emitter;
use crate::view::View;
use choose::{CloseCasters, Maps};
use evaluate::{Method, Settings};
use level::Bias;
use numpy::{
    IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use points::Points;
use prepare::PreparedMap;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use raised::{Seen, Smooth, raised};
use std::sync::Arc;

/// A layered depth map with its biases, coarser levels and pyramid; made by `soft_shadow_prepare`.
#[pyclass(frozen)]
pub struct PreparedShadowMap {
    map: Arc<PreparedMap>,
}

/// Readies a layered depth map for backprojection. `depths` (layers, height, width) f32, metres,
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
    if stored == 0 || height == 0 || width == 0 || height.max(width) > 1 << 14 {
        return Err(PyValueError::new_err(
            "depths needs at least one layer and sides of 1 to 16384 texels",
        ));
    }
    if !(gradient_scale >= 0.0 && gradient_cap_m >= 0.0) {
        return Err(PyValueError::new_err(
            "gradient_scale and gradient_cap_m cannot be negative",
        ));
    }
    let depths = depths.as_slice()?;
    let cancel = CancelFlag::of(cancel);
    let bias = Bias {
        gradient_scale,
        gradient_cap: gradient_cap_m,
    };
    let map = py.detach(|| PreparedMap::new(depths, [stored, height, width], view, bias, &cancel))?;
    Ok(PreparedShadowMap { map: Arc::new(map) })
}

type Shares<'py> = (Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<u8>>);

/// Visible share V of a light's irradiance at shading points, and where to doubt it.
///
/// `position` (..., 3) f32 metres relative to `eye` (3,) f64 in the world; `geometric_normal` and
/// `shading_normal` (..., 3) f32, unit, facing the viewer; `emitter` (18,) f64; `maps` handles of
/// `soft_shadow_prepare`, smallest window first, none where nothing casts shadow: nested windows of one eye and
/// direction, of which a point reads all, or faces of a cube, of which it reads one. Occluders are read from a
/// map so coarse that about `max_samples` of its texels cover the light; `refinements` times the search region
/// shrinks to the nearest depth inside.
///
/// With `spacing` n > 1, of points that are an image (height, width, 3), every n-th of every n-th row is evaluated by the
/// bitmask, and of the others those that are not interpolated from four alike ones on the same smooth surface.
///
/// `method`: "bitmask"; "plain", the slow model of it, for tests; "area", the thesis's sum of areas, uniform, without
/// horizon, nowhere uncertain, to which the last stored depth only ends the layer before it. `close_casters`, one a map or
/// none: (rows, columns) u8 over its window, not 0 where casters that no map knows may hide a part of the light.
///
/// Returns (visibility f32, uncertain u8), shaped like the points. Points that are not finite get 1. With
/// `leave_uncertain`, points where the maps are not to be believed are uncertain (1) and get 1 without a look, for rays to
/// replace; with `leave_edges` those of them at edges of shadows that are harder than a texel; those that `close_casters` tells of (2)
/// always are.
/// Raises ValueError on bad shapes or values, and Cancelled.
#[pyfunction]
#[pyo3(signature = (position, geometric_normal, shading_normal, eye, emitter, maps, max_samples=512, refinements=1,
    method="bitmask", leave_uncertain=false, leave_edges=false, close_casters=Vec::new(), spacing=1, cancel=None))]
fn soft_shadow_backproject<'py>(
    py: Python<'py>,
    position: PyReadonlyArrayDyn<'py, f32>,
    geometric_normal: PyReadonlyArrayDyn<'py, f32>,
    shading_normal: PyReadonlyArrayDyn<'py, f32>,
    eye: PyReadonlyArray1<'py, f64>,
    emitter: PyReadonlyArray1<'py, f64>,
    maps: Vec<PyRef<'py, PreparedShadowMap>>,
    max_samples: usize,
    refinements: usize,
    method: &str,
    leave_uncertain: bool,
    leave_edges: bool,
    close_casters: Vec<PyReadonlyArray2<'py, u8>>,
    spacing: usize,
    cancel: Option<PyRef<'_, CancelFlag>>,
) -> PyResult<Shares<'py>> {
    let settings = Settings {
        method: match method {
            "bitmask" => Method::Bitmask,
            "plain" => Method::PlainBitmask,
            "area" => Method::Area,
            _ => return Err(PyValueError::new_err("method is bitmask, plain or area")),
        },
        max_samples,
        leave_uncertain,
        leave_edges,
        spacing,
    };
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
    if max_samples == 0 || spacing == 0 {
        return Err(PyValueError::new_err("max_samples and spacing are at least 1"));
    }
    if !(close_casters.is_empty() || close_casters.len() == maps.len())
        || close_casters.iter().any(|cells| cells.len() == 0)
    {
        return Err(PyValueError::new_err(
            "close_casters is one array a map, none of them empty",
        ));
    }
    if settings.method == Method::Area && maps.iter().any(|handle| handle.map.layers < 2) {
        return Err(PyValueError::new_err("area needs maps of at least two layers"));
    }
    let emitter = Emitter::from_packed(emitter.as_slice()?)?;
    let points = Points {
        position: position.as_slice()?.as_chunks::<3>().0,
        geometric_normal: geometric_normal.as_slice()?.as_chunks::<3>().0,
        shading_normal: shading_normal.as_slice()?.as_chunks::<3>().0,
        width: if shape.len() == 3 { shape[1] } else { usize::MAX },
    };
    let table = |cells: &'_ PyReadonlyArray2<'py, u8>| Ok((cells.shape()[1], cells.as_slice()?.to_vec()));
    let close_casters: Vec<(usize, Vec<u8>)> = close_casters.iter().map(table).collect::<PyResult<_>>()?;
    let maps: Vec<Arc<PreparedMap>> = maps.iter().map(|handle| handle.map.clone()).collect();
    let cancel = CancelFlag::of(cancel);
    let (visibility, uncertain) = py.detach(|| {
        let maps: Vec<&PreparedMap> = maps.iter().map(|map| &**map).collect();
        let close_casters = close_casters.iter().map(|(columns, cells)| CloseCasters {
            columns: *columns,
            cells,
        });
        let close_casters: Vec<CloseCasters<'_>> = close_casters.collect();
        let maps = Maps::new(&emitter, &maps, &close_casters, [x, y, z], refinements);
        evaluate::evaluate(&maps, points, settings, &cancel)
    })?;
    let points_shape = &shape[..shape.len() - 1];
    let visibility = visibility.into_pyarray(py).reshape(points_shape)?;
    let uncertain = uncertain.into_pyarray(py).reshape(points_shape)?;
    Ok((visibility.to_dyn().clone(), uncertain.to_dyn().clone()))
}

type Vectors<'py> = Bound<'py, PyArrayDyn<f32>>;

/// Shading points as rays of a light's shadow leave them, near the terminator of smooth surfaces above the triangles:
/// positions and geometric normals, (h, w, 3) f32 each.
///
/// `position` (h, w, 3) f32 metres relative to `eye` (3,) f64 in the world; `geometric_normal` and `shading_normal` (h, w, 3)
/// f32, unit; `lift` (h, w, 3) f32, the surface's `terminator_lift`; `instance` (h, w) i32, and `offsets` (N,) f32 of the
/// instances, the cosine up to which points are raised, 0 for none; `emitter` (18,) f64. Raises ValueError on bad shapes,
/// and Cancelled.
#[pyfunction]
#[pyo3(signature = (position, geometric_normal, shading_normal, lift, instance, offsets, eye, emitter, cancel=None))]
fn soft_shadow_raised<'py>(
    py: Python<'py>,
    position: PyReadonlyArray3<'py, f32>,
    geometric_normal: PyReadonlyArray3<'py, f32>,
    shading_normal: PyReadonlyArray3<'py, f32>,
    lift: PyReadonlyArray3<'py, f32>,
    instance: PyReadonlyArray2<'py, i32>,
    offsets: PyReadonlyArray1<'py, f32>,
    eye: [f64; 3],
    emitter: PyReadonlyArray1<'py, f64>,
    cancel: Option<PyRef<'_, CancelFlag>>,
) -> PyResult<(Vectors<'py>, Vectors<'py>)> {
    let shape = [instance.shape()[0], instance.shape()[1], 3];
    let images = [&position, &geometric_normal, &shading_normal, &lift];
    if images.iter().any(|image| image.shape() != shape) {
        return Err(PyValueError::new_err(
            "position, normals and lift are images of three numbers for each instance's",
        ));
    }
    let light = Seen::new(&Emitter::from_packed(emitter.as_slice()?)?, eye);
    let points = Smooth {
        position: position.as_slice()?.as_chunks::<3>().0,
        geometric_normal: geometric_normal.as_slice()?.as_chunks::<3>().0,
        shading_normal: shading_normal.as_slice()?.as_chunks::<3>().0,
        lift: lift.as_slice()?.as_chunks::<3>().0,
        instance: instance.as_slice()?,
        offsets: offsets.as_slice()?,
    };
    let cancel = CancelFlag::of(cancel);
    let (positions, normals) = py.detach(|| raised(points, &light, &cancel))?;
    let image = |values: Vec<f32>| Ok::<_, PyErr>(values.into_pyarray(py).reshape(shape)?.to_dyn().clone());
    Ok((image(positions)?, image(normals)?))
}

/// How much of a round light some casters hide that its maps do not know, seen from afar and from four radii.
/// `places` (N, 3) f32 on their surfaces, in radii from the light's centre, about a tenth apart at most; `known` (N,) bool;
/// `towards` (C, 3) f32 unit directions from there. Returns (C,) f32, the greater share of the light's disk. Raises
/// ValueError on bad shapes.
#[pyfunction]
fn soft_shadow_unknown_shares<'py>(
    py: Python<'py>,
    places: PyReadonlyArray2<'py, f32>,
    known: PyReadonlyArray1<'py, bool>,
    towards: PyReadonlyArray2<'py, f32>,
) -> PyResult<Bound<'py, PyArray1<f32>>> {
    if places.shape()[1] != 3 || towards.shape()[1] != 3 || places.shape()[0] != known.len() {
        return Err(PyValueError::new_err(
            "places and towards have three numbers a row, known one of each place",
        ));
    }
    let rows =
        |array: &PyReadonlyArray2<'py, f32>| Ok::<_, PyErr>(array.as_slice()?.as_chunks::<3>().0.to_vec());
    let (places, towards, known) = (rows(&places)?, rows(&towards)?, known.as_slice()?.to_vec());
    let shares = py.detach(|| close_casters::unknown_shares(&places, &known, &towards));
    Ok(shares.into_pyarray(py))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PreparedShadowMap>()?;
    module.add_function(wrap_pyfunction!(soft_shadow_prepare, module)?)?;
    module.add_function(wrap_pyfunction!(soft_shadow_unknown_shares, module)?)?;
    module.add_function(wrap_pyfunction!(soft_shadow_raised, module)?)?;
    module.add_function(wrap_pyfunction!(soft_shadow_backproject, module)?)
}
