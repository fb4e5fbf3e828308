//! Shading points.

/// Least cosine between the normals of one smooth surface.
const ALIKE: f32 = 0.99;
/// How far, as a share of its distance, a point of the same surface may be from the tangent plane.
const FLAT: f32 = 0.02;

/// Shading points as the surface step makes them, row by row.
#[derive(Clone, Copy)]
pub struct Points<'a> {
    pub position: &'a [[f32; 3]],
    pub geometric_normal: &'a [[f32; 3]],
    pub shading_normal: &'a [[f32; 3]],
    /// Points in a row; all of them if they are no image.
    pub width: usize,
}

impl Points<'_> {
    /// Whether two points lie on one smooth surface, as far as their normals tell.
    pub fn on_one_surface(&self, a: usize, b: usize) -> bool {
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let normal = self.geometric_normal[a];
        let way: [f32; 3] = std::array::from_fn(|c| self.position[b][c] - self.position[a][c]);
        let off = dot(normal, way);
        // Written so that a NaN is no surface.
        dot(normal, self.geometric_normal[b]) >= ALIKE
            && dot(self.shading_normal[a], self.shading_normal[b]) >= ALIKE
            && off * off <= FLAT * FLAT * dot(way, way)
    }
}
