//! The tiled rasteriser: the surface a view sees, and the nearest depths behind every texel of a light's map.
//!
//! Triangles are set up in parallel, sorted into tiles, and each tile is drawn by one task, in the order
//! of the triangles' ids. Row 0 is the bottom row.

mod bins;
mod block;
mod camera;
mod clip;
mod edge;
mod grid;
mod hit;
mod layers;
mod lift;
mod places;
mod presence;
mod scattered;
mod setup;
mod shade;
mod sink;
mod surface;
mod tile;
mod wide;

use crate::cancel::CancelFlag;
use crate::geometry::{Data, Geometry};
use crate::surface::Images;
use crate::view::View;
use bins::{Bins, bin_triangles, first_ids};
use camera::Camera;
use grid::Grid;
use hit::Finder;
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use places::Places;
use presence::{Kept, Rule};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// Which instances to draw: (instance_count,) bool or uint8.
fn drawn(mask: &Bound<'_, PyAny>, data: &Data) -> PyResult<Vec<bool>> {
    let drawn: Vec<bool> = if let Ok(mask) = mask.extract::<PyReadonlyArray1<'_, bool>>() {
        mask.as_array().to_vec()
    } else if let Ok(mask) = mask.extract::<PyReadonlyArray1<'_, u8>>() {
        mask.as_array().iter().map(|&m| m != 0).collect()
    } else {
        return Err(PyValueError::new_err(
            "the instances to draw are a bool or uint8 array",
        ));
    };
    if drawn.len() != data.instances.len() {
        return Err(PyValueError::new_err(format!(
            "{} instances, but {} marks of what to draw",
            data.instances.len(),
            drawn.len()
        )));
    }
    Ok(drawn)
}

/// How many pixels beyond an image may be asked for: as many as the guard band holds, less those of jitter.
const MOST_BEYOND: i32 = 8192;

/// What an entry draws, and on which pixels, once its arguments are checked.
struct Drawing {
    data: Arc<Data>,
    drawn: Vec<bool>,
    camera: Camera,
    grid: Grid,
    rule: Rule,
    places: Option<Places>,
}

