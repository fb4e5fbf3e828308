//! What an emitter is.

use crate::vector::{dot, length};
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

    /// Whether a point with a normal of length 1 surely gets no light, because all of the light is below its horizon,
    /// or the point behind the light's plane or outside its cone: by so much that every sample's weight is 0, whatever
    /// it is rounded to.
    #[inline(always)]
    pub fn surely_misses(&self, point: [f64; 3], normal: [f32; 3]) -> bool {
        let (c, f) = (self.centre, self.forward);
        let (towards, reach) = match self.kind {
            EmitterKind::DistantDisk => ([-f[0], -f[1], -f[2]], self.half_width),
            _ => (
                [c[0] - point[0], c[1] - point[1], c[2] - point[2]],
                (self.half_width * self.half_width + self.half_height * self.half_height).sqrt(),
            ),
        };
        let distance = length(towards);
        let guard = 1e-3 * (distance + reach);
        let behind = dot(f, towards);
        let normal = [f64::from(normal[0]), f64::from(normal[1]), f64::from(normal[2])];
        let is_plane = matches!(self.kind, EmitterKind::Rectangle | EmitterKind::Ellipse);
        dot(normal, towards) < -(reach + guard)
            || (is_plane && behind > guard)
            || 2.0 * reach + guard - behind < self.cos_cone * distance
    }
}
