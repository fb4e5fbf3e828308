//! What a point of a medium gets from a light and turns towards the eye.

use super::batch::Integrate;
use super::functions::{inverse_root, larger, smaller};
use super::setup::PER_SPHERE;
use crate::effects::volumetric_light::source::Profile;

#[inline(always)]
pub fn smoothstep(x: f32) -> f32 {
    let x = smaller(larger(x, 0.0), 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// 1 - cos, with all its digits in narrow cones.
#[inline(always)]
pub fn off_axis(cosine: f32, sine2: f32) -> f32 {
    if cosine > 0.0 {
        sine2 / (1.0 + cosine)
    } else {
        1.0 - cosine
    }
}

impl Integrate<'_> {
    /// A spot's intensity in a direction of this cosine and squared sine, `off` = 1 - cos: [`Seen::intensity`].
    ///
    /// [`Seen::intensity`]: crate::effects::volumetric_light::source::Seen::intensity
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

    /// 2 over irradiance over intensity: [`Source::falloff`].
    ///
    /// [`Source::falloff`]: crate::effects::volumetric_light::source::Source::falloff
    #[inline(always)]
    pub fn spread(&self, distance: f32) -> f32 {
        let r = self.setup.radius;
        if self.setup.is_sphere {
            let d = larger(distance, r);
            let sine = r / d;
            d * d * (1.0 + (1.0 - sine * sine).sqrt())
        } else {
            let square = distance * distance + r * r;
            let slant = square * inverse_root(square);
            slant * (slant + distance)
        }
    }

    /// The integrand but for extinction and the slope of s over y, at z = s / h; of a light nearby also but for its
    /// intensity and the phase function.
    #[inline(always)]
    pub fn value<const SHAPED: bool, const TURNED: bool, const NEARBY: bool>(&self, i: usize, z: f32) -> f32 {
        let setup = self.setup;
        let h = self.batch.height[i];
        let mirrored = 1.0 / z;
        let sides = z + mirrored;
        let distance = 0.5 * h * sides;
        let spread = self.spread(distance);
        // One division for both; beyond single precision, where no light is, it is 0.
        let inverse = 1.0 / (spread * sides);
        let falloff = sides * inverse;
        let mut value = 2.0 * PER_SPHERE * distance * mirrored * falloff;
        if NEARBY {
            return value;
        }
        if TURNED {
            let turned = if setup.anisotropy >= 0.0 { z } else { mirrored } * inverse * spread;
            let missing = setup.phase[0] + setup.phase[1] * falloff;
            let root = inverse_root(missing * missing + 4.0 * (1.0 - missing) * turned);
            value *= missing * (2.0 - missing) * (root * root * root);
        }
        if SHAPED {
            let filled = setup.radius * setup.radius * falloff;
            value *= self.intensity(i, 0.5 * h * (z - mirrored), distance, filled);
        }
        value
    }
}