impl Drawing {
    /// The rows and columns asked for, all where none are; `jitter` moves pixel centres, and `offsets` where each pixel
    /// is sampled.
    fn new(
        geometry: PyRef<'_, Geometry>,
        mask: &Bound<'_, PyAny>,
        view: &PyReadonlyArray1<'_, f64>,
        [width, height]: [usize; 2],
        [columns, rows]: [Option<(i32, i32)>; 2],
        (jitter, offsets): ((f64, f64), Option<PyReadonlyArray3<'_, f32>>),
        rule: Rule,
    ) -> PyResult<Self> {
        let data = geometry.data();
        let drawn = drawn(mask, &data)?;
        let view = View::from_packed(view.as_slice()?)?;
        let camera = Camera::new(&view, width, height, [jitter.0, jitter.1])?;
        let wanted = |asked: Option<(i32, i32)>, side: usize, what: &str| {
            let (first, end) = asked.unwrap_or((0, side as i32));
            if first < end && first >= -MOST_BEYOND && end <= side as i32 + MOST_BEYOND {
                return Ok(first..end);
            }
            Err(PyValueError::new_err(format!(
                "{what} {first} to {end} are not {what} of {side}"
            )))
        };
        let mut grid = Grid::new([wanted(columns, width, "columns")?, wanted(rows, height, "rows")?]);
        let places = offsets
            .map(|offsets| Places::new(&offsets, &mut grid))
            .transpose()?;
        Ok(Drawing {
            data,
            drawn,
            camera,
            grid,
            rule,
            places,
        })
    }

    /// Sets up and sorts what is drawn.
    fn binned<R>(
        &self,
        cancel: &CancelFlag,
        work: impl FnOnce(&Bins, &Finder) -> PyResult<R>,
    ) -> PyResult<R> {
        let ids = first_ids(&self.data)?;
        let bins = bin_triangles(
            &self.data,
            &self.drawn,
            &ids,
            &self.camera,
            self.grid,
            self.rule,
            cancel,
        )?;
        work(
            &bins,
            &Finder::new(&self.data, &ids, &self.camera, self.rule, self.places.as_ref()),
        )
    }
}

/// The surface that `view` sees, in rows `rows[0]..rows[1]` and columns `columns[0]..columns[1]` of a `width` x `height`
/// image; row 0 is the bottom row. Both may lie up to 8192 pixels beyond the image. What a pixel shows does not depend
/// on which others are asked for.
///
/// `visible` (instance_count,) bool or uint8; `view` (19,) f64, as `View.packed()`; `jitter` moves the
/// pixel centres, in pixels; `draw`, a seed and the sample's number, decides which fragments of what is partly opaque
/// are there (Draw in random.rs); `offsets` (h, w, 2) f32 pixels, of each from its centre, to 1/256 pixel: where it is
/// sampled (`pixel_offsets`). Returns a dict of the `attributes` asked for, h = rows[1] - rows[0], w likewise:
/// `position` (h, w, 3) f32 metres relative to the eye in world axes, on the triangle; `geometric_normal`
/// (h, w, 3) f32, unit, facing the viewer; `shading_normal` (h, w, 3) f32, unit, turned with the geometric
/// one; `terminator_lift` (h, w, 3) f32 metres, world axes, the way to the surface that the corners' normals tell of, 0
/// where the mesh is flat; `depth` (h, w) f32 metres along forward, inf where nothing is; `uv` (h, w, 2) f32;
/// `object_id`, `instance`, `triangle` (of the instance's mesh), `material` (h, w) i32, -1 where nothing is.
/// What else is nothing is 0. Raises ValueError on bad input, Cancelled when `cancel` is set.
#[pyfunction]
#[pyo3(signature = (geometry, visible, view, width, height, rows=None, columns=None, jitter=(0.0, 0.0), attributes=Vec::new(),
    draw=(0, 0), offsets=None, cancel=None))]
fn raster_surface<'py>(
    py: Python<'py>,
    geometry: PyRef<'py, Geometry>,
    visible: &Bound<'py, PyAny>,
    view: PyReadonlyArray1<'py, f64>,
    width: usize,
    height: usize,
    rows: Option<(i32, i32)>,
    columns: Option<(i32, i32)>,
    jitter: (f64, f64),
    attributes: Vec<String>,
    draw: (u32, u32),
    offsets: Option<PyReadonlyArray3<'py, f32>>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyDict>> {
    let rule = Rule {
        is_camera: true,
        kept: Kept::named("drawn", draw)?,
    };
    let drawing = Drawing::new(
        geometry,
        visible,
        &view,
        [width, height],
        [columns, rows],
        (jitter, offsets),
        rule,
    )?;
    let (h, w) = (drawing.grid.height, drawing.grid.width);
    let mut images = Images::wanted(&attributes, h * w)?;
    let cancel = CancelFlag::of(cancel);
    py.detach(|| {
        drawing.binned(&cancel, |bins, finder| {
            surface::surface(bins, finder, &mut images, &cancel)
        })
    })?;
    images.into_dict(py, &[h, w])
}

/// Which objects lie before a surface already drawn: (h, w) i32 object ids of the nearest one nearer than `depth`
/// (h, w) f32, metres along forward, by more than a millionth of it, of those wholly opaque; -1 where there is none. The other arguments
/// are `raster_surface`'s, h = rows[1] - rows[0] and w likewise. Raises ValueError on bad input, Cancelled when `cancel` is set.
#[pyfunction]
#[pyo3(signature = (geometry, visible, view, width, height, depth, rows=None, columns=None, jitter=(0.0, 0.0), offsets=None,
    cancel=None))]
