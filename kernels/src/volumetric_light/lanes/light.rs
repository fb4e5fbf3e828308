//! What a point of a medium gets from a light and turns towards the eye.

use super::{Integrate, PER_SPHERE};
use crate::volumetric_light::source::Profile;

/// Directions that a light nearby is taken as: cosines of the angle from its centre, as shares of the angle that it
/// fills (two Gauss-Legendre nodes), times so many turns.
const RINGS: [f32; 2] = [0.211_324_87, 0.788_675_1];
const TURNS: usize = 8;
/// Cosine and sine of half of an eighth of a turn, and of three halves.
const COSINES: [f32; TURNS] = {
    let (long, short) = (0.923_879_5, 0.382_683_43);
    [long, short, -short, -long, -long, -short, short, long]
};
const SINES: [f32; TURNS] = {
    let (long, short) = (0.923_879_5, 0.382_683_43);
    [short, long, long, short, -short, -long, -long, -short]
};
/// What each direction fills itself, of what the light fills: less than its part, so that edges stay sharp.
const OF_FILLED: f32 = 0.05;

impl Integrate<'_> {
    /// The light's intensity times the phase function over an even one's, averaged over the directions that the light
    /// fills: nearby each is turned to the eye by its own angle, and a spot shines in some of them only.
    #[inline(always)]
    fn nearby(&self, i: usize, tau: f32, distance: f32, filled: f32) -> f32 {
        let (setup, b) = (self.setup, self.batch);
        let cosine = (b.along0[i] + tau * b.along1[i]) / distance;
        let from = tau - b.across_tau[i];
        let sine2 = (b.across0[i] + b.across2[i] * from * from) / (distance * distance);
        let sine = sine2.max(1e-20).sqrt();
        // The ray's direction: along the line from the light, across it in the axis' plane, and out of that plane.
        let ahead = tau / distance;
        let across2 = (1.0 - ahead * ahead).max(0.0);
        let limit = across2.sqrt();
        let level = ((b.along1[i] - cosine * ahead) / sine).clamp(-limit, limit);
        let upright = (across2 - level * level).max(0.0).sqrt();
        let own = OF_FILLED * filled;
        let g = setup.anisotropy;
        let missing = setup.phase[0] + 0.5 * own * g.abs();
        let mut sum = 0.0;
        for ring in RINGS {
            let lean = 1.0 - (filled - own) * ring;
            let out = (1.0 - lean * lean).max(0.0).sqrt();
            for turn in 0..TURNS {
                let (right, up) = (out * COSINES[turn], out * SINES[turn]);
                let cosine = lean * cosine + right * sine;
                let ahead = lean * ahead + right * level + up * upright;
                let turned = 0.5 + 0.5 * if g >= 0.0 { ahead } else { -ahead };
                let square = missing * missing + 4.0 * (1.0 - missing) * turned.max(0.0);
                let shines = if setup.profile == Profile::Uniform {
                    1.0
                } else {
                    self.spot(cosine, 1.0 - cosine, (1.0 - cosine * cosine).max(0.0), own)
                };
                sum += shines / (square * square.sqrt());
            }
        }
        sum * missing * (2.0 - missing) / (RINGS.len() * TURNS) as f32
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
        let x = ((cone[0] - off) / width + 0.5).clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
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
            Profile::Spot { .. } => {
                let off = if cosine > 0.0 {
                    sine2 / (1.0 + cosine)
                } else {
                    1.0 - cosine
                };
                self.spot(cosine, off, sine2, filled)
            }
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
        let (mirrored, z2) = (1.0 / z, z * z);
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
            return value * self.nearby(i, 0.5 * h * (z - mirrored), distance, r * r * falloff);
        }
        if TURNED {
            let turned = if setup.anisotropy >= 0.0 { z2 } else { 1.0 } / (1.0 + z2);
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
