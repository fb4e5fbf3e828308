//! Halftone: ink dots that grow with the shade.

use super::dots::coverage;
use super::image::{dot, fill_pixels, pixels, smooth};
use crate::cancel::CancelFlag;
use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// What the pattern holds on to.
#[derive(Clone, Copy, PartialEq)]
enum Anchor {
    Screen,
    Object,
    Surface,
}

struct Pattern {
    anchor: Anchor,
    /// Frame position in pixels of the image's pixel (0, row 0) centre, jitter included that all share.
    first: [f32; 2],
    /// Cosine and sine of the pattern's turn over the length of a cell (pixels or object units).
    turn: [f32; 2],
    /// Cells a pixel or object unit.
    cells: f32,
    scale: f32,
    cutoff: f32,
    /// 1 / (start - end) and end of the fade, metres; a scale of 0 is no fade.
    fade_scale: f32,
    fade_end: f32,
    opacity: f32,
    /// Half a footprint, pixels.
    half: f32,
    /// Steps of a pixel to the right and up, in window units along world axes.
    across: [[f32; 3]; 2],
    forward: [f32; 3],
    orthographic: bool,
}

impl Pattern {
    fn new(v: &[f32]) -> PyResult<Self> {
        if v.len() != 21 {
            return Err(PyValueError::new_err("a pattern is 21 numbers"));
        }
        let three = |i: usize| [v[i], v[i + 1], v[i + 2]];
        Ok(Pattern {
            anchor: match v[0] as u32 {
                0 => Anchor::Screen,
                1 => Anchor::Object,
                2 => Anchor::Surface,
                other => return Err(PyValueError::new_err(format!("no anchor {other}"))),
            },
            first: [v[1], v[2]],
            turn: [v[3], v[4]],
            cells: v[3].hypot(v[4]),
            scale: v[5],
            cutoff: v[6],
            fade_scale: v[7],
            fade_end: v[8],
            opacity: v[9],
            half: v[10],
            across: [three(11), three(14)],
            forward: three(17),
            orthographic: v[20] != 0.0,
        })
    }

    fn turned(&self, v: [f32; 2]) -> [f32; 2] {
        let [c, s] = self.turn;
        [c * v[0] + s * v[1], c * v[1] - s * v[0]]
    }

    /// Where a pixel lies in the pattern and half its footprint there, in cells, on the screen.
    fn on_screen(&self, pixel: [f32; 2], anchor: [f32; 2]) -> ([f32; 2], [f32; 2]) {
        let at = [
            self.first[0] + pixel[0] - anchor[0],
            self.first[1] + pixel[1] - anchor[1],
        ];
        (self.turned(at), [self.half * self.cells; 2])
    }

    /// The same on the plane of the object that the surface faces most. `rows`: world axes relative to the eye to
    /// object space.
    fn on_surface(&self, p: [f32; 3], n: [f32; 3], rows: &[[f32; 4]; 3]) -> ([f32; 2], [f32; 2]) {
        let turn = |v: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|k| rows[k][0] * v[0] + rows[k][1] * v[1] + rows[k][2] * v[2])
        };
        let moved = turn(p);
        let local: [f32; 3] = std::array::from_fn(|k| moved[k] + rows[k][3]);
        // The axis, as it stands in the world, that the surface faces most.
        let facing: [f32; 3] = std::array::from_fn(|k| {
            let row = [rows[k][0], rows[k][1], rows[k][2]];
            (dot(row, n) / dot(row, row).max(1e-20).sqrt()).abs()
        });
        let axes = if facing[0] >= facing[1] && facing[0] >= facing[2] {
            [1, 2]
        } else if facing[1] >= facing[2] {
            [0, 2]
        } else {
            [0, 1]
        };
        // How the point moves over its plane from pixel to pixel: the view ray turned about the eye.
        let (depth, ray) = if self.orthographic {
            (1.0, self.forward)
        } else {
            (dot(p, self.forward), p)
        };
        let mut along = dot(n, ray);
        let floor = 0.05 * dot(ray, ray).sqrt();
        along = if along.abs() < floor {
            floor.copysign(along)
        } else {
            along
        };
        let steps = self.across.map(|step| {
            let share = dot(n, step) / along;
            let moved: [f32; 3] = std::array::from_fn(|k| depth * (step[k] - ray[k] * share));
            let moved = turn(moved);
            self.turned([moved[axes[0]], moved[axes[1]]])
        });
        let half = std::array::from_fn(|k| self.half * steps[0][k].hypot(steps[1][k]));
        (self.turned([local[axes[0]], local[axes[1]]]), half)
    }
}