fn raster_before<'py>(
    py: Python<'py>,
    geometry: PyRef<'py, Geometry>,
    visible: &Bound<'py, PyAny>,
    view: PyReadonlyArray1<'py, f64>,
    width: usize,
    height: usize,
    depth: PyReadonlyArray2<'py, f32>,
    rows: Option<(i32, i32)>,
    columns: Option<(i32, i32)>,
    jitter: (f64, f64),
    offsets: Option<PyReadonlyArray3<'py, f32>>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray2<i32>>> {
    let rule = Rule {
        is_camera: true,
        kept: Kept::Whole,
    };
    let drawing = Drawing::new(
        geometry,
        visible,
        &view,
        [width, height],
        [columns, rows],
        (jitter, offsets),
        rule,
    )?;
    let shape = [drawing.grid.height, drawing.grid.width];
    if depth.shape() != shape {
        return Err(PyValueError::new_err(format!(
            "depth is {:?}, not {:?}",
            depth.shape(),
            shape
        )));
    }
    let depths = depth.as_slice()?;
    let cancel = CancelFlag::of(cancel);
    let objects = py.detach(|| {
        drawing.binned(&cancel, |bins, finder| {
            surface::before(bins, finder, depths, &cancel)
        })
    })?;
    PyArray1::from_vec(py, objects).reshape(shape)
}

/// The `layers` (1 to 16) nearest depths along forward of every texel, (layers, height, width) f32, ascending, inf
/// where there are no more; of `rows` and `columns` where they are given, as `raster_surface` has them. Coplanar duplicates are all kept; an edge between two triangles is one depth.
///
/// `casters` (instance_count,) bool or uint8; `view` (19,) f64, as `View.packed()`. Both sides of a triangle
/// count. `offsets` as `raster_surface` has them. `kept`: of what is not wholly opaque to shadow rays, "whole" keeps what is all the same to half a step of 8
/// bits, "partial" what stops a share, and "drawn" each fragment by chance, as `draw` says (a seed and a sample's number,
/// Draw in random.rs). Raises ValueError on bad input, Cancelled when `cancel` is set.
#[pyfunction]
#[pyo3(signature = (geometry, casters, view, layers, width, height, rows=None, columns=None, kept="whole",
    draw=(0, 0), offsets=None, cancel=None))]
fn layered_depth<'py>(
    py: Python<'py>,
    geometry: PyRef<'py, Geometry>,
    casters: &Bound<'py, PyAny>,
    view: PyReadonlyArray1<'py, f64>,
    layers: usize,
    width: usize,
    height: usize,
    rows: Option<(i32, i32)>,
    columns: Option<(i32, i32)>,
    kept: &str,
    draw: (u32, u32),
    offsets: Option<PyReadonlyArray3<'py, f32>>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyAny>> {
    if layers == 0 || layers > layers::MAX_LAYERS {
        return Err(PyValueError::new_err(format!(
            "a layered depth map has 1 to {} layers, not {layers}",
            layers::MAX_LAYERS
        )));
    }
    let drawing = Drawing::new(
        geometry,
        casters,
        &view,
        [width, height],
        [columns, rows],
        ((0.0, 0.0), offsets),
        Rule {
            is_camera: false,
            kept: Kept::named(kept, draw)?,
        },
    )?;
    let cancel = CancelFlag::of(cancel);
    let image = py.detach(|| {
        drawing.binned(&cancel, |bins, finder| {
            layers::layered_depth(bins, finder, layers, &cancel)
        })
    })?;
    Ok(PyArray1::from_vec(py, image)
        .reshape([layers, drawing.grid.height, drawing.grid.width])?
        .into_any())
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    places::register(module)?;
    module.add_function(wrap_pyfunction!(raster_surface, module)?)?;
    module.add_function(wrap_pyfunction!(raster_before, module)?)?;
    module.add_function(wrap_pyfunction!(layered_depth, module)?)
}
