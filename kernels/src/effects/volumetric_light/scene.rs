//! What is integrated, and how.

use super::map::LightMap;
use super::medium::Medium;
use super::rays::{Lattice, Ray};
use super::source::Source;
use super::spans::MediumMap;
use super::table::Table;
use crate::vector::{cross, dot, length};

/// How a ray's lit stretches become light.
pub enum Method {
    /// Quadrature of each stretch.
    Walk,
    /// Differences of a table of the antiderivative.
    Table(Table),
    /// A jittered march of so many steps, for comparison.
    March(usize),
}

/// The medium's entries and exits along the camera's rays (layers, height, width), and from the light.
pub struct Bounded<'a> {
    pub layers: usize,
    pub depths: &'a [f32],
    pub maps: Vec<&'a MediumMap>,
}

impl Bounded<'_> {
    /// Whether all that light passes on its way to any point inside is medium.
    pub fn surrounds_light(&self) -> bool {
        !self.maps.is_empty() && self.maps.iter().all(|map| map.begins_inside)
    }
}

pub struct Scene<'a> {
    pub lattice: Lattice,
    /// Of each ray from its place in the lattice, in units of its step.
    pub offsets: Option<&'a [[f32; 2]]>,
    pub medium: Medium,
    pub source: Source,
    /// Of each point that the source's shadows are cast from; all have the same share.
    pub maps: Vec<Vec<&'a LightMap>>,
    pub bounded: Option<Bounded<'a>>,
    pub method: Method,
    pub order: usize,
}

/// What a stretch of a ray is integrated by.
#[derive(Clone, Copy)]
pub struct Span {
    pub pixel: usize,
    /// Where the medium begins along the ray, and how much of it lies before.
    pub from: f64,
    pub before: f64,
}

/// Of a distant source, (1 - cos) / 2 and (1 + cos) / 2 of the angle that its light turns by to reach the eye.
pub fn turn(source: &Source, ray: &Ray) -> (f64, f64) {
    let to_eye = ray.direction.map(|d| -d);
    let cosine = dot(source.axis, to_eye);
    // 1 - |cos| = sin^2 / (1 + |cos|) keeps its digits near both ends.
    let sine = length(cross(source.axis, to_eye));
    let small = 0.5 * sine * sine / (1.0 + cosine.abs());
    if cosine > 0.0 {
        (small, 1.0 - small)
    } else {
        (1.0 - small, small)
    }
}
