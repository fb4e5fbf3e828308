//! Clipping in view space, before the division.

use super::camera::Camera;
use crate::vector::Vec3;

/// Three corners and one more for each of the six planes.
pub const MAX_CORNERS: usize = 9;

pub struct Clipped {
    corners: [Vec3; MAX_CORNERS],
    count: usize,
}

impl Clipped {
    pub fn corners(&self) -> &[Vec3] {
        &self.corners[..self.count]
    }

    fn push(&mut self, corner: Vec3) {
        // Each plane adds at most one corner to a convex polygon; rounding cannot add more than there is room for.
        if self.count < MAX_CORNERS {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }
}

/// Clips a view-space triangle to the near and far planes and to the guard band.
///
/// A cut is always computed from the kept end to the lost one, so two triangles that share an edge cut
/// it at the same point, bit for bit.
pub fn clip(camera: &Camera, triangle: &[Vec3; 3]) -> Clipped {
    let [left, right, bottom, top] = camera.guard;
    let w = |p: Vec3| if camera.orthographic { 1.0 } else { p[2] };
    let planes: [&dyn Fn(Vec3) -> f64; 6] = [
        &|p| p[2] - camera.near,
        &|p| {
            if camera.far.is_finite() {
                camera.far - p[2]
            } else {
                1.0
            }
        },
        &|p| p[0] - left * w(p),
        &|p| right * w(p) - p[0],
        &|p| p[1] - bottom * w(p),
        &|p| top * w(p) - p[1],
    ];
    let mut polygon = Clipped {
        corners: [[0.0; 3]; MAX_CORNERS],
        count: 0,
    };
    triangle.iter().for_each(|&p| polygon.push(p));
    for (index, distance) in planes.iter().enumerate() {
        let mut kept = Clipped {
            corners: [[0.0; 3]; MAX_CORNERS],
            count: 0,
        };
        for (i, &here) in polygon.corners().iter().enumerate() {
            let next = polygon.corners()[(i + 1) % polygon.count];
            let (a, b) = (distance(here), distance(next));
            if a >= 0.0 {
                kept.push(here);
            }
            if (a >= 0.0) != (b >= 0.0) {
                let (inside, outside, t) = if a >= 0.0 {
                    (here, next, a / (a - b))
                } else {
                    (next, here, b / (b - a))
                };
                let mut cut: Vec3 = std::array::from_fn(|k| inside[k] + (outside[k] - inside[k]) * t);
                match index {
                    0 => cut[2] = camera.near,
                    1 => cut[2] = camera.far,
                    _ => {}
                }
                kept.push(cut);
            }
        }
        polygon = kept;
    }
    polygon
}
