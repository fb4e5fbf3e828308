//! A hull's triangles, as they are found.

use super::line::{Eye, Place, Width};
use crate::vector::Vec3;

/// One instance's hull under way.
pub struct Builder<'a> {
    pub eye: &'a Eye,
    pub width: &'a Width,
    /// Of welded vertices.
    pub places: Vec<Place>,
    pub triangles: Vec<[[f32; 3]; 3]>,
}

impl Builder<'_> {
    /// Vertex moved along a direction.
    pub fn moved(&self, vertex: u32, direction: Vec3) -> Vec3 {
        self.eye
            .moved(self.width, &self.places[vertex as usize], direction)
    }

    pub fn point(&self, vertex: u32) -> Vec3 {
        self.places[vertex as usize].point
    }

    /// A triangle of the hull, from vertices and where they are moved to.
    pub fn emit(&mut self, vertices: [u32; 3], moved: [Vec3; 3]) {
        if vertices.iter().all(|v| self.places[*v as usize].wanted <= 0.0) {
            return; // no line here
        }
        let [a, b, c] = moved;
        if moved.iter().flatten().all(|x| x.is_finite()) && a != b && b != c && c != a {
            self.triangles.push(moved.map(|p| p.map(|x| x as f32)));
        }
    }
}
