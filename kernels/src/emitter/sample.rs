//! Samples of a light, sixteen at a time, with the weights that the definition of visibility asks for.

#![allow(clippy::needless_range_loop)] // a lane is the same index in several arrays

use super::cone::part_in_cone;
use super::shape::{Emitter, EmitterKind};
use crate::simd::{LANES, Lanes};
use crate::vector::{dot, length, tangents};
use std::f32::consts::FRAC_PI_4;

/// Where samples fall.
#[derive(Clone, Copy)]
enum Support {
    /// A disk or a rectangle in a plane: half sizes in metres, then the part to sample (left, right, bottom,
    /// top, as shares of the half sizes), and whether to map the square of samples to the whole disk.
    Plane {
        half: [f32; 2],
        part: [f32; 4],
        disk: bool,
        inside_disk: bool,
    },
    /// The cap of a sphere that is in sight: 1 - cosine of its half angle, radius, distance of the centre, and the part
    /// of the unit disk that it is mapped from, or all.
    Cap {
        one_minus_cosine: f32,
        radius: f32,
        distance: f32,
        part: Option<[f32; 4]>,
    },
    /// Directions: tangent of the half angle.
    Distant { tangent: f32 },
}

/// An emitter as one shading point sees it. Directions in world axes, positions relative to the point.
#[derive(Clone, Copy)]
pub struct SeenEmitter {
    support: Support,
    /// Centre of a plane; direction to the centre of a cap or of a disk of directions.
    middle: [f32; 3],
    right: [f32; 3],
    up: [f32; 3],
    /// Normal of a plane, towards the lit side.
    facing: [f32; 3],
    /// The emitter's own `forward`, which spread and spot are about.
    forward: [f32; 3],
    /// Area in square metres, or solid angle, of what is sampled; 1 if that is a single point.
    measure: f32,
    tan_half_spread: f32,
    spread_scale: f32,
    one_minus_cos_cone: f32,
    blend_scale: f32,
}

/// One batch of light samples. `weight` is relative radiance * cos at the surface * cos at the light /
/// distance^2 * area (or * solid angle), not divided by the number of samples.
#[derive(Clone, Copy, Default)]
pub struct Samples {
    pub direction: [Lanes; 3],
    pub distance: Lanes,
    pub weight: Lanes,
}

impl Samples {
    /// The direction to one. Written out: `map` is not always inlined.
    #[inline(always)]
    pub fn towards(&self, lane: usize) -> [f32; 3] {
        [
            self.direction[0][lane],
            self.direction[1][lane],
            self.direction[2][lane],
        ]
    }
}

