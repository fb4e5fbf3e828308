//! One point that a light is made of, and where along a ray it shines.

use crate::vector::{cross, dot, length};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub const PACKED_LENGTH: usize = 13;

/// How intensity varies with the angle to `axis`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Profile {
    Uniform,
    /// Blender's cone: smoothstep of (cos - cos_cone) / ((1 - cos_cone) blend).
    Spot {
        cos_cone: f64,
        blend: f64,
    },
    /// One-sided, with the cosine law; fades to nothing at the tangent `spread`.
    Area {
        spread: f64,
    },
}

/// What the near field of a light of some radius looks like from its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Near {
    /// A disk that turns to every point: 2 (1 - D / sqrt(D^2 + r^2)) / r^2.
    Disk,
    /// A sphere: 2 (1 - sqrt(1 - r^2 / D^2)) / r^2, constant inside.
    Sphere,
}

/// World space, metres. A distant source has no position, and `axis` is where its light goes.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    pub distant: bool,
    pub position: [f64; 3],
    pub axis: [f64; 3],
    pub radius: f64,
    pub near: Near,
    pub profile: Profile,
}

impl Source {
    /// Reads `Source.packed()`: kind (0 distant, 1 uniform, 2 spot, 3 area), position, axis, radius, near (0 disk,
    /// 1 sphere), cos_cone, blend, tangent of half the spread, and a reserved 0.
    pub fn from_packed(v: &[f64]) -> PyResult<Self> {
        if v.len() != PACKED_LENGTH || v.iter().any(|x| x.is_nan()) || v[..8].iter().any(|x| x.is_infinite())
        {
            return Err(PyValueError::new_err(format!(
                "a source is {PACKED_LENGTH} numbers, none NaN"
            )));
        }
        let profile = match v[0] as i64 {
            0 | 1 => Profile::Uniform,
            2 => Profile::Spot {
                cos_cone: v[9],
                blend: v[10],
            },
            3 => Profile::Area { spread: v[11] },
            other => return Err(PyValueError::new_err(format!("no source kind {other}"))),
        };
        Ok(Source {
            distant: v[0] == 0.0,
            position: [v[1], v[2], v[3]],
            axis: [v[4], v[5], v[6]],
            radius: v[7].max(0.0),
            near: if v[8] == 0.0 { Near::Disk } else { Near::Sphere },
            profile,
        })
    }
}

/// A ray seen from a source of finite distance. `tau` counts metres along it from the point closest to the source.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Metres from the ray's origin to the closest point.
    pub closest: f64,
    /// Metres from the source to the closest point, at least `CLOSEST`.
    pub height: f64,
    /// `axis` times the closest point, and times the ray's direction: (along0 + tau along1) / D is the cosine.
    pub along0: f64,
    pub along1: f64,
    /// The squared sine of the angle to the axis, times D^2: across0 + across2 (tau - across_tau)^2.
    pub across0: f64,
    pub across2: f64,
    pub across_tau: f64,
}

/// A ray passes no closer to a source than this share of its origin's distance, which is what its rounded direction
/// knows, of the source's radius, and of how far behind the source a stretch begins; nor than so many metres, whose
/// squares and quotients single precision holds.
pub const CLOSEST_SHARE: f32 = 1.0 / (1 << 24) as f32;
pub const CLOSEST: f32 = 1e-15;

/// A source is no further from the eye than so many metres in single precision, which holds their square. What shines
/// from there arrives with 1e-36 of its intensity.
pub const FURTHEST: f64 = 1e18;

/// How far a cone's edge is blurred, in half angles that the source fills: a smoothstep with the variance of a
/// semicircle reaches a little further.
const BLURRED: f64 = 1.15;

/// From 1 - cos, with all its digits.
fn half_angle(one_less_cosine: f64) -> f64 {
    2.0 * (0.5 * one_less_cosine).sqrt().min(1.0).asin()
}

impl Seen {
    /// `origin` (relative to the source) and unit `direction` of the ray.
    pub fn new(source: &Source, origin: [f64; 3], direction: [f64; 3]) -> Seen {
        let closest = -dot(origin, direction);
        let away = length(origin);
        let height = length(cross(origin, direction))
            .max(f64::from(CLOSEST_SHARE) * (away + source.radius))
            .max(f64::from(CLOSEST));
        let foot: [f64; 3] = std::array::from_fn(|i| origin[i] + closest * direction[i]);
        let (turn0, turn1) = (cross(source.axis, foot), cross(source.axis, direction));
        let (across1, across2) = (dot(turn0, turn1), dot(turn1, turn1));
        // Ray and axis may be parallel: then the sine does not change along it.
        let across_tau = if across2 > 1e-24 { -across1 / across2 } else { 0.0 };
        let lowest: [f64; 3] = std::array::from_fn(|i| turn0[i] + across_tau * turn1[i]);
        Seen {
            closest,
            height,
            along0: dot(source.axis, foot),
            along1: dot(source.axis, direction),
            across0: dot(lowest, lowest),
            across2,
            across_tau,
        }
    }

    /// Metres from the source.
    pub fn distance(&self, tau: f64) -> f64 {
        (self.height * self.height + tau * tau).sqrt()
    }

    /// tau + D, which a long way before the source is small: no digit is lost there.
    pub fn sum(&self, tau: f64) -> f64 {
        let distance = self.distance(tau);
        if tau > 0.0 {
            tau + distance
        } else {
            self.height * (self.height / (distance - tau))
        }
    }

