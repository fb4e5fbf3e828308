//! How far a smooth triangle lies below the surface that its corners' normals tell of: there rays of shadows begin near the
//! terminator, as in Cycles, lest facets show.

use crate::vector::{Vec3, add, dot, scale, sub};

/// A smooth triangle.
pub struct Lifting {
    /// How far corner j lies above the plane through corner i across its normal, object space.
    above: [Vec3; 3],
    /// The corners' normals, turned into the world as directions are.
    normals: [Vec3; 3],
}

impl Lifting {
    /// `corners` and unit `normals` in object space; `linear`: rows of the matrix into the world.
    pub fn new(corners: [Vec3; 3], normals: [Vec3; 3], linear: &[Vec3; 3]) -> Self {
        Lifting {
            above: [0, 1, 2].map(|i| corners.map(|corner| dot(sub(corner, corners[i]), normals[i]))),
            normals: normals.map(|normal| linear.map(|row| dot(row, normal))),
        }
    }

    /// From the point at these weights, to the side that `facing`, the geometric normal, looks to. World axes, metres. It is as
    /// high as the highest corner above the point, along the normal of the corner where that is least; or half as high as
    /// the parabola that is at right angles to the normals, where that is more.
    pub fn at(&self, weights: Vec3, facing: Vec3) -> Vec3 {
        let [a, b, c] = [0, 1, 2].map(|i| scale(self.normals[i], weights[i]));
        let normal = add(a, add(b, c));
        let side = if dot(normal, facing) > 0.0 { 1.0 } else { -1.0 };
        let above = self.above.map(|row| scale(row, side));
        let (mut planes, mut parabola) = (f64::INFINITY, 0.0);
        for i in 0..3 {
            let highest = above[i].into_iter().fold(0.0, f64::max);
            planes = planes.min(highest - dot(weights, above[i]));
            for j in 0..i {
                parabola -= 0.5 * weights[i] * weights[j] * (above[i][j] + above[j][i]);
            }
        }
        scale(normal, side * planes.max(parabola))
    }
}
