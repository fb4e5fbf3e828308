//! Where rays of shadows begin near the terminator of smooth triangles: above them, as in Cycles, lest facets show. A twin of
//! the rasteriser's, by another way.

use crate::vector::{Vec3, dot, scale, sub};

/// From a point of a triangle to the surface that its corners' normals tell of, in the space of `corners` and unit `normals`:
/// the height along the interpolated normal, above 0 on the `side` 1 that the normals look to and below on the side -1.
pub fn height(corners: [Vec3; 3], normals: [Vec3; 3], weights: Vec3, side: f64) -> f64 {
    let mix = |k: usize| weights[0] * corners[0][k] + weights[1] * corners[1][k] + weights[2] * corners[2][k];
    let point = [mix(0), mix(1), mix(2)];
    let mut planes = f64::INFINITY;
    let mut parabola = 0.0;
    for i in 0..3 {
        let j = (i + 1) % 3;
        let outward = scale(normals[i], side);
        let above = corners.map(|corner| dot(sub(corner, point), outward));
        planes = planes.min(above.into_iter().fold(0.0, f64::max));
        let bend = dot(sub(normals[j], normals[i]), sub(corners[j], corners[i]));
        parabola += side * bend * weights[i] * weights[j];
    }
    side * planes.max(0.5 * parabola)
}

/// What shadow rays of a smooth point need to know, see [`lifted`].
#[derive(Clone, Copy)]
pub struct Lift {
    /// To where they begin at most.
    way: [f32; 3],
    /// The cosine from which they begin at the point itself, as Blender's objects have it.
    offset: f32,
}

impl Lift {
    /// Of the way and the offset as a row of an array; None where no ray begins elsewhere.
    pub fn of([x, y, z, offset]: [f32; 4]) -> Option<Self> {
        let is_there = offset > 0.0 && (x + y + z).is_finite() && [x, y, z] != [0.0; 3];
        is_there.then_some(Lift {
            way: [x, y, z],
            offset,
        })
    }

    /// The way for a unit `direction` that is above the horizon of the shading normal: all of it where the geometric
    /// normal turns away, and less and less up to the offset.
    #[inline(always)]
    pub fn towards(
        &self,
        geometric_normal: [f32; 3],
        shading_normal: [f32; 3],
        direction: [f32; 3],
    ) -> [f32; 3] {
        let cosine = |n: [f32; 3]| n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2];
        let sum = cosine(geometric_normal) + cosine(shading_normal).min(self.offset);
        let share = (2.0 - sum / self.offset).clamp(0.0, 1.0);
        self.way.map(|x| x * share)
    }
}