/// Without the handling of NaN that keeps the standard ones from being one instruction.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Emitter {
    /// Whether it has no extent, so that one sample says all: its shadow is hard. Sides of length zero count
    /// as 1 in weights, which then are irradiance per unit of intensity (of irradiance for a DISTANT_DISK).
    pub fn is_single(&self) -> bool {
        match self.kind {
            EmitterKind::Rectangle | EmitterKind::Ellipse => {
                self.half_width <= 0.0 && self.half_height <= 0.0
            }
            _ => self.half_width <= 0.0,
        }
    }

    /// `point` in world space. Arrays are written out: `map` is not always inlined, and this is run for every point.
    #[inline]
    pub fn seen_from(&self, point: [f64; 3]) -> SeenEmitter {
        let single = self.is_single();
        let c = self.centre;
        let to_centre = [c[0] - point[0], c[1] - point[1], c[2] - point[2]];
        let distance = length(to_centre);
        let towards = if distance > 0.0 {
            [
                to_centre[0] / distance,
                to_centre[1] / distance,
                to_centre[2] / distance,
            ]
        } else {
            opposite(self.forward)
        };
        let (mut middle, mut right, mut up) = (to_centre, self.right, self.up);
        let mut facing = self.forward;
        let half = [self.half_width.max(0.0), self.half_height.max(0.0)];
        let side = |x: f64| if x > 0.0 { 2.0 * x } else { 1.0 };
        let sides = [side(half[0]), side(half[1])];
        let whole = [-1.0, 1.0, -1.0, 1.0];
        let (support, measure) = match self.kind {
            EmitterKind::Rectangle | EmitterKind::Ellipse => {
                let ellipse = self.kind == EmitterKind::Ellipse;
                let part = if single || self.tan_half_spread == f64::INFINITY {
                    whole
                } else {
                    self.part_within_spread(to_centre)
                };
                let disk = ellipse && part == whole;
                let share = (part[1] - part[0]) * (part[3] - part[2]) / 4.0;
                let shape = if disk && !single {
                    std::f64::consts::FRAC_PI_4
                } else {
                    1.0
                };
                let area = sides[0] * sides[1] * share * shape;
                let inside_disk = ellipse && !disk;
                (plane(half, part, disk, inside_disk), area)
            }
            EmitterKind::FacingDisk => {
                facing = opposite(towards);
                (right, up) = tangents(towards);
                if let Some(found) = part_in_cone(self, towards, distance, 0.0) {
                    (right, up) = (found.right, found.up);
                    let support = plane(half, found.bounds, false, true);
                    (support, half[0] * half[1] * area_of(found.bounds))
                } else {
                    let area = std::f64::consts::PI * half[0] * half[1];
                    (plane(half, whole, true, false), area)
                }
            }
            EmitterKind::Sphere => {
                // The half angle from its sine: exact for the smallest spheres. From inside, all directions.
                let sine2 = (half[0] / distance).powi(2);
                let one_minus_cosine = if sine2 < 1.0 {
                    sine2 / (1.0 + (1.0 - sine2).sqrt())
                } else {
                    2.0
                };
                (right, up) = tangents(towards);
                middle = towards;
                let mut area = std::f64::consts::PI;
                let part = part_in_cone(self, towards, distance, one_minus_cosine).map(|found| {
                    (right, up) = (found.right, found.up);
                    area = area_of(found.bounds);
                    found.bounds.map(|x| x as f32)
                });
                let cap = Support::Cap {
                    one_minus_cosine: one_minus_cosine as f32,
                    radius: half[0] as f32,
                    distance: distance as f32,
                    part,
                };
                (cap, 2.0 * one_minus_cosine * area)
            }
            EmitterKind::DistantDisk => {
                middle = opposite(self.forward);
                let tangent = half[0] as f32;
                (
                    Support::Distant { tangent },
                    std::f64::consts::PI * half[0] * half[0],
                )
            }
        };
        let measure = match self.kind {
            // Inverse square: that of a plane's samples is in their weights.
            EmitterKind::Sphere if single => 1.0 / (distance * distance),
            _ if single => 1.0,
            _ => measure,
        };
        let vector = |v: [f64; 3]| [v[0] as f32, v[1] as f32, v[2] as f32];
        SeenEmitter {
            support,
            middle: vector(middle),
            right: vector(right),
            up: vector(up),
            facing: vector(facing),
            forward: vector(self.forward),
            measure: measure as f32,
            tan_half_spread: self.tan_half_spread as f32,
            spread_scale: self.spread_scale() as f32,
            one_minus_cos_cone: if self.cos_cone <= -1.0 {
                f32::INFINITY
            } else {
                (1.0 - self.cos_cone) as f32
            },
            blend_scale: (1.0 / ((1.0 - self.cos_cone) * self.blend).max(1e-12)) as f32,
        }
    }

    /// The part of a plane that spread lets shine on a point: within tan_half_spread times the height around
    /// the point's foot. Narrow spread would otherwise leave few samples that count.
    fn part_within_spread(&self, to_centre: [f64; 3]) -> [f64; 4] {
        let reach = self.tan_half_spread * -dot(to_centre, self.forward);
        let along = |axis: [f64; 3], half: f64| {
            let foot = -dot(to_centre, axis);
            if reach > 0.0 && half > 0.0 {
                let clip = |x: f64| (x / half).clamp(-1.0, 1.0);
                [clip(foot - reach), clip(foot + reach)]
            } else {
                [-1.0, 1.0]
            }
        };
        let (x, y) = (
            along(self.right, self.half_width),
            along(self.up, self.half_height),
        );
        [x[0], x[1], y[0], y[1]]
    }

    /// 1 / (tan_half_spread - half_spread).
    fn spread_scale(&self) -> f64 {
        let tangent = self.tan_half_spread;
        if tangent <= 0.0 || tangent == f64::INFINITY {
            0.0
        } else if tangent < 1e-2 {
            3.0 / (tangent.powi(3) * (1.0 - 0.6 * tangent * tangent)) // the difference cancels
        } else {
            1.0 / (tangent - tangent.atan())
        }
    }
}

