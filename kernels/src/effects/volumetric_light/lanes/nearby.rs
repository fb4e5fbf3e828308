//! A light with a size, seen from nearby: many directions, each with its own phase and its own place in a spot's cone.

use super::batch::Integrate;
use super::functions::{acos, cos, inverse_root, larger, smaller};
use super::light::{off_axis, smoothstep};
use crate::simd::{LANES, Lanes};

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
            (0.330_009_5, 0.326_072_58),
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
    let within = |x| smaller(larger(x, -1.0), 1.0);
    let (full, none) = (within((1.0 - a) / b), within(-a / b));
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

/// Sixteen places, as the light sees them.
#[derive(Default)]
struct Places {
    /// Of the angle to the light's axis; `off` is 1 - cos.
    sine: Lanes,
    off: Lanes,
    /// The ray's direction: along the line from the light, across it in the axis' plane, and out of that plane.
    ahead: Lanes,
    level: Lanes,
    upright: Lanes,
    /// 1 - cos of the half angle that the light fills; from and to which of it directions are taken.
    filled: Lanes,
    low: Lanes,
    high: Lanes,
    /// 1 - |g| of the phase function, blurred by a direction's own size.
    missing: Lanes,
}

impl Integrate<'_> {
    /// The light's intensity times the phase function over an even one's at z = s / h, averaged over the directions that
    /// the light fills. Around a ring the phase function is taken as its mean and two cosines, so that the sharp edge of a
    /// cone can be integrated exactly.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // sixteen lanes go together
    pub fn nearby<const SPOTTED: bool>(&self, z: &Lanes) -> Lanes {
        let directions = if SPOTTED { &SPOT } else { &EVEN };
        let places = self.places::<SPOTTED>(z, directions);
        let p = &places;
        let forwards = if self.setup.anisotropy >= 0.0 { 1.0 } else { -1.0 };
        let mut sum = [0.0f32; LANES];
        for &(ring, part) in directions.rings {
            let (mut apart, mut out) = ([0.0f32; LANES], [0.0f32; LANES]);
            for i in 0..LANES {
                apart[i] = p.low[i] + (p.high[i] - p.low[i]) * ring;
                out[i] = (apart[i] * (2.0 - apart[i])).sqrt();
            }
            let mut cosines = [[0.0f32; LANES]; 3];
            for &(right, up) in directions.turns {
                let twice = 2.0 * (2.0 * right * right - 1.0);
                for i in 0..LANES {
                    let ahead =
                        (1.0 - apart[i]) * p.ahead[i] + out[i] * (right * p.level[i] + up * p.upright[i]);
                    let turned = larger(0.5 + 0.5 * forwards * ahead, 0.0);
                    let missing = p.missing[i];
                    let root = inverse_root(missing * missing + 4.0 * (1.0 - missing) * turned);
                    let share = root * root * root;
                    cosines[0][i] += share;
                    cosines[1][i] += 2.0 * right * share;
                    cosines[2][i] += twice * share;
                }
            }
            for i in 0..LANES {
                if SPOTTED {
                    let [middle, width] = self.setup.cone;
                    let a = (middle - apart[i] - (1.0 - apart[i]) * p.off[i]) / width + 0.5;
                    let lit = on_ring(a, larger(out[i] * p.sine[i] / width, 1e-18));
                    sum[i] +=
                        part * (cosines[0][i] * lit[0] + cosines[1][i] * lit[1] + cosines[2][i] * lit[2]);
                } else {
                    sum[i] += part * cosines[0][i];
                }
            }
        }
        for i in 0..LANES {
            let missing = p.missing[i];
            sum[i] *= missing * (2.0 - missing) / directions.turns.len() as f32;
            if SPOTTED {
                sum[i] *= (p.high[i] - p.low[i]) / p.filled[i];
            }
        }
        sum
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // sixteen lanes go together
    fn places<const SPOTTED: bool>(&self, z: &Lanes, directions: &Directions) -> Places {
        let (setup, b) = (self.setup, self.batch);
        let mut p = Places::default();
        for i in 0..LANES {
            let mirrored = 1.0 / z[i];
            let (tau, distance) = (
                0.5 * b.height[i] * (z[i] - mirrored),
                0.5 * b.height[i] * (z[i] + mirrored),
            );
            let filled = setup.radius * setup.radius / self.spread(distance);
            let cosine = (b.along0[i] + tau * b.along1[i]) / distance;
            let from = tau - b.across_tau[i];
            let sine2 = (b.across0[i] + b.across2[i] * from * from) / (distance * distance);
            let sine = larger(sine2, 1e-20).sqrt();
            let off = off_axis(cosine, sine2);
            let ahead = tau / distance;
            let across2 = larger(1.0 - ahead * ahead, 0.0);
            let limit = across2.sqrt();
            let level = smaller(larger((b.along1[i] - cosine * ahead) / sine, -limit), limit);
            let own = directions.own * filled;
            let [low, high] = if SPOTTED {
                self.lit_rings(cosine, sine, off, filled)
            } else {
                [0.0, filled - own]
            };
            p.sine[i] = sine;
            p.off[i] = off;
            p.ahead[i] = ahead;
            p.level[i] = level;
            p.upright[i] = larger(across2 - level * level, 0.0).sqrt();
            p.filled[i] = filled;
            p.low[i] = low;
            p.high[i] = high;
            p.missing[i] = setup.phase[0] + 0.5 * own * setup.anisotropy.abs();
        }
        p
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
            larger(both - product, 0.0)
        } else {
            0.0
        };
        let less_than_half_a_turn = sine * (1.0 - edge) + cosine * edge_sine > 0.0;
        let reached = smaller(both + product, filled);
        let high = if less_than_half_a_turn { reached } else { filled };
        [low, larger(low, high)]
    }
}
