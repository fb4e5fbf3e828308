//! What all stretches of a light have in common, in single precision.

use crate::effects::volumetric_light::integral::{blurring_scale, gauss_legendre};
use crate::effects::volumetric_light::medium::Medium;
use crate::effects::volumetric_light::source::{Near, Profile, Source};

/// Widest panel in y where the source's intensity varies along it too.
pub const SHAPED_WIDTH: f32 = 0.6;
/// The same where the source is so near that its size takes part in how a cone's edge looks.
pub const NEARBY_WIDTH: f32 = 0.3;
/// Nodes of a panel, at most.
pub const MOST_NODES: usize = 32;
/// Extinction after which nothing that follows counts in single precision.
pub const OPAQUE: f32 = 20.0;

pub const PER_SPHERE: f32 = 0.25 * std::f32::consts::FRAC_1_PI;

/// One group of channels whose extinctions are much alike.
pub struct Group {
    pub channels: Vec<usize>,
    pub extinction: [f32; 3],
    /// Whether one channel stands for all.
    pub is_grey: bool,
    pub low: f32,
    pub high: f32,
}

/// What all stretches of a light have in common.
pub struct Setup {
    pub groups: Vec<Group>,
    pub scattering: [f32; 3],
    pub anisotropy: f32,
    /// 1 - |g|, and |g| r^2 / 2.
    pub phase: [f32; 2],
    pub peak: f32,
    pub radius: f32,
    /// Scale of the light's near field, over the ray's squared distance from it.
    pub near: f32,
    pub is_sphere: bool,
    pub profile: Profile,
    /// 1 - cos and its width where a spot's light fades; or the spread and 1 / (spread - atan spread).
    pub cone: [f32; 2],
    pub nodes: Vec<(f32, f32)>,
}

impl Setup {
    pub fn new(medium: &Medium, source: &Source, order: usize) -> Setup {
        let g = medium.anisotropy.abs();
        let groups = medium.groups().into_iter().map(|channels| {
            let extinctions = channels.iter().map(|&c| medium.extinction[c]);
            Group {
                low: extinctions.clone().fold(f64::INFINITY, f64::min) as f32,
                high: extinctions.fold(0.0, f64::max) as f32,
                extinction: medium.extinction.map(|e| e as f32),
                is_grey: channels
                    .iter()
                    .all(|&c| medium.extinction[c] == medium.extinction[channels[0]]),
                channels,
            }
        });
        let cone = match source.profile {
            Profile::Uniform => [0.0; 2],
            Profile::Spot { cos_cone, blend } => {
                let width = (1.0 - cos_cone) * blend.max(1e-12);
                [(1.0 - cos_cone) - 0.5 * width, width]
            }
            Profile::Area { spread } if spread.is_infinite() => [f64::INFINITY, 0.0],
            Profile::Area { spread } => [spread, 1.0 / (spread - spread.atan())],
        };
        Setup {
            groups: groups.collect(),
            scattering: medium.scattering.map(|s| s as f32),
            anisotropy: medium.anisotropy as f32,
            phase: [1.0 - g, 0.5 * g * source.radius * source.radius].map(|x| x as f32),
            peak: ((1.0 - g) / (1.0 + g)) as f32,
            radius: source.radius as f32,
            near: (0.5 / source.radius.max(1e-30) * blurring_scale(medium.anisotropy)) as f32,
            is_sphere: source.near == Near::Sphere,
            profile: source.profile,
            cone: cone.map(|x| x as f32),
            nodes: gauss_legendre(order.min(MOST_NODES))
                .into_iter()
                .map(|(place, weight)| (place as f32, weight as f32))
                .collect(),
        }
    }
}
