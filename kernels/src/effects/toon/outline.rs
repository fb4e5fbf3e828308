//! The outline's image: where the hull lies before every surface, and lines within.

use super::image::{fill, pixels};
use crate::cancel::CancelFlag;
use numpy::{IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Ink, (h, w, 4) f32, premultiplied: the colour of the hull's instance where it lies before the surface; that of
/// the surface's instance where `lines` says so; 0 elsewhere.
///
/// `hull_instance` (h, w) i32, -1 where no hull lies before the surface; `colours` (I, 3) f32 linear RGB; `lines` (h,
/// w) u8 with `instance` (h, w) i32.
#[pyfunction]
#[pyo3(signature = (hull_instance, colours, lines=None, instance=None, cancel=None))]
pub fn toon_outline<'py>(
    py: Python<'py>,
    hull_instance: PyReadonlyArray2<'py, i32>,
    colours: PyReadonlyArray2<'py, f32>,
    lines: Option<PyReadonlyArray2<'py, u8>>,
    instance: Option<PyReadonlyArray2<'py, i32>>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let size = [hull_instance.shape()[0], hull_instance.shape()[1]];
    let hull_instances = pixels(&hull_instance, &size, "hull_instance")?;
    let colours = pixels(&colours, &[colours.shape()[0], 3], "colours")?
        .as_chunks::<3>()
        .0;
    let lines = lines
        .as_ref()
        .map(|image| pixels(image, &size, "lines"))
        .transpose()?;
    let instances = instance
        .as_ref()
        .map(|image| pixels(image, &size, "instance"))
        .transpose()?;
    let lines = lines.zip(instances);
    let cancel = CancelFlag::of(cancel);
    let mut result = vec![[0.0f32; 4]; hull_instances.len()];
    py.detach(|| {
        fill(&mut result, &cancel, |first, piece| {
            for (offset, value) in piece.iter_mut().enumerate() {
                let pixel = first + offset;
                let mut of = hull_instances[pixel];
                if of < 0
                    && let Some((lines, instances)) = lines
                    && lines[pixel] != 0
                {
                    of = instances[pixel];
                }
                if let Some([r, g, b]) = usize::try_from(of).ok().and_then(|of| colours.get(of)) {
                    *value = [*r, *g, *b, 1.0];
                }
            }
        })
    })?;
    result
        .into_flattened()
        .into_pyarray(py)
        .reshape([size[0], size[1], 4])
}
