//! Light scattered by a homogeneous medium, once: shafts of light, from the stretches of each ray that are lit.

mod evaluate;
mod integral;
mod lanes;
mod map;
mod march;
mod medium;
mod rays;
mod scene;
mod source;
mod spans;
mod table;
mod upsample;

use crate::cancel::CancelFlag;
use crate::view::View;

use map::LightMap;
use medium::Medium;
use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use rays::Lattice;
use scene::{Bounded, Method, Scene};
use source::Source;
use spans::MediumMap;
use std::sync::Arc;
use table::Table;

/// A light's depth map with minima and maxima; made by `light_map`.
#[pyclass(frozen, name = "LightMap")]
pub struct LightMapHandle {
    map: Arc<LightMap>,
}

/// A medium's entries and exits from a light; made by `medium_map`.
#[pyclass(frozen, name = "MediumMap")]
pub struct MediumMapHandle {
    map: Arc<MediumMap>,
}

/// Readies a depth map (1 or more, height, width) f32, metres, infinite where empty, of which the first layer counts;
/// `view` (19,) f64. Raises ValueError on bad shapes.
#[pyfunction]
#[pyo3(signature = (depths, view, cancel=None))]
fn light_map(
    py: Python<'_>,
    depths: PyReadonlyArray3<'_, f32>,
    view: PyReadonlyArray1<'_, f64>,
    cancel: Option<PyRef<'_, CancelFlag>>,
) -> PyResult<LightMapHandle> {
    let view = View::from_packed(view.as_slice()?)?;
    let (height, width) = (depths.shape()[1], depths.shape()[2]);
    let nearest = &depths.as_slice()?[..height * width];
    let cancel = CancelFlag::of(cancel);
    let map = py.detach(|| LightMap::new(view, width, height, nearest, &cancel))?;
    Ok(LightMapHandle { map: Arc::new(map) })
}

/// Readies the depths (layers, height, width) f32 of a medium's surface from a light; `view` (19,) f64.
#[pyfunction]
#[pyo3(signature = (depths, view, cancel=None))]
fn medium_map(
    depths: PyReadonlyArray3<'_, f32>,
    view: PyReadonlyArray1<'_, f64>,
    cancel: Option<PyRef<'_, CancelFlag>>,
) -> PyResult<MediumMapHandle> {
    let view = View::from_packed(view.as_slice()?)?;
    let &[layers, height, width] = depths.shape() else {
        unreachable!("three axes by type")
    };
    let all = depths.as_slice()?.to_vec();
    let map = LightMap::new(
        view,
        width,
        height,
        &all[..height * width],
        &CancelFlag::of(cancel),
    )?;
    let map = MediumMap::new(map, layers, width, height, all);
    Ok(MediumMapHandle { map: Arc::new(map) })
}

/// Light of one source scattered once towards the eye, (h, w, 3) f32: radiance per unit of the source's intensity
/// (W/sr), or of irradiance from a distant one.
///
/// `depth` (h, w) f32 along the view's axis, infinite where nothing is; `lattice` (18,) f64, the rays; `medium` (7,)
/// f64; `source` (13,) f64; `maps` of what casts shadows, whose windows do not overlap, of one point of the source or,
/// as `counts` says, so many of each of several; `spans` (layers, h, w)
/// f32, depths of a bounded medium's surface along the rays, and `medium_maps` the same from the light; without
/// them the medium is everywhere. `order` nodes a panel; `table_reach` metres: by a table of the antiderivative,
/// for sources that shine evenly into a medium that is everywhere; `march_steps`: by a jittered march, for
/// comparison; `offsets` (h, w, 2) f32 of each ray from its place, in steps of the lattice. Raises ValueError on bad input, Cancelled when `cancel` is set.
#[pyfunction]
#[pyo3(signature = (depth, lattice, medium, source, maps, spans=None, medium_maps=Vec::new(), order=6,
    table_reach=None, march_steps=None, counts=None, offsets=None, cancel=None))]
