//! Which part of a spot's disk or sphere shines on a point. Near the rim of a wide spot's light that is a sliver of it:
//! a few samples of all would miss it, and the visibility of what none of them has seen is not known.

use super::shape::{Emitter, EmitterKind};
use crate::vector::{cross, dot, length, tangents};
use std::f64::consts::{FRAC_PI_2, PI};

/// Wider by this than the cone, since samples are rounded; in shares of the radius.
const GUARD: f64 = 1e-4;
/// A box of a larger area holds so much of the unit disk that samples spread over all of that are spread better.
const LARGEST_PART: f64 = 3.0;

/// `bounds` (left, right, bottom, top) of what shines, along `right` and `up`, as shares of a disk's radius, or on the
/// unit disk that a sphere's cap is mapped from. Nothing outside of them does.
pub struct Part {
    pub right: [f64; 3],
    pub up: [f64; 3],
    pub bounds: [f64; 4],
}

/// None where next to all of it shines. `towards`, of length 1, points from the point to the light's middle,
/// `distance` metres away; `one_minus_cosine` is that of half the angle that a sphere fills.
#[inline(never)]
pub fn part_in_cone(
    emitter: &Emitter,
    towards: [f64; 3],
    distance: f64,
    one_minus_cosine: f64,
) -> Option<Part> {
    let (radius, f) = (emitter.half_width, emitter.forward);
    if emitter.cos_cone <= -1.0 || !(radius > 0.0 && distance > 0.0 && distance.is_finite()) {
        return None;
    }
    // The angle between the spot's axis and the way from its middle to the point.
    let cosine = -dot(f, towards);
    let aside = [0, 1, 2].map(|axis| f[axis] + cosine * towards[axis]);
    let sine = length(aside);
    let (angle, cone) = (sine.atan2(cosine), emitter.cos_cone.clamp(-1.0, 1.0).acos());
    let is_disk = emitter.kind == EmitterKind::FacingDisk;
    let bounds = if is_disk {
        on_disk(angle, cone, distance / radius)
    } else {
        on_cap(angle, cone, one_minus_cosine)
    };
    let [left, right, bottom, top] = bounds;
    if (right - left) * (top - bottom) > LARGEST_PART {
        return None;
    }
    // Of a disk what shines lies away from where the spot points, of a sphere that which looks there.
    let side = if is_disk { 1.0 } else { -1.0 };
    let right = if sine > 1e-9 {
        aside.map(|x| side * x / sine)
    } else {
        tangents(towards).0
    };
    Some(Part {
        right,
        up: cross(towards, right),
        bounds,
    })
}

/// From a place x, y radii from the middle of a disk that faces the point, `distance` radii away, the point is seen within
/// the cone where distance cos a - x sin a >= cos c sqrt(distance^2 + x^2 + y^2).
fn on_disk(angle: f64, cone: f64, distance: f64) -> [f64; 4] {
    let reach = |angle: f64| {
        if angle.abs() < FRAC_PI_2 {
            distance * angle.tan()
        } else {
            angle * f64::INFINITY
        }
    };
    let left = (-reach(cone + angle) - GUARD).clamp(-1.0, 1.0);
    let right = (reach(cone - angle) + GUARD).clamp(left, 1.0);
    let nearest = if left < 0.0 && 0.0 < right {
        0.0
    } else {
        left.abs().min(right.abs())
    };
    let mut half = (1.0 - nearest * nearest).max(0.0).sqrt();
    if cone.cos() > 1e-6 {
        let (s, c) = (angle.sin() / cone.cos(), angle.cos() / cone.cos());
        let square = |x: f64| (distance * c - x * s).powi(2) - distance * distance - x * x;
        let mut largest = square(left).max(square(right));
        let bend = s * s - 1.0;
        let top = distance * c * s / bend;
        if bend < 0.0 && left < top && top < right {
            largest = square(top);
        }
        half = half.min(largest.max(0.0).sqrt() + GUARD);
    }
    [left, right, -half, half]
}

/// Directions at an angle t from the middle lie sin(t / 2) / sin(cap / 2) from the middle of the unit disk.
fn on_cap(angle: f64, cone: f64, one_minus_cosine: f64) -> [f64; 4] {
    let place = |angle: f64| (0.5 * angle).sin() / (0.5 * one_minus_cosine).sqrt();
    let has_opposite = angle + cone >= PI;
    let outer = if has_opposite {
        1.0
    } else {
        (place(angle + cone) + GUARD).min(1.0)
    };
    if angle <= cone || has_opposite {
        return [-outer, outer, -outer, outer];
    }
    let inner = (place(angle - cone) - GUARD).clamp(0.0, outer);
    let across = (cone.sin() / angle.sin()).clamp(0.0, 1.0);
    let half = (outer * across + GUARD).min(1.0);
    [inner * (1.0 - across * across).sqrt(), outer, -half, half]
}