#[inline(always)]
fn opposite(v: [f64; 3]) -> [f64; 3] {
    [-v[0], -v[1], -v[2]]
}

/// Of a box (left, right, bottom, top).
#[inline(always)]
fn area_of(part: [f64; 4]) -> f64 {
    (part[1] - part[0]) * (part[3] - part[2])
}

#[inline(always)]
fn plane(half: [f64; 2], part: [f64; 4], disk: bool, inside_disk: bool) -> Support {
    Support::Plane {
        half: [half[0] as f32, half[1] as f32],
        part: [part[0] as f32, part[1] as f32, part[2] as f32, part[3] as f32],
        disk,
        inside_disk,
    }
}

/// The square to the unit disk, equal areas to equal areas (Shirley and Chiu 1997).
#[inline(always)]
pub fn on_disk(u: &Lanes, v: &Lanes) -> [Lanes; 2] {
    let [mut x, mut y] = [[0.0; LANES]; 2];
    for lane in 0..LANES {
        let (a, b) = (2.0 * u[lane] - 1.0, 2.0 * v[lane] - 1.0);
        let wide = a.abs() > b.abs();
        let (long, short) = if wide { (a, b) } else { (b, a) };
        let angle = FRAC_PI_4 * short / if long == 0.0 { 1.0 } else { long };
        // Taylor series; |angle| <= pi / 4, so what is left out is below 4e-7.
        let s = angle * angle;
        let sine = angle * (1.0 + s * (-1.0 / 6.0 + s * (1.0 / 120.0 - s * (1.0 / 5040.0))));
        let cosine = 1.0 + s * (-0.5 + s * (1.0 / 24.0 + s * (-1.0 / 720.0 + s * (1.0 / 40320.0))));
        let (along, across) = (long * cosine, long * sine);
        x[lane] = if wide { along } else { across };
        y[lane] = if wide { across } else { along };
    }
    [x, y]
}

impl SeenEmitter {
    /// Sixteen samples at `u`, `v` in (0, 1), for a surface with this shading normal. Loops are short and do
    /// one thing each, or the compiler does not make vectors of them.
    #[inline(always)]
    pub fn sample(&self, normal: [f32; 3], u: &Lanes, v: &Lanes, out: &mut Samples) {
        let mut disk = [[0.0; LANES]; 2];
        if self.part().is_none() {
            disk = on_disk(u, v);
        }
        self.aim(u, v, &disk, out);
        self.face(normal, out);
    }

    /// What of a plane or of the unit disk is sampled evenly; None for all of a disk.
    #[inline(always)]
    fn part(&self) -> Option<[f32; 4]> {
        match self.support {
            Support::Plane {
                part, disk: false, ..
            } => Some(part),
            Support::Cap { part, .. } => part,
            _ => None,
        }
    }

