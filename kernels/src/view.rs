//! An eye that geometry is rasterised from: the camera, or a light.
//!
//! Twin of `addon/core/view.py`, which packs it into [`PACKED_LENGTH`] doubles.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub const PACKED_LENGTH: usize = 19;

/// All lengths in metres; axes are orthonormal. `window` is left, right, bottom, top: slopes (tangents)
/// for a perspective view, metres for an orthographic one. Depth is measured along `forward`.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub eye: [f64; 3],
    pub right: [f64; 3],
    pub up: [f64; 3],
    pub forward: [f64; 3],
    pub window: [f64; 4],
    pub near: f64,
    pub far: f64,
    pub orthographic: bool,
}

impl View {
    /// Reads `View.packed()`: eye, right, up, forward, window, near, far, orthographic (0 or 1).
    pub fn from_packed(v: &[f64]) -> PyResult<Self> {
        if v.len() != PACKED_LENGTH || v.iter().any(|x| x.is_nan()) {
            return Err(PyValueError::new_err(format!(
                "a view is {PACKED_LENGTH} numbers, none NaN"
            )));
        }
        let three = |i: usize| [v[i], v[i + 1], v[i + 2]];
        let view = View {
            eye: three(0),
            right: three(3),
            up: three(6),
            forward: three(9),
            window: [v[12], v[13], v[14], v[15]],
            near: v[16],
            far: v[17],
            orthographic: v[18] != 0.0,
        };
        if view.window[0] >= view.window[1] || view.window[2] >= view.window[3] || view.near >= view.far {
            return Err(PyValueError::new_err(
                "a view needs left < right, bottom < top and near < far",
            ));
        }
        Ok(view)
    }
}
