//! [`integral::near`] for sixteen stretches of rays at once, in single precision.
//!
//! Same formulas, same panels; the nodes in double precision are its oracle (tests/effects/volumetric_light/test_airlight.py).

mod functions;
mod integrate;
mod light;
mod nearby;
mod open;

pub use open::OpenRow;

use super::integral::{blurring_scale, gauss_legendre};
use super::medium::Medium;
use super::source::{CLOSEST_SHARE, Near, Profile, Seen, Source};
use crate::simd::{LANES, Lanes, dispatch};
use functions::larger;
use integrate::Integrate;

/// Widest panel in y where the source's intensity varies along it too.
const SHAPED_WIDTH: f32 = 0.6;
/// The same where the source is so near that its size takes part in how a cone's edge looks.
const NEARBY_WIDTH: f32 = 0.3;
/// Nodes of a panel, at most.
pub const MOST_NODES: usize = 32;
/// Extinction after which nothing that follows counts in single precision.
const OPAQUE: f32 = 20.0;

const PER_SPHERE: f32 = 0.25 * std::f32::consts::FRAC_1_PI;

/// One group of channels whose extinctions are much alike.
struct Group {
    channels: Vec<usize>,
    extinction: [f32; 3],
    /// Whether one channel stands for all.
    is_grey: bool,
    low: f32,
    high: f32,
}

/// What all stretches of a light have in common.
pub struct Setup {
    groups: Vec<Group>,
    scattering: [f32; 3],
    anisotropy: f32,
    /// 1 - |g|, and |g| r^2 / 2.
    phase: [f32; 2],
    peak: f32,
    radius: f32,
    /// Scale of the light's near field, over the ray's squared distance from it.
    near: f32,
    is_sphere: bool,
    profile: Profile,
    /// 1 - cos and its width where a spot's light fades; or the spread and 1 / (spread - atan spread).
    cone: [f32; 2],
    nodes: Vec<(f32, f32)>,
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

/// Up to sixteen stretches, and the pixels that they belong to.
#[derive(Default)]
pub struct Batch {
    count: usize,
    pixel: [usize; LANES],
    weight: Lanes,
    height: Lanes,
    tau: Lanes,
    length: Lanes,
    travelled: Lanes,
    along0: Lanes,
    along1: Lanes,
    across0: Lanes,
    across2: Lanes,
    across_tau: Lanes,
}

impl Batch {
    /// Adds a stretch of a ray: `from` in tau, `travelled` metres of medium until there, seen by `weight` of the light.
    /// Full batches are summed up in `image`.
    #[inline]
    pub fn push(
        &mut self,
        setup: &Setup,
        image: &mut [[f32; 3]],
        pixel: usize,
        seen: &Seen,
        from: f64,
        length: f64,
        travelled: f64,
        weight: f32,
    ) {
        let i = self.count;
        self.pixel[i] = pixel;
        self.weight[i] = weight;
        self.height[i] = larger(seen.height as f32, CLOSEST_SHARE * from as f32);
        self.tau[i] = from as f32;
        self.length[i] = length.min(1e15) as f32;
        self.travelled[i] = travelled as f32;
        self.along0[i] = seen.along0 as f32;
        self.along1[i] = seen.along1 as f32;
        self.across0[i] = seen.across0 as f32;
        self.across2[i] = seen.across2 as f32;
        self.across_tau[i] = seen.across_tau as f32;
        self.count += 1;
        if self.count == LANES {
            self.finish(setup, image);
        }
    }

    /// Sums up what is left.
    pub fn finish(&mut self, setup: &Setup, image: &mut [[f32; 3]]) {
        if self.count == 0 {
            return;
        }
        // Idle lanes repeat the first.
        for i in self.count..LANES {
            for lanes in [
                &mut self.height,
                &mut self.tau,
                &mut self.length,
                &mut self.travelled,
                &mut self.along0,
                &mut self.along1,
                &mut self.across0,
                &mut self.across2,
                &mut self.across_tau,
            ] {
                lanes[i] = lanes[0];
            }
        }
        let sums = dispatch(Integrate { setup, batch: self });
        for i in 0..self.count {
            for c in 0..3 {
                image[self.pixel[i]][c] += self.weight[i] * sums[c][i];
            }
        }
        self.count = 0;
    }
}
