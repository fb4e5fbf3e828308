//! Triangle setup: an object-space triangle becomes a convex outline on the image and an affine depth.

use super::camera::{Camera, MARGIN_PIXELS};
use super::clip::{MAX_CORNERS, clip};
use super::grid::{Grid, Pixels, Point, SUBPIXELS};
use crate::vector::{Vec3, dot, sub};

/// Sines of corner angles below this are taken for zero area. Triangles with float32 corners are either
/// exactly flat or well above; products of double rounding (a singular matrix) are well below.
const FLAT_SINE_SQUARED: f64 = 1e-24;

/// The plane of a triangle as seen in the image: `at + dx * x + dy * y` is 1 / depth (perspective) or depth
/// (orthographic) at pixel (x, y). Taken from the unsnapped triangle, so depths are those of the
/// true plane at the pixel's centre.
#[derive(Clone, Copy)]
pub struct Plane {
    pub at: f64,
    pub dx: f64,
    pub dy: f64,
    /// The triangle's own depths, which slivers would otherwise leave by extrapolation.
    pub nearest: f32,
    pub farthest: f32,
}

impl Plane {
    #[inline(always)]
    pub fn value(&self, [x, y]: [i32; 2]) -> f64 {
        self.at + self.dx * f64::from(x) + self.dy * f64::from(y)
    }
}

/// A triangle that needed no clipping. One cache line.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub struct Triangle {
    /// Counter-clockwise (y up), in subpixels; pixel centres are at whole multiples of [`SUBPIXELS`].
    pub points: [Point; 3],
    pub plane: Plane,
    /// Index of the triangle over all instances.
    pub id: u32,
}

/// A triangle that was clipped, or whose opacity must be looked up: its visible part as a convex polygon.
pub struct Polygon {
    points: [Point; MAX_CORNERS],
    count: usize,
    pub plane: Plane,
    pub id: u32,
    pub is_tested: bool,
}

impl Polygon {
    pub fn points(&self) -> &[Point] {
        &self.points[..self.count]
    }
}

#[inline(always)]
fn snap(value: f64) -> i32 {
    // Adding 1.5 * 2^52 rounds to the nearest integer and leaves it in the low mantissa bits.
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    (value + MAGIC).to_bits() as i32
}

/// Twice the signed area.
fn doubled_area(points: &[Point]) -> i64 {
    let [ox, oy] = points[0].map(i64::from);
    points[1..]
        .windows(2)
        .map(|pair| {
            let [[ax, ay], [bx, by]] = [pair[0], pair[1]].map(|p| p.map(i64::from));
            (ax - ox) * (by - oy) - (ay - oy) * (bx - ox)
        })
        .sum()
}

impl Camera {
    #[inline(always)]
    fn project(&self, p: Vec3) -> Point {
        let inverse = if self.orthographic { 1.0 } else { 1.0 / p[2] };
        [
            snap(p[0] * inverse * self.to_subpixels[0] + self.offset[0]),
            snap(p[1] * inverse * self.to_subpixels[1] + self.offset[1]),
        ]
    }

    /// Whether a view-space point projects inside the guard band, between the near and the far plane.
    #[inline(always)]
    pub fn is_drawable(&self, p: Vec3) -> bool {
        let w = if self.orthographic { 1.0 } else { p[2] };
        let [left, right, bottom, top] = self.guard;
        (p[2] >= self.near)
            & (p[2] <= self.far)
            & (p[0] >= left * w)
            & (p[0] <= right * w)
            & (p[1] >= bottom * w)
            & (p[1] <= top * w)
    }

    /// Whether edge functions of a snapped point stay within their integers.
    fn is_in_range(&self, point: Point) -> bool {
        let within = |at: i32, side: usize| {
            at >= -MARGIN_PIXELS * SUBPIXELS && at <= (side as i32 + MARGIN_PIXELS) * SUBPIXELS
        };
        within(point[0], self.width) && within(point[1], self.height)
    }

