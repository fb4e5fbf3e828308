//! What an emitter is.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub const PACKED_LENGTH: usize = 18;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmitterKind {
    Rectangle,
    Ellipse,
    Sphere,
    FacingDisk,
    DistantDisk,
}

/// Fields as in `addon/core/emitter.py`; world space, metres.
#[derive(Clone, Copy, Debug)]
pub struct Emitter {
    pub kind: EmitterKind,
    pub centre: [f64; 3],
    pub right: [f64; 3],
    pub up: [f64; 3],
    pub forward: [f64; 3],
    pub half_width: f64,
    pub half_height: f64,
    pub tan_half_spread: f64,
    pub cos_cone: f64,
    pub blend: f64,
}

impl Emitter {
    pub fn from_packed(v: &[f64]) -> PyResult<Self> {
        if v.len() != PACKED_LENGTH || v.iter().any(|x| x.is_nan()) {
            return Err(PyValueError::new_err(format!(
                "an emitter is {PACKED_LENGTH} numbers, none NaN"
            )));
        }
        let three = |i: usize| [v[i], v[i + 1], v[i + 2]];
        let kind = match v[0] as i64 {
            0 => EmitterKind::Rectangle,
            1 => EmitterKind::Ellipse,
            2 => EmitterKind::Sphere,
            3 => EmitterKind::FacingDisk,
            4 => EmitterKind::DistantDisk,
            other => return Err(PyValueError::new_err(format!("no emitter kind {other}"))),
        };
        Ok(Emitter {
            kind,
            centre: three(1),
            right: three(4),
            up: three(7),
            forward: three(10),
            half_width: v[13],
            half_height: v[14],
            tan_half_spread: v[15],
            cos_cone: v[16],
            blend: v[17],
        })
    }
}
