//! Which fragments are drawn of surfaces that are not wholly opaque.

use crate::geometry::{Material, Opacity, Sides};
use crate::random::Draw;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// An opacity so near to 1 is whole, and one so near to 0 is none: half a step of a picture of 8 bits.
const NEARLY: f32 = 1.0 / 512.0;

#[derive(Clone, Copy)]
pub enum Kept {
    /// What stops everything.
    Whole,
    /// What stops a share.
    Partial,
    /// Each by chance, as likely as it is opaque.
    Drawn(Draw),
}

impl Kept {
    /// Reads "whole", "partial" or "drawn", then by `draw`: seed and sample.
    pub fn named(name: &str, (seed, sample): (u32, u32)) -> PyResult<Self> {
        match name {
            "whole" => Ok(Kept::Whole),
            "partial" => Ok(Kept::Partial),
            "drawn" => Ok(Kept::Drawn(Draw { seed, sample })),
            _ => Err(PyValueError::new_err(format!(
                "'{name}' is none of whole, partial and drawn"
            ))),
        }
    }
}

/// Whether a triangle's fragments are there.
#[derive(Clone, Copy, PartialEq)]
pub enum Presence {
    Always,
    Never,
    /// Each has to be looked at.
    Tested,
}

/// For whom, and which fragments.
#[derive(Clone, Copy)]
pub struct Rule {
    pub is_camera: bool,
    pub kept: Kept,
}

impl Rule {
    pub fn sides(self, material: &Material) -> &Sides {
        if self.is_camera {
            &material.seen
        } else {
            &material.casts
        }
    }

    /// Of triangles of this material.
    pub fn presence(self, material: &Material) -> Presence {
        let [front, back] = self.sides(material).each_ref().map(|side| self.presence_of(side));
        if front == back { front } else { Presence::Tested }
    }

    fn presence_of(self, opacity: &Opacity) -> Presence {
        let always = |is_there| {
            if is_there {
                Presence::Always
            } else {
                Presence::Never
            }
        };
        match (self.kept, opacity.uniform()) {
            (Kept::Partial, _) if opacity.is_clip() => Presence::Never,
            (Kept::Drawn(_), Some(opacity)) if opacity <= 0.0 || opacity >= 1.0 => always(opacity > 0.0),
            (Kept::Drawn(_), _) | (_, None) => Presence::Tested,
            (kept, Some(opacity)) => always(is_kept(kept, opacity)),
        }
    }

    /// Whether the fragment at a pixel or texel, of this opacity, is there.
    #[inline(always)]
    pub fn keeps(self, opacity: f32, triangle: [usize; 2], place: [i32; 2]) -> bool {
        match self.kept {
            Kept::Drawn(draw) => draw.of_triangle(triangle).is_there(place, opacity),
            kept => is_kept(kept, opacity),
        }
    }
}

fn is_kept(kept: Kept, opacity: f32) -> bool {
    let is_whole = opacity >= 1.0 - NEARLY;
    match kept {
        Kept::Partial => opacity > NEARLY && !is_whole,
        _ => is_whole,
    }
}