fn airlight<'py>(
    py: Python<'py>,
    depth: PyReadonlyArray2<'py, f32>,
    lattice: PyReadonlyArray1<'py, f64>,
    medium: PyReadonlyArray1<'py, f64>,
    source: PyReadonlyArray1<'py, f64>,
    maps: Vec<PyRef<'py, LightMapHandle>>,
    spans: Option<PyReadonlyArray3<'py, f32>>,
    medium_maps: Vec<PyRef<'py, MediumMapHandle>>,
    order: usize,
    table_reach: Option<f64>,
    march_steps: Option<usize>,
    counts: Option<Vec<usize>>,
    offsets: Option<PyReadonlyArray3<'py, f32>>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (height, width) = (depth.shape()[0], depth.shape()[1]);
    if !(2..=32).contains(&order) || width == 0 {
        return Err(PyValueError::new_err(
            "order is 2 to 32, and an image is not empty",
        ));
    }
    if spans.as_ref().is_some_and(|s| s.shape()[1..] != [height, width]) {
        return Err(PyValueError::new_err(
            "spans are (layers, h, w), h and w as depth has them",
        ));
    }
    if offsets.as_ref().is_some_and(|o| o.shape() != [height, width, 2]) {
        return Err(PyValueError::new_err(
            "offsets are (h, w, 2), h and w as depth has them",
        ));
    }
    let counts = counts.unwrap_or_else(|| vec![maps.len()]);
    if counts.is_empty() || counts.iter().sum::<usize>() != maps.len() {
        return Err(PyValueError::new_err("counts add up to the maps"));
    }
    let lattice = Lattice::from_packed(lattice.as_slice()?)?;
    let medium = Medium::from_packed(medium.as_slice()?)?;
    let source = Source::from_packed(source.as_slice()?)?.within_reach(lattice.eye);
    let maps: Vec<Arc<LightMap>> = maps.iter().map(|handle| handle.map.clone()).collect();
    let medium_maps: Vec<Arc<MediumMap>> = medium_maps.iter().map(|handle| handle.map.clone()).collect();
    let even = !source.distant && source.profile == source::Profile::Uniform && spans.is_none();
    let reach = table_reach.filter(|_| even && !lattice.orthographic);
    let depth = depth.as_slice()?;
    let span_depths = spans.as_ref().map(|s| s.as_slice()).transpose()?;
    let offsets = offsets.as_ref().map(|o| o.as_slice()).transpose()?;
    let layers = spans.as_ref().map_or(0, |s| s.shape()[0]);
    let cancel = CancelFlag::of(cancel);
    let image = py.detach(|| {
        let mut each = maps.iter().map(|map| &**map);
        let scene = Scene {
            lattice,
            offsets: offsets.map(|o| o.as_chunks::<2>().0),
            medium,
            source,
            maps: counts
                .iter()
                .map(|&count| each.by_ref().take(count).collect())
                .collect(),
            bounded: span_depths.map(|depths| Bounded {
                layers,
                depths,
                maps: medium_maps.iter().map(|map| &**map).collect(),
            }),
            method: match (reach, march_steps) {
                (_, Some(steps)) => Method::March(steps.max(1)),
                (Some(reach), None) => Method::Table(Table::new(&medium, &source, lattice.eye, reach)),
                (None, None) => Method::Walk,
            },
            order,
        };
        scene.evaluate(depth, width, &cancel)
    })?;
    image
        .into_flattened()
        .into_pyarray(py)
        .reshape([height, width, 3])
}

/// The same for single rays from `origin` (n, 3) along unit `direction` (n, 3), between `limits` (n, 2) metres, f64,
/// without shadows and in double precision: (n, 3) f64. The medium begins at the origin.
#[pyfunction]
fn airlight_along<'py>(
    py: Python<'py>,
    origin: PyReadonlyArray2<'py, f64>,
    direction: PyReadonlyArray2<'py, f64>,
    limits: PyReadonlyArray2<'py, f64>,
    medium: PyReadonlyArray1<'py, f64>,
    source: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let count = origin.shape()[0];
    if origin.shape() != [count, 3] || direction.shape() != [count, 3] || limits.shape() != [count, 2] {
        return Err(PyValueError::new_err("rays are (n, 3), (n, 3) and (n, 2)"));
    }
    let medium = Medium::from_packed(medium.as_slice()?)?;
    let source = Source::from_packed(source.as_slice()?)?;
    let origins = origin.as_slice()?.as_chunks::<3>().0;
    let directions = direction.as_slice()?.as_chunks::<3>().0;
    let limits = limits.as_slice()?.as_chunks::<2>().0;
    let values: Vec<[f64; 3]> = py.detach(|| {
        (0..count)
            .into_par_iter()
            .map(|i| {
                let [from, to] = limits[i];
                evaluate::one(&medium, &source, origins[i], directions[i], from, to)
            })
            .collect()
    });
    values.into_flattened().into_pyarray(py).reshape([count, 3])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<LightMapHandle>()?;
    module.add_class::<MediumMapHandle>()?;
    module.add_function(wrap_pyfunction!(light_map, module)?)?;
    module.add_function(wrap_pyfunction!(medium_map, module)?)?;
    module.add_function(wrap_pyfunction!(airlight, module)?)?;
    module.add_function(wrap_pyfunction!(airlight_along, module)?)?;
    upsample::register(module)
}
