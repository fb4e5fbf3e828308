//! What a point of a medium gets from a light and turns towards the eye.

use super::functions::{acos, cos};
use super::{Integrate, PER_SPHERE};
use crate::volumetric_light::source::Profile;

/// Directions that a light nearby is taken as.
struct Directions {
    /// Cosines of the angle from its centre, as shares of the angle that it fills, and the weights of a Gauss-Legendre
    /// rule.
    rings: &'static [(f32, f32)],
    /// Cosines and sines around the centre.
    turns: &'static [(f32, f32)],
    /// What each direction fills itself, of what the light fills: without it sharp phase functions would be as many
    /// peaks.
    own: f32,
}

/// Of a light that shines evenly: odd eighths of half a turn.
const EVEN: Directions = {
    let (long, short) = (0.923_879_5, 0.382_683_43);
    Directions {
        rings: &[(0.211_324_87, 0.5), (0.788_675_1, 0.5)],
        turns: &[
            (long, short),
            (short, long),
            (-short, long),
            (-long, short),
            (-long, -short),
            (-short, -long),
            (short, -long),
            (long, -short),
        ],
        own: 0.05,
    }
};

/// Of a spot, whose cone's edge takes more rings: how much of each lies in the cone is known without directions.
const SPOT: Directions = {
    let long = 0.866_025_4;
    Directions {
        rings: &[
            (0.069_431_84, 0.173_927_42),
            (0.330_009_48, 0.326_072_58),
            (0.669_990_5, 0.326_072_58),
            (0.930_568_16, 0.173_927_42),
        ],
        turns: &[
            (long, 0.5),
            (0.0, 1.0),
            (-long, 0.5),
            (-long, -0.5),
            (0.0, -1.0),
            (long, -0.5),
        ],
        own: 0.0125,
    }
};

/// Gauss-Legendre nodes and weights along the part of a ring on which a spot fades.
const FADING: [(f32, f32); 3] = [
    (0.112_701_66, 0.277_777_8),
    (0.5, 0.444_444_45),
    (0.887_298_35, 0.277_777_8),
];

/// The means over a ring of smoothstep(a + b cos), and of that times cos and times the cosine of twice the turn; b > 0.
#[inline(always)]
fn on_ring(a: f32, b: f32) -> [f32; 3] {
    let (full, none) = (((1.0 - a) / b).clamp(-1.0, 1.0), (-a / b).clamp(-1.0, 1.0));
    let (from, to) = (acos(full), acos(none));
    let sine = (1.0 - full * full).sqrt();
    let mut means = [from, sine, sine * full];
    for (place, weight) in FADING {
        let cosine = cos(from + place * (to - from));
        let part = weight * (to - from) * smoothstep(a + b * cosine);
        means[0] += part;
        means[1] += part * cosine;
        means[2] += part * (2.0 * cosine * cosine - 1.0);
    }
    means.map(|x| x * std::f32::consts::FRAC_1_PI)
}