    /// The relative intensity towards a point, `distance` away; `filled` as [`Source::falloff`] gave it.
    pub fn intensity(&self, profile: &Profile, tau: f64, distance: f64, filled: f64) -> f64 {
        let cosine = (self.along0 + tau * self.along1) / distance;
        let sine2 = || {
            let from = tau - self.across_tau;
            (self.across0 + self.across2 * from * from) / (distance * distance)
        };
        match *profile {
            Profile::Uniform => 1.0,
            Profile::Spot { cos_cone, blend } => {
                let sine2 = sine2();
                // 1 - cos = sin^2 / (1 + cos) keeps its digits in narrow cones.
                let off = if cosine > 0.0 {
                    sine2 / (1.0 + cosine)
                } else {
                    1.0 - cosine
                };
                // Seen from nearby the light is many directions: their mean cosine, and its variance, to which a
                // smoothstep adds a twentieth of its width's square.
                let off = off + 0.5 * filled * cosine;
                let spread =
                    cosine * cosine * filled * filled / 12.0 + 0.5 * sine2 * (filled - filled * filled / 3.0);
                let width = (1.0 - cos_cone) * blend.max(1e-12);
                let middle = (1.0 - cos_cone) - 0.5 * width;
                let x = ((middle - off) / (width * width + 20.0 * spread).sqrt() + 0.5).clamp(0.0, 1.0);
                x * x * (3.0 - 2.0 * x)
            }
            Profile::Area { spread } => {
                if cosine <= 0.0 {
                    0.0
                } else if spread.is_infinite() {
                    cosine
                } else {
                    let tangent = sine2().sqrt() / cosine;
                    cosine * ((spread - tangent) / (spread - spread.atan())).max(0.0)
                }
            }
        }
    }

    /// Where the ray enters or leaves the cone around the axis whose half angle has this cosine: tau, NaN where
    /// it does not.
    fn cone(&self, cosine: f64) -> [f64; 2] {
        // (along)^2 sin_cone^2 = across cos_cone^2, a quadratic in tau.
        let (c2, s2) = (cosine * cosine, (1.0 - cosine) * (1.0 + cosine));
        let a = self.along1 * self.along1 * s2 - self.across2 * c2;
        let b = self.along0 * self.along1 * s2 + self.across2 * self.across_tau * c2;
        let c = self.along0 * self.along0 * s2
            - (self.across0 + self.across2 * self.across_tau * self.across_tau) * c2;
        let q = -(b + b.signum() * (b * b - a * c).sqrt());
        // The other nappe, behind the light, is none of it.
        [q / a, c / q].map(|tau| {
            if (self.along0 + tau * self.along1) * cosine >= 0.0 {
                tau
            } else {
                f64::NAN
            }
        })
    }

    /// Cuts tau from `from` to `to` where the intensity has a kink, and gives `piece` the parts that get any.
    #[inline]
    pub fn pieces(&self, source: &Source, from: f64, to: f64, mut piece: impl FnMut(f64, f64)) {
        let mut cuts = [f64::NAN; 5];
        let mut darkest = 0.0; // the cosine beyond which nothing shines
        match source.profile {
            Profile::Uniform => return piece(from, to),
            Profile::Spot { cos_cone, blend } => {
                let inner = (cos_cone + (1.0 - cos_cone) * blend).min(1.0);
                let blurred = BLURRED * half_angle(source.falloff(self.height).1);
                darkest = -1.0;
                if blurred == 0.0 {
                    darkest = cos_cone;
                } else if cos_cone.acos() + blurred < std::f64::consts::PI {
                    darkest = (cos_cone.acos() + blurred).cos();
                }
                cuts[..2].copy_from_slice(&self.cone(darkest));
                if inner.acos() > blurred && (blend > 0.0 || blurred > 0.0) {
                    cuts[2..4].copy_from_slice(&self.cone((inner.acos() - blurred).cos()));
                }
            }
            Profile::Area { spread } => {
                cuts[0] = -self.along0 / self.along1;
                if spread.is_finite() {
                    darkest = 1.0 / 1f64.hypot(spread);
                    cuts[1..3].copy_from_slice(&self.cone(darkest));
                }
            }
        }
        for cut in &mut cuts {
            // NaN too goes to the end, where the last cut belongs.
            if !(*cut > from && *cut < to) {
                *cut = to;
            }
        }
        cuts[4] = to;
        cuts.sort_unstable_by(f64::total_cmp);
        let mut start = from;
        for end in cuts {
            let middle = if end.is_finite() {
                0.5 * (start + end)
            } else {
                2.0 * start.abs().max(self.height)
            };
            let cosine = (self.along0 + middle * self.along1) / self.distance(middle);
            if end > start && cosine >= darkest {
                piece(start, end);
            }
            start = end;
        }
    }
}

impl Source {
    /// Where single precision can tell how far it is from `eye`.
    pub fn within_reach(mut self, eye: [f64; 3]) -> Source {
        let away = length(std::array::from_fn(|i| self.position[i] - eye[i]));
        if away > FURTHEST {
            self.position = std::array::from_fn(|i| eye[i] + (self.position[i] - eye[i]) * (FURTHEST / away));
        }
        self
    }

    /// Irradiance over intensity on a plane that faces the source, `distance` away; and 1 - cos of the half angle
    /// that the source fills from there.
    pub fn falloff(&self, distance: f64) -> (f64, f64) {
        let r = self.radius;
        let spread = match self.near {
            Near::Disk => {
                let slant = distance.hypot(r);
                slant * (slant + distance)
            }
            Near::Sphere => {
                let d = distance.max(r);
                let sine = r / d;
                d * d * (1.0 + (1.0 - sine * sine).max(0.0).sqrt())
            }
        };
        (2.0 / spread, if r > 0.0 { r * r / spread } else { 0.0 })
    }
}