    /// The plane through `p` with normal `n`, or None where it is too flat to be one.
    #[inline(always)]
    fn plane(&self, p: &[Vec3; 3], n: Vec3, nearest: f32, farthest: f32) -> Option<Plane> {
        let (a, b) = (sub(p[1], p[0]), sub(p[2], p[0]));
        let flat = FLAT_SINE_SQUARED * (dot(a, a) * dot(b, b));
        let squared = dot(n, n);
        if squared.is_nan() || squared <= flat {
            return None; // also what overflowed: the products are then infinite or NaN
        }
        // n . P = n . p0 with P = depth * (tx, ty, 1) gives 1 / depth; with P = (x, y, depth) depth.
        let distance = dot(n, p[0]);
        let [mut at, mut dx, mut dy] = if self.orthographic {
            let inverse = 1.0 / n[2];
            let at = (distance - n[0] * self.first[0] - n[1] * self.first[1]) * inverse;
            [at, -n[0] * self.step[0] * inverse, -n[1] * self.step[1] * inverse]
        } else {
            let inverse = 1.0 / distance;
            let at = (n[0] * self.first[0] + n[1] * self.first[1] + n[2]) * inverse;
            [at, n[0] * self.step[0] * inverse, n[1] * self.step[1] * inverse]
        };
        if !(at.is_finite() & dx.is_finite() & dy.is_finite()) {
            // Seen exactly edge on: what snapping lets through lies at the nearest corner.
            at = if self.orthographic {
                f64::from(nearest)
            } else {
                1.0 / f64::from(nearest)
            };
            (dx, dy) = (0.0, 0.0);
        }
        Some(Plane {
            at,
            dx,
            dy,
            nearest,
            farthest,
        })
    }

    /// Sets up a triangle whose view-space corners `p` are all drawable; `normal` is the cross product of
    /// its sides. None where no pixel centre of the grid is near it, or where it has no area.
    #[inline(always)]
    pub fn set_up(&self, grid: &Grid, p: &[Vec3; 3], normal: Vec3, id: u32) -> Option<(Triangle, Pixels)> {
        let mut points = [self.project(p[0]), self.project(p[1]), self.project(p[2])];
        let pixels = grid.pixels(&points)?;
        let area = doubled_area(&points);
        if area == 0 {
            return None;
        }
        if area < 0 {
            points.swap(1, 2);
        }
        let nearest = p[0][2].min(p[1][2]).min(p[2][2]) as f32;
        let farthest = p[0][2].max(p[1][2]).max(p[2][2]) as f32;
        let plane = self.plane(p, normal, nearest, farthest)?;
        Some((Triangle { points, plane, id }, pixels))
    }

    /// Sets up a triangle that must be clipped or tested for opacity.
    #[inline(never)]
    pub fn set_up_polygon(
        &self,
        grid: &Grid,
        p: &[Vec3; 3],
        normal: Vec3,
        id: u32,
        is_tested: bool,
    ) -> Option<(Polygon, Pixels)> {
        let depths = [p[0][2], p[1][2], p[2][2]];
        let hidden = depths.iter().all(|&z| z < self.near) || depths.iter().all(|&z| z > self.far);
        if hidden || p.iter().flatten().any(|x| !x.is_finite()) {
            return None;
        }
        let clipped = clip(self, p);
        let (mut nearest, mut farthest) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut points = [[0; 2]; MAX_CORNERS];
        let mut count = 0;
        for &v in clipped.corners() {
            nearest = nearest.min(v[2] as f32);
            farthest = farthest.max(v[2] as f32);
            let point = self.project(v);
            if !self.is_in_range(point) {
                return None; // overflow on the way here
            }
            // An edge of no length has no inside.
            if count == 0 || points[count - 1] != point {
                points[count] = point;
                count += 1;
            }
        }
        if count > 1 && points[0] == points[count - 1] {
            count -= 1;
        }
        if count < 3 {
            return None;
        }
        let area = doubled_area(&points[..count]);
        if area == 0 {
            return None;
        }
        if area < 0 {
            points[..count].reverse();
        }
        let pixels = grid.pixels(&points[..count])?;
        let plane = self.plane(p, normal, nearest, farthest)?;
        let polygon = Polygon {
            points,
            count,
            plane,
            id,
            is_tested,
        };
        Some((polygon, pixels))
    }
}
