//! Where a view's pixels are, and how an instance gets into the view.

use super::grid::SUBPIXELS;
use super::wide::{Pixels, WIDE, Wide3};
use crate::vector::{Vec3, add, cross, dot, scale, sub};
use crate::view::View;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Triangles are clipped this far outside the image (in pixels), which bounds the edge functions.
const GUARD_PIXELS: f64 = 16384.0;

/// Pixel centres move at most this many pixels.
pub const MAX_JITTER: f64 = 64.0;

/// How far outside the image (in pixels) a snapped point may lie: the guard, the jitter, and rounding.
pub const MARGIN_PIXELS: i32 = (GUARD_PIXELS + MAX_JITTER) as i32 + 1;

/// With the margin on both sides, coordinates span 65666 * 256 < 2^24.01 subpixels, which keeps the edge
/// functions in a tile of 64 pixels, 63 (|dx| + |dy|) at most, below 2^31.
pub const MAX_SIDE: usize = 32768;

/// Cross product of an object-space triangle's sides: twice its area along its normal.
#[inline(always)]
pub fn winding_normal(corners: [[f32; 3]; 3]) -> Vec3 {
    let [a, b, c] = corners.map(|p| p.map(f64::from));
    cross(sub(b, a), sub(c, a))
}

/// An affine map, kept as its linear part, its translation, and the linear part's cofactors: the
/// cofactors turn object-space normals (and cross products) without an inverse, so a singular matrix
/// gives a zero vector rather than NaN.
#[derive(Clone, Copy)]
pub struct Transform {
    pub linear: [Vec3; 3],
    pub translation: Vec3,
    pub cofactors: [Vec3; 3],
}

impl Transform {
    fn new(linear: [Vec3; 3], translation: Vec3) -> Self {
        let [a, b, c] = linear;
        Transform {
            linear,
            translation,
            cofactors: [cross(b, c), cross(c, a), cross(a, b)],
        }
    }

    #[inline(always)]
    pub fn point(&self, p: [f32; 3]) -> Vec3 {
        let p = p.map(f64::from);
        let row = |i: usize| dot(self.linear[i], p) + self.translation[i];
        [row(0), row(1), row(2)]
    }

    /// What becomes of the cross product of two directions.
    #[inline(always)]
    pub fn normal(&self, n: Vec3) -> Vec3 {
        [
            dot(self.cofactors[0], n),
            dot(self.cofactors[1], n),
            dot(self.cofactors[2], n),
        ]
    }
}

/// A ray through a pixel's centre, relative to the eye, in world axes; `direction` has length 1 along
/// forward, so its parameter is the depth.
#[derive(Clone, Copy)]
pub struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
}

/// A view with its pixel grid. Window coordinates are slopes in a perspective view, metres in an
/// orthographic one; pixel (x, y) has its centre at `first + (x, y) * step`.
#[derive(Clone, Copy)]
pub struct Camera {
    pub eye: Vec3,
    pub axes: [Vec3; 3],
    pub near: f64,
    pub far: f64,
    pub orthographic: bool,
    pub width: usize,
    pub height: usize,
    pub first: [f64; 2],
    pub step: [f64; 2],
    /// Window coordinates to subpixels: `at * to_subpixels + offset`.
    pub to_subpixels: [f64; 2],
    pub offset: [f64; 2],
    /// The guard band in window coordinates: left, right, bottom, top.
    pub guard: [f64; 4],
}

impl Camera {
    /// `jitter` moves every pixel centre, in pixels. Raises ValueError on a view or size that cannot be drawn.
    pub fn new(view: &View, width: usize, height: usize, jitter: [f64; 2]) -> PyResult<Self> {
        if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
            return Err(PyValueError::new_err(format!(
                "an image is 1 to {MAX_SIDE} pixels a side, not {width} x {height}"
            )));
        }
        let axes = [view.right, view.up, view.forward];
        let numbers = view.eye.iter().chain(axes.iter().flatten()).chain(&view.window);
        if numbers.chain(&jitter).any(|x| !x.is_finite()) || !view.near.is_finite() {
            return Err(PyValueError::new_err(
                "a view and its jitter are finite, but for the far plane",
            ));
        }
        if jitter.iter().any(|j| j.abs() > MAX_JITTER) {
            return Err(PyValueError::new_err("the jitter is at most 64 pixels"));
        }
        if !view.orthographic && view.near <= 0.0 {
            return Err(PyValueError::new_err(
                "a perspective view has its near plane before the eye",
            ));
        }
        let [left, right, bottom, top] = view.window;
        let step = [(right - left) / width as f64, (top - bottom) / height as f64];
        let first = [
            left + (0.5 + jitter[0]) * step[0],
            bottom + (0.5 + jitter[1]) * step[1],
        ];
        let to_subpixels = step.map(|s| f64::from(SUBPIXELS) / s);
        if step
            .iter()
            .chain(&to_subpixels)
            .any(|s| !s.is_finite() || *s <= 0.0)
        {
            return Err(PyValueError::new_err(
                "a view's window is too small or too large for its pixels",
            ));
        }
        Ok(Camera {
            eye: view.eye,
            axes,
            near: view.near,
            far: view.far,
            orthographic: view.orthographic,
            width,
            height,
            first,
            step,
            to_subpixels,
            offset: [-first[0] * to_subpixels[0], -first[1] * to_subpixels[1]],
            guard: [
                left - GUARD_PIXELS * step[0],
                right + GUARD_PIXELS * step[0],
                bottom - GUARD_PIXELS * step[1],
                top + GUARD_PIXELS * step[1],
            ],
        })
    }

    /// Object space to (right, up, forward) relative to the eye.
    pub fn object_to_view(&self, matrix: &[[f64; 4]; 3]) -> Transform {
        let world = self.object_to_eye(matrix);
        let column = |j: usize| [world.linear[0][j], world.linear[1][j], world.linear[2][j]];
        let columns = [column(0), column(1), column(2)];
        let row = |axis: Vec3| columns.map(|c| dot(axis, c));
        Transform::new(
            self.axes.map(row),
            self.axes.map(|axis| dot(axis, world.translation)),
        )
    }

    /// Object space to world axes, relative to the eye.
    pub fn object_to_eye(&self, matrix: &[[f64; 4]; 3]) -> Transform {
        let linear = matrix.map(|r| [r[0], r[1], r[2]]);
        let translation = [matrix[0][3], matrix[1][3], matrix[2][3]];
        Transform::new(linear, sub(translation, self.eye))
    }

    /// Directions of the rays through pixels, as [`Camera::ray`] has them.
    #[inline(always)]
    pub fn directions(&self, pixels: Pixels) -> Wide3 {
        let [right, up, forward] = self.axes;
        if self.orthographic {
            return forward.map(|x| [x; WIDE]);
        }
        let x = pixels.affine([self.first[0], self.step[0], 0.0]);
        let y = pixels.affine([self.first[1], 0.0, self.step[1]]);
        std::array::from_fn(|k| std::array::from_fn(|l| (right[k] * x[l] + up[k] * y[l]) + forward[k]))
    }

    /// Through a place of the image, in pixels from the centre of pixel (0, 0).
    pub fn ray(&self, place: [f64; 2]) -> Ray {
        let at = |i: usize| self.first[i] + place[i] * self.step[i];
        let [right, up, forward] = self.axes;
        let across = add(scale(right, at(0)), scale(up, at(1)));
        if self.orthographic {
            Ray {
                origin: across,
                direction: forward,
            }
        } else {
            Ray {
                origin: [0.0; 3],
                direction: add(across, forward),
            }
        }
    }
}
