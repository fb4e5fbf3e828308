//! Points near the terminator of smooth surfaces as rays of their shadows leave them: above the triangles, as in Cycles, lest
//! facets show. Maps are asked from there.

use crate::cancel::CancelFlag;
use crate::emitter::{Emitter, EmitterKind};
use pyo3::PyResult;
use rayon::prelude::*;
use std::f64::consts::SQRT_2;

/// Points that a thread takes at a time.
const CHUNK: usize = 1 << 14;

type Vector = [f32; 3];

fn dot(a: Vector, b: Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A light as the points see it, which are relative to an eye.
pub struct Seen {
    /// Its middle; the direction to it if it is distant.
    middle: Vector,
    is_distant: bool,
    /// By how much the cosine to any part of it may differ from that to its middle, times the distance of that.
    spread: f32,
}

impl Seen {
    pub fn new(emitter: &Emitter, eye: [f64; 3]) -> Self {
        let axes = [0, 1, 2];
        if emitter.kind == EmitterKind::DistantDisk {
            return Seen {
                middle: axes.map(|a| -emitter.forward[a] as f32),
                is_distant: true,
                spread: emitter.half_width as f32,
            };
        }
        let is_round = matches!(emitter.kind, EmitterKind::Sphere | EmitterKind::FacingDisk);
        let half_height = if is_round { 0.0 } else { emitter.half_height };
        Seen {
            middle: axes.map(|a| (emitter.centre[a] - eye[a]) as f32),
            is_distant: false,
            // A chord of the unit sphere is at most so much longer than the sine of its angle.
            spread: (SQRT_2 * emitter.half_width.hypot(half_height)) as f32,
        }
    }

    /// Which share of its lift a point is to be raised by, for the part of the light that is lowest over the surface: all of
    /// it where the geometric normal turns away, and less and less up to a cosine of `offset`.
    fn share(&self, position: Vector, geometric_normal: Vector, shading_normal: Vector, offset: f32) -> f32 {
        let way = if self.is_distant {
            self.middle
        } else {
            [0, 1, 2].map(|a| self.middle[a] - position[a])
        };
        let length = dot(way, way).sqrt().max(1e-30);
        let lowest = |normal: Vector| (dot(normal, way) - self.spread) / length;
        let sum = lowest(geometric_normal) + lowest(shading_normal).clamp(0.0, offset);
        (2.0 - sum / offset).clamp(0.0, 1.0)
    }
}

/// What is known of points near the terminator.
#[derive(Clone, Copy)]
pub struct Smooth<'a> {
    pub position: &'a [Vector],
    pub geometric_normal: &'a [Vector],
    pub shading_normal: &'a [Vector],
    /// The way to where rays begin at most (`Lifting` of the rasteriser), and whose point it is.
    pub lift: &'a [Vector],
    pub instance: &'a [i32],
    /// Of each instance; 0: none.
    pub offsets: &'a [f32],
}

/// Positions and geometric normals of the points, raised. A raised point's horizon is that of its shading normal.
pub fn raised(points: Smooth, light: &Seen, cancel: &CancelFlag) -> PyResult<(Vec<f32>, Vec<f32>)> {
    let mut positions = points.position.to_vec();
    let mut normals = points.geometric_normal.to_vec();
    let chunks = positions.par_chunks_mut(CHUNK).zip(normals.par_chunks_mut(CHUNK));
    chunks.enumerate().for_each(|(number, (positions, normals))| {
        if cancel.is_set() {
            return;
        }
        for (at, (position, normal)) in (number * CHUNK..).zip(positions.iter_mut().zip(normals)) {
            let lift = points.lift[at];
            if lift == [0.0; 3] {
                continue;
            }
            let offset = usize::try_from(points.instance[at])
                .ok()
                .and_then(|instance| points.offsets.get(instance));
            let Some(&offset) = offset.filter(|&&offset| offset > 0.0) else {
                continue;
            };
            let share = light.share(*position, *normal, points.shading_normal[at], offset);
            if share > 0.0 {
                *position = [0, 1, 2].map(|a| position[a] + share * lift[a]);
                *normal = points.shading_normal[at];
            }
        }
    });
    cancel.check()?;
    Ok((positions.into_flattened(), normals.into_flattened()))
}