    /// The first half of `sample`, which no normal takes part in: `disk` is `u`, `v` on the unit disk.
    #[inline(always)]
    pub fn aim(&self, u: &Lanes, v: &Lanes, disk: &[Lanes; 2], out: &mut Samples) {
        let [mut x, mut y] = *disk;
        if let Some(part) = self.part() {
            for lane in 0..LANES {
                x[lane] = part[0] + (part[1] - part[0]) * u[lane];
                y[lane] = part[2] + (part[3] - part[2]) * v[lane];
            }
        }
        let [dx, dy, dz] = &mut out.direction;
        let (middle, right, up) = (self.middle, self.right, self.up);
        match self.support {
            Support::Plane {
                half, inside_disk, ..
            } => {
                for lane in 0..LANES {
                    let there = !inside_disk | (x[lane] * x[lane] + y[lane] * y[lane] <= 1.0);
                    out.weight[lane] = if there { 1.0 } else { 0.0 };
                }
                let f = self.facing;
                for lane in 0..LANES {
                    let (a, b) = (x[lane] * half[0], y[lane] * half[1]);
                    let sx = middle[0] + right[0] * a + up[0] * b;
                    let sy = middle[1] + right[1] * a + up[1] * b;
                    let sz = middle[2] + right[2] * a + up[2] * b;
                    let square = min(sx * sx + sy * sy + sz * sz, f32::MAX);
                    let inverse = 1.0 / max(square, 1e-30).sqrt();
                    (dx[lane], dy[lane], dz[lane]) = (sx * inverse, sy * inverse, sz * inverse);
                    let cosine = max(-(dx[lane] * f[0] + dy[lane] * f[1] + dz[lane] * f[2]), 0.0);
                    out.distance[lane] = square * inverse;
                    out.weight[lane] *= cosine * inverse * inverse;
                }
            }
            Support::Cap {
                one_minus_cosine,
                radius,
                distance,
                part,
            } => {
                // To the near side of the sphere; from inside, to the only side.
                let side = if distance > radius { -1.0 } else { 1.0 };
                for lane in 0..LANES {
                    let versine = (x[lane] * x[lane] + y[lane] * y[lane]) * one_minus_cosine;
                    let across = (one_minus_cosine * max(2.0 - versine, 0.0)).sqrt();
                    let cosine = 1.0 - versine;
                    let (a, b) = (x[lane] * across, y[lane] * across);
                    dx[lane] = middle[0] * cosine + right[0] * a + up[0] * b;
                    dy[lane] = middle[1] * cosine + right[1] * a + up[1] * b;
                    dz[lane] = middle[2] * cosine + right[2] * a + up[2] * b;
                    let square = versine * (2.0 - versine) * distance * distance;
                    let half_chord = max(radius * radius - square, 0.0).sqrt();
                    out.distance[lane] = max(distance * cosine + side * half_chord, 0.0);
                    let there = part.is_none() | (x[lane] * x[lane] + y[lane] * y[lane] <= 1.0);
                    out.weight[lane] = if there { 1.0 } else { 0.0 };
                }
            }
            Support::Distant { tangent } => {
                for lane in 0..LANES {
                    let (a, b) = (x[lane] * tangent, y[lane] * tangent);
                    let cosine = 1.0 / (1.0 + a * a + b * b).sqrt();
                    dx[lane] = (middle[0] + right[0] * a + up[0] * b) * cosine;
                    dy[lane] = (middle[1] + right[1] * a + up[1] * b) * cosine;
                    dz[lane] = (middle[2] + right[2] * a + up[2] * b) * cosine;
                    out.distance[lane] = f32::MAX;
                    out.weight[lane] = cosine * cosine * cosine;
                }
            }
        }
    }

    /// The second half: weights what `aim` has found.
    #[inline(always)]
    pub fn face(&self, normal: [f32; 3], out: &mut Samples) {
        let [dx, dy, dz] = &out.direction;
        for lane in 0..LANES {
            let cosine = normal[0] * dx[lane] + normal[1] * dy[lane] + normal[2] * dz[lane];
            out.weight[lane] *= max(cosine, 0.0) * self.measure;
        }
        if self.tan_half_spread < f32::INFINITY || self.one_minus_cos_cone < f32::INFINITY {
            self.shape_radiance(out);
        }
        for weight in &mut out.weight {
            *weight = if *weight < f32::INFINITY { *weight } else { 0.0 }; // nor NaN
        }
    }

    /// Multiplies weights by the radiance towards the point; formulas in `addon/core/emitter.py`.
    #[inline(always)]
    fn shape_radiance(&self, out: &mut Samples) {
        let [dx, dy, dz] = &out.direction;
        let f = self.forward;
        for lane in 0..LANES {
            let (ex, ey, ez) = (dx[lane] + f[0], dy[lane] + f[1], dz[lane] + f[2]);
            // 1 - cos a, without the cancellation; then a's tangent and the spot's blend from it.
            let versine = 0.5 * (ex * ex + ey * ey + ez * ez);
            let tangent = (versine * max(2.0 - versine, 0.0)).sqrt() / max(1.0 - versine, 1e-20);
            let spread = max(self.tan_half_spread - tangent, 0.0) * self.spread_scale;
            let spread = if self.tan_half_spread < f32::INFINITY {
                spread
            } else {
                1.0
            };
            let x = min(
                max((self.one_minus_cos_cone - versine) * self.blend_scale, 0.0),
                1.0,
            );
            out.weight[lane] *= spread * x * x * (3.0 - 2.0 * x);
        }
    }
}