/// Paper that shows between halftone dots, (h, w) f32: 1 is paper, 0 ink.
///
/// `light` (h, w) f32, 0 in shade and 1 in light; `instance` (h, w) i32, -1 where nothing is; `pattern` (21,) f32: see
/// addon/effects/toon/pattern.py; `inked` (I,) u8 tells which instances have dots; `anchors` (I, 12) f32: two numbers an
/// instance, its origin in the frame (OBJECT), or three rows that take positions to object space (SURFACE); `position`
/// (h, w, 3) f32 relative to the eye is needed for SURFACE and for a fade, `normal` (h, w, 3) f32 for SURFACE; `offsets` (h, w, 2) f32 pixels: each pixel's own
/// place beside its centre.
#[pyfunction]
#[pyo3(signature = (light, instance, pattern, inked, anchors, position=None, normal=None, offsets=None, cancel=None))]
pub fn toon_halftone<'py>(
    py: Python<'py>,
    light: PyReadonlyArray2<'py, f32>,
    instance: PyReadonlyArray2<'py, i32>,
    pattern: Vec<f32>,
    inked: Vec<u8>,
    anchors: PyReadonlyArray2<'py, f32>,
    position: Option<PyReadonlyArray3<'py, f32>>,
    normal: Option<PyReadonlyArray3<'py, f32>>,
    offsets: Option<PyReadonlyArray3<'py, f32>>,
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let size = [light.shape()[0], light.shape()[1]];
    let whole = [size[0], size[1], 3];
    let lights = pixels(&light, &size, "light")?;
    let positions = position
        .as_ref()
        .map(|image| pixels(image, &whole, "position"))
        .transpose()?
        .map(|image| image.as_chunks::<3>().0);
    let instances = pixels(&instance, &size, "instance")?;
    let pattern = Pattern::new(&pattern)?;
    let normals = normal
        .as_ref()
        .map(|image| pixels(image, &whole, "normal"))
        .transpose()?
        .map(|image| image.as_chunks::<3>().0);
    let offsets = offsets
        .as_ref()
        .map(|image| pixels(image, &[size[0], size[1], 2], "offsets"))
        .transpose()?
        .map(|image| image.as_chunks::<2>().0);
    if anchors.shape() != [inked.len(), 12] {
        return Err(PyValueError::new_err("anchors has 12 numbers an instance"));
    }
    let anchors = anchors.as_slice()?.as_chunks::<12>().0;
    let on_surface = pattern.anchor == Anchor::Surface;
    if (on_surface && normals.is_none()) || ((on_surface || pattern.fade_scale != 0.0) && positions.is_none())
    {
        return Err(PyValueError::new_err(
            "dots on surfaces need positions and normals, and a fade needs positions",
        ));
    }
    let cancel = CancelFlag::of(cancel);
    let mut result = vec![1.0f32; lights.len()];
    py.detach(|| {
        fill_pixels(&mut result, size[1], &cancel, |column, row, pixel, value| {
            let Ok(of) = usize::try_from(instances[pixel]) else {
                return;
            };
            let s = (1.0 - lights[pixel]) * pattern.scale;
            if s < pattern.cutoff || inked.get(of) != Some(&1) {
                return;
            }
            let p = positions.map_or([0.0; 3], |p| p[pixel]);
            let mut fade = pattern.opacity;
            if pattern.fade_scale != 0.0 {
                fade *= smooth((dot(p, p).sqrt() - pattern.fade_end) * pattern.fade_scale);
            }
            let [across, along] = offsets.map_or([0.0; 2], |o| o[pixel]);
            let place = [column as f32 + across, row as f32 + along];
            let (at, half) = match pattern.anchor {
                Anchor::Screen => pattern.on_screen(place, [0.0; 2]),
                Anchor::Object => pattern.on_screen(place, [anchors[of][0], anchors[of][1]]),
                Anchor::Surface => {
                    let a = &anchors[of];
                    let rows = std::array::from_fn(|k| [a[4 * k], a[4 * k + 1], a[4 * k + 2], a[4 * k + 3]]);
                    pattern.on_surface(p, normals.map_or([0.0; 3], |n| n[pixel]), &rows)
                }
            };
            *value = 1.0 - fade * coverage(at, half, 0.5 * s);
        })
    })?;
    result.into_pyarray(py).reshape(size)
}
