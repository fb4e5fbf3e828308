//! Hulls of a scene's instances, from Python.

use super::grown::{hull, is_clear};
use super::line::{Eye, Width};
use crate::cancel::CancelFlag;
use crate::geometry::Geometry;
use crate::view::View;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use std::collections::HashMap;

/// The inverted hulls of `instances`, seen from `view` (19,) f64: one (V, 3) f32 array of triangle corners an
/// instance, three rows a triangle, relative to the eye; only triangles that face away, by the surface's own
/// orientation. `pixel` is a pixel's side in window units, `width` in metres or, with `in_pixels`, in pixels; between
/// `least` and `most` pixels. `scales` (instances,) f64 multiply it, and so does `thickness` of a mesh's vertices, where
/// it is given: (mesh, (V,) f32). Triangles that are not wholly opaque to cameras have no hull. Raises ValueError on
/// bad input, Cancelled when `cancel` is set.
#[pyfunction]
#[pyo3(signature = (geometry, instances, view, pixel, width, in_pixels, least, most, scales, thickness=Vec::new(), cancel=None))]
pub fn toon_hull<'py>(
    py: Python<'py>,
    geometry: PyRef<'py, Geometry>,
    instances: Vec<usize>,
    view: PyReadonlyArray1<'py, f64>,
    pixel: f64,
    width: f64,
    in_pixels: bool,
    least: f64,
    most: f64,
    scales: Vec<f64>,
    thickness: Vec<(usize, PyReadonlyArray1<'py, f32>)>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
    let data = geometry.data();
    drop(geometry);
    let eye = Eye {
        view: View::from_packed(view.as_slice()?)?,
        pixel,
    };
    if scales.len() != instances.len() || instances.iter().any(|&i| i >= data.instances.len()) {
        return Err(PyValueError::new_err(
            "instances that are not there, or not one scale for each",
        ));
    }
    if !(least >= 0.0 && most >= least && pixel > 0.0) {
        return Err(PyValueError::new_err(
            "a line's least width is 0 or more, and not above its most",
        ));
    }
    let thickness: HashMap<usize, Vec<f32>> = thickness
        .into_iter()
        .map(|(mesh, values)| Ok((mesh, values.as_slice()?.to_vec())))
        .collect::<PyResult<_>>()?;
    for (mesh, values) in &thickness {
        if data
            .meshes
            .get(*mesh)
            .is_none_or(|m| m.positions.len() != values.len())
        {
            return Err(PyValueError::new_err("thickness has one value a vertex"));
        }
    }
    let cancel = CancelFlag::of(cancel);
    let hulls = py.detach(|| {
        let mut meshes: Vec<usize> = instances.iter().map(|&i| data.instances[i].mesh).collect();
        meshes.sort_unstable();
        meshes.dedup();
        meshes.par_iter().try_for_each(|&mesh| {
            cancel.check()?;
            data.meshes[mesh].topology();
            Ok::<(), PyErr>(())
        })?;
        instances
            .par_iter()
            .zip(&scales)
            .map(|(&index, scale)| {
                cancel.check()?;
                let instance = &data.instances[index];
                let mesh = &data.meshes[instance.mesh];
                let own = Width {
                    width: width * scale,
                    in_pixels,
                    least,
                    most,
                };
                let skipped = |triangle: usize| is_clear(&data, instance, triangle);
                let values = thickness.get(&instance.mesh).map(Vec::as_slice);
                Ok(hull(
                    mesh,
                    mesh.topology(),
                    instance,
                    &skipped,
                    values,
                    &own,
                    &eye,
                ))
            })
            .collect::<PyResult<Vec<_>>>()
    })?;
    hulls
        .into_iter()
        .map(|triangles| {
            let rows = 3 * triangles.len();
            let flat: Vec<f32> = triangles.into_flattened().into_flattened();
            let array: Bound<'py, PyArray1<f32>> = flat.into_pyarray(py);
            array.reshape([rows, 3])
        })
        .collect()
}