#[inline(always)]
fn smoothstep(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// 1 - cos, with all its digits in narrow cones.
#[inline(always)]
fn off_axis(cosine: f32, sine2: f32) -> f32 {
    if cosine > 0.0 {
        sine2 / (1.0 + cosine)
    } else {
        1.0 - cosine
    }
}

impl Integrate<'_> {
    /// The light's intensity times the phase function over an even one's, averaged over the directions that the light
    /// fills: nearby each is turned to the eye by its own angle, and a spot shines in some of them only. Around a ring
    /// the phase function is taken as its mean and two cosines, so that the sharp edge can be integrated exactly.
    #[inline(always)]
    fn nearby<const SPOTTED: bool>(&self, i: usize, tau: f32, distance: f32, filled: f32) -> f32 {
        let (setup, b) = (self.setup, self.batch);
        let directions = if SPOTTED { &SPOT } else { &EVEN };
        let cosine = (b.along0[i] + tau * b.along1[i]) / distance;
        let from = tau - b.across_tau[i];
        let sine2 = (b.across0[i] + b.across2[i] * from * from) / (distance * distance);
        let sine = sine2.max(1e-20).sqrt();
        let off = off_axis(cosine, sine2);
        // The ray's direction: along the line from the light, across it in the axis' plane, and out of that plane.
        let ahead = tau / distance;
        let across2 = (1.0 - ahead * ahead).max(0.0);
        let limit = across2.sqrt();
        let level = ((b.along1[i] - cosine * ahead) / sine).clamp(-limit, limit);
        let upright = (across2 - level * level).max(0.0).sqrt();
        let own = directions.own * filled;
        let g = setup.anisotropy;
        let missing = setup.phase[0] + 0.5 * own * g.abs();
        let [low, high] = if SPOTTED {
            self.lit_rings(cosine, sine, off, filled)
        } else {
            [0.0, filled - own]
        };
        let mut sum = 0.0;
        for &(ring, part) in directions.rings {
            let apart = low + (high - low) * ring;
            let lean = 1.0 - apart;
            let out = (apart * (1.0 + lean)).sqrt();
            let mut cosines = [0.0; 3];
            for &(right, up) in directions.turns {
                let ahead = lean * ahead + out * (right * level + up * upright);
                let turned = 0.5 + 0.5 * if g >= 0.0 { ahead } else { -ahead };
                let square = missing * missing + 4.0 * (1.0 - missing) * turned.max(0.0);
                let share = 1.0 / (square * square.sqrt());
                cosines[0] += share;
                cosines[1] += 2.0 * right * share;
                cosines[2] += 2.0 * (2.0 * right * right - 1.0) * share;
            }
            if SPOTTED {
                let [middle, width] = setup.cone;
                let a = (middle - apart - lean * off) / width + 0.5;
                let lit = on_ring(a, (out * sine / width).max(1e-18));
                sum += part * (cosines[0] * lit[0] + cosines[1] * lit[1] + cosines[2] * lit[2]);
            } else {
                sum += part * cosines[0];
            }
        }
        if SPOTTED {
            sum *= (high - low) / filled;
        }
        sum * missing * (2.0 - missing) / directions.turns.len() as f32
    }

    /// From and to which 1 - cos a light that fills `filled` has rings that reach into a spot's cone.
    #[inline(always)]
    fn lit_rings(&self, cosine: f32, sine: f32, off: f32, filled: f32) -> [f32; 2] {
        let [middle, width] = self.setup.cone;
        let edge = middle + 0.5 * width;
        let edge_sine = (edge * (2.0 - edge)).sqrt();
        // 1 - cos of the difference and of the sum of the cone's half angle and the one to its axis.
        let (both, product) = (off + edge - off * edge, sine * edge_sine);
        let low = if off > edge {
            (both - product).max(0.0)
        } else {
            0.0
        };
        let less_than_half_a_turn = sine * (1.0 - edge) + cosine * edge_sine > 0.0;
        let high = if less_than_half_a_turn {
            (both + product).min(filled)
        } else {
            filled
        };
        [low, low.max(high)]
    }

    /// A spot's intensity in a direction of this cosine and squared sine, `off` = 1 - cos: [`Seen::intensity`].
    ///
    /// [`Seen::intensity`]: crate::volumetric_light::source::Seen::intensity
    #[inline(always)]
    fn spot(&self, cosine: f32, off: f32, sine2: f32, filled: f32) -> f32 {
        let cone = self.setup.cone;
        let off = off + 0.5 * filled * cosine;
        let spread = cosine * cosine * filled * filled * (1.0 / 12.0)
            + 0.5 * sine2 * (filled - filled * filled * (1.0 / 3.0));
        let width = (cone[1] * cone[1] + 20.0 * spread).sqrt();
        smoothstep((cone[0] - off) / width + 0.5)
    }

    /// The relative intensity of a spot or an area light.
    #[inline(always)]
    fn intensity(&self, i: usize, tau: f32, distance: f32, filled: f32) -> f32 {
        let (setup, b) = (self.setup, self.batch);
        let cosine = (b.along0[i] + tau * b.along1[i]) / distance;
        let from = tau - b.across_tau[i];
        let sine2 = (b.across0[i] + b.across2[i] * from * from) / (distance * distance);
        match setup.profile {
            Profile::Uniform => 1.0,
            Profile::Spot { .. } => self.spot(cosine, off_axis(cosine, sine2), sine2, filled),
            Profile::Area { .. } => {
                let facing = cosine.max(0.0);
                if setup.cone[1] == 0.0 {
                    facing
                } else {
                    let fade = facing * setup.cone[0] - sine2.sqrt();
                    fade.max(0.0) * setup.cone[1]
                }
            }
        }
    }

    /// The integrand but for extinction and the slope of s over y, at z = s / h.
    #[inline(always)]
    pub fn value<const SHAPED: bool, const TURNED: bool, const NEARBY: bool>(&self, i: usize, z: f32) -> f32 {
        let setup = self.setup;
        let h = self.batch.height[i];
        let mirrored = 1.0 / z;
        let distance = 0.5 * h * (z + mirrored);
        let r = setup.radius;
        let spread = if setup.is_sphere {
            let d = if distance > r { distance } else { r };
            let sine = r / d;
            d * d * (1.0 + (1.0 - sine * sine).sqrt())
        } else {
            let slant = (distance * distance + r * r).sqrt();
            slant * (slant + distance)
        };
        let falloff = 1.0 / spread;
        let mut value = 2.0 * PER_SPHERE * distance * mirrored * falloff;
        if NEARBY {
            return value * self.nearby::<SHAPED>(i, 0.5 * h * (z - mirrored), distance, r * r * falloff);
        }
        if TURNED {
            let turned = if setup.anisotropy >= 0.0 { z } else { mirrored } / (z + mirrored);
            let missing = setup.phase[0] + setup.phase[1] * falloff;
            let square = missing * missing + 4.0 * (1.0 - missing) * turned;
            value *= missing * (2.0 - missing) / (square * square.sqrt());
        }
        if SHAPED {
            let filled = r * r * falloff;
            value *= self.intensity(i, 0.5 * h * (z - mirrored), distance, filled);
        }
        value
    }
}
