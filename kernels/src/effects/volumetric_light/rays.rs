//! The camera's rays: a lattice of them, one a pixel or one a block of pixels.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub const PACKED_LENGTH: usize = 18;

/// World space, metres. Ray (x, y) goes through slope (or, orthographic, metre) `first` + (x, y) `step`.
#[derive(Clone, Copy, Debug)]
pub struct Lattice {
    pub eye: [f64; 3],
    pub right: [f64; 3],
    pub up: [f64; 3],
    pub forward: [f64; 3],
    pub first: [f64; 2],
    pub step: [f64; 2],
    pub near: f64,
    pub orthographic: bool,
}

/// A ray of unit `direction`; a depth along the view's axis is `per_depth` as long along the ray.
pub struct Ray {
    pub origin: [f64; 3],
    pub direction: [f64; 3],
    pub per_depth: f64,
}

impl Lattice {
    /// Reads `Lattice.packed()`: eye, right, up, forward, first, step, near, orthographic.
    pub fn from_packed(v: &[f64]) -> PyResult<Self> {
        if v.len() != PACKED_LENGTH || v.iter().any(|x| !x.is_finite()) {
            return Err(PyValueError::new_err(format!(
                "a lattice is {PACKED_LENGTH} finite numbers"
            )));
        }
        let three = |i: usize| [v[i], v[i + 1], v[i + 2]];
        Ok(Lattice {
            eye: three(0),
            right: three(3),
            up: three(6),
            forward: three(9),
            first: [v[12], v[13]],
            step: [v[14], v[15]],
            near: v[16],
            orthographic: v[17] != 0.0,
        })
    }

    /// Through a place in units of `step`.
    pub fn ray(&self, [x, y]: [f64; 2]) -> Ray {
        let a = self.first[0] + x * self.step[0];
        let b = self.first[1] + y * self.step[1];
        let across = |i: usize| a * self.right[i] + b * self.up[i];
        if self.orthographic {
            return Ray {
                origin: std::array::from_fn(|i| self.eye[i] + across(i)),
                direction: self.forward,
                per_depth: 1.0,
            };
        }
        let per_depth = (1.0 + a * a + b * b).sqrt();
        Ray {
            origin: self.eye,
            direction: std::array::from_fn(|i| (self.forward[i] + across(i)) / per_depth),
            per_depth,
        }
    }
}
