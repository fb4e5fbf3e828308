//! Lines within the silhouette: where object, material or normal changes from pixel to pixel.

use super::image::{dot, fill_pixels, pixels};
use crate::cancel::CancelFlag;
use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Offsets within a disc `width` pixels across; its middle lies between pixels where the width is odd.
pub fn disc(width: usize) -> Vec<[i32; 2]> {
    let middle = if width % 2 == 1 { 0.5 } else { 0.0 };
    let radius = (0.5 * width as f64).hypot(middle);
    let reach = width as i32;
    let mut offsets = Vec::new();
    for y in -reach..=reach {
        for x in -reach..=reach {
            if (f64::from(x) - middle).hypot(f64::from(y) - middle) <= radius + 1e-9 {
                offsets.push([x, y]);
            }
        }
    }
    offsets
}

/// Lines `width` pixels wide (1 to 16), (y1 - y0, w) u8, where any of the pixels around differs: in `object` or
/// `material` (H, w) i32, or in `normal` (H, w, 3) f32 by more than an angle whose cosine is `crease`, within one
/// object. None is not looked at. The images hold rows `y0` to `y1` of H with what rows there are around them;
/// beyond the images there is nothing to differ. Only surfaces of marked objects bear lines: `marked` (H, w) i32 is
/// their instance, -1 for none.
#[pyfunction]
#[pyo3(signature = (marked, y0, y1, width, object=None, material=None, normal=None, crease=-1.0, cancel=None))]
pub fn toon_edges<'py>(
    py: Python<'py>,
    marked: PyReadonlyArray2<'py, i32>,
    y0: usize,
    y1: usize,
    width: usize,
    object: Option<PyReadonlyArray2<'py, i32>>,
    material: Option<PyReadonlyArray2<'py, i32>>,
    normal: Option<PyReadonlyArray3<'py, f32>>,
    crease: f32,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let size = [marked.shape()[0], marked.shape()[1]];
    if y0 >= y1 || y1 > size[0] || !(1..=16).contains(&width) {
        return Err(PyValueError::new_err(
            "no such rows, or a line not 1 to 16 pixels wide",
        ));
    }
    let marks = pixels(&marked, &size, "marked")?;
    let objects = object
        .as_ref()
        .map(|image| pixels(image, &size, "object"))
        .transpose()?;
    let materials = material
        .as_ref()
        .map(|image| pixels(image, &size, "material"))
        .transpose()?;
    let normals = normal
        .as_ref()
        .map(|image| pixels(image, &[size[0], size[1], 3], "normal"))
        .transpose()?
        .map(|image| image.as_chunks::<3>().0);
    let offsets = disc(width);
    let differ = |a: usize, b: usize| {
        objects.is_some_and(|o| o[a] != o[b])
            || materials.is_some_and(|m| m[a] != m[b])
            || normals.is_some_and(|n| marks[a] == marks[b] && dot(n[a], n[b]) < crease)
    };
    let cancel = CancelFlag::of(cancel);
    let mut result = vec![0u8; (y1 - y0) * size[1]];
    py.detach(|| {
        fill_pixels(&mut result, size[1], &cancel, |x, row, _, value| {
            let y = row + y0;
            let pixel = y * size[1] + x;
            if marks[pixel] < 0 {
                return;
            }
            *value = u8::from(offsets.iter().any(|[dx, dy]| {
                let (column, row) = (x as i32 + dx, y as i32 + dy);
                let inside = (0..size[1] as i32).contains(&column) && (0..size[0] as i32).contains(&row);
                inside && {
                    let other = row as usize * size[1] + column as usize;
                    // The silhouette against nothing is the hull's.
                    marks[other] >= 0 && differ(pixel, other)
                }
            }));
        })
    })?;
    result.into_pyarray(py).reshape([y1 - y0, size[1]])
}
