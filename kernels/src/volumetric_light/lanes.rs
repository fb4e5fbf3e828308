//! [`integral::near`] for sixteen stretches of rays at once, in single precision.
//!
//! Same formulas, same panels; the nodes in double precision are its oracle (tests/test_airlight.py).

mod open;

pub use open::OpenRow;

use super::integral::{PANEL_DEPTH, PANEL_WIDTH, gauss_legendre};
use super::medium::Medium;
use super::source::{Near, Profile, Seen, Source};
use crate::rays::lanes::{LANES, Lanes, Simd, Work, dispatch};

/// Widest panel in y where the source's intensity varies along it too.
const SHAPED_WIDTH: f32 = 0.6;
/// Extinction after which nothing that follows counts in single precision.
const OPAQUE: f32 = 20.0;

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
    /// (1 - |g|)^2, 4 |g| and (1 - g^2) / (4 pi).
    phase: [f32; 3],
    peak: f32,
    radius: f32,
    is_sphere: bool,
    profile: Profile,
    /// 1 / (1 - cos_cone), 1 / blend; or the spread and 1 / (spread - atan spread).
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
            Profile::Spot { cos_cone, blend } => [1.0 / (1.0 - cos_cone), 1.0 / blend.max(1e-12)],
            Profile::Area { spread } if spread.is_infinite() => [f64::INFINITY, 0.0],
            Profile::Area { spread } => [spread, 1.0 / (spread - spread.atan())],
        };
        Setup {
            groups: groups.collect(),
            scattering: medium.scattering.map(|s| s as f32),
            anisotropy: medium.anisotropy as f32,
            phase: [
                (1.0 - g) * (1.0 - g),
                4.0 * g,
                (1.0 - g) * (1.0 + g) / (4.0 * std::f64::consts::PI),
            ]
            .map(|x| x as f32),
            peak: ((1.0 - g) / (1.0 + g)) as f32,
            radius: source.radius as f32,
            is_sphere: source.near == Near::Sphere,
            profile: source.profile,
            cone: cone.map(|x| x as f32),
            nodes: gauss_legendre(order)
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
    /// Adds a stretch of a ray: `from` in tau, `travelled` metres of medium until there. Full batches are summed up
    /// in `image`.
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
    ) {
        let i = self.count;
        self.pixel[i] = pixel;
        self.height[i] = seen.height as f32;
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
                image[self.pixel[i]][c] += sums[c][i];
            }
        }
        self.count = 0;
    }
}

/// e^x for x <= 0, to 2 units in the last place; 0 below -87.
#[inline(always)]
fn exp(x: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    let clamped = if x > -87.0 { x } else { -87.0 };
    let shifted = clamped * std::f32::consts::LOG2_E + SHIFT;
    let whole = shifted - SHIFT;
    let rest = (clamped - whole * 0.693_359_4) + whole * 2.121_944_4e-4;
    let series = 1.0
        + rest
            * (1.0
                + rest
                    * (0.5
                        + rest
                            * (0.166_666_55
                                + rest * (0.041_666_485 + rest * (0.008_363_913 + rest * 0.001_381_777_8)))));
    let power = f32::from_bits(((shifted.to_bits() as i32) << 23).wrapping_add(0x3f80_0000) as u32);
    if x < -87.0 { 0.0 } else { series * power }
}

/// ln(1 + x) for x >= 0: the logarithm of the rounded sum, times what the rounding did to x (Goldberg 1991).
#[inline(always)]
fn ln_1p(x: f32) -> f32 {
    let sum = 1.0 + x;
    // The mantissa between sqrt(1/2) and sqrt(2).
    let bits = sum.to_bits() as i32 - 0x3f35_04f3;
    let exponent = (bits >> 23) as f32;
    let m = f32::from_bits(((bits & 0x007f_ffff) + 0x3f35_04f3) as u32) - 1.0;
    let t = m / (2.0 + m);
    let t2 = t * t;
    let series = 2.0 * t * (1.0 + t2 * (0.333_333_3 + t2 * (0.200_000_5 + t2 * (0.142_8 + t2 * 0.117))));
    let log = exponent * std::f32::consts::LN_2 + series;
    let grown = sum - 1.0;
    if grown == 0.0 { x } else { log * (x / grown) }
}

/// sinh for |x| <= 1, by its series.
#[inline(always)]
fn sinh(x: f32) -> f32 {
    let x2 = x * x;
    x * (1.0 + x2 / 6.0 * (1.0 + x2 / 20.0 * (1.0 + x2 / 42.0 * (1.0 + x2 / 72.0))))
}

struct Integrate<'a> {
    setup: &'a Setup,
    batch: &'a Batch,
}

/// Where a group's panels lie, lane by lane, in s over the ray's distance from the light.
struct Panels {
    start: Lanes,
    scale: Lanes,
    step: Lanes,
    count: usize,
}

impl Integrate<'_> {
    #[inline(always)]
    fn panels(&self, group: &Group) -> Panels {
        let (setup, b) = (self.setup, self.batch);
        let mut panels = Panels {
            start: [0.0; LANES],
            scale: [0.0; LANES],
            step: [0.0; LANES],
            count: 1,
        };
        let longest = if group.low > 0.0 {
            OPAQUE / group.low
        } else {
            f32::MAX
        };
        let free_path = if group.high > 0.0 {
            1.0 / group.high
        } else {
            f32::MAX
        };
        let peak = if setup.anisotropy > 0.0 { setup.peak } else { 1.0 };
        let mut most = [1.0f32; LANES];
        let widest = if setup.profile == Profile::Uniform {
            PANEL_WIDTH as f32
        } else {
            SHAPED_WIDTH
        };
        for (i, most) in most.iter_mut().enumerate() {
            let h = b.height[i];
            let (tau0, tau1) = (b.tau[i], b.tau[i] + b.length[i]);
            let (d0, d1) = ((h * h + tau0 * tau0).sqrt(), (h * h + tau1 * tau1).sqrt());
            let (sum0, sum1) = (d0 + tau0.abs(), d1 + tau1.abs());
            let (over0, under0) = if tau0 > 0.0 { (sum0, h) } else { (h, sum0) };
            let (over1, under1) = if tau1 > 0.0 { (sum1, h) } else { (h, sum1) };
            let (z0, z1) = (over0 / under0, over1 / under1);
            let per_height = 1.0 / h;
            let change = b.length[i] * ((z0 + z1) / (d0 + d1));
            let limit = longest * per_height;
            let change = if change < limit { change } else { limit };
            let near = if setup.radius > 0.0 {
                0.5 * h / setup.radius
            } else {
                1.0
            };
            let c = peak.min(near).min(free_path * per_height);
            let per_scale = 1.0 / c;
            let (a0, a1) = (z0 * per_scale, (z0 + change) * per_scale);
            let (cosh0, cosh1) = ((1.0 + a0 * a0).sqrt(), (1.0 + a1 * a1).sqrt());
            // e^(y1 - y0) - 1, with y = asinh(a) = ln(a + cosh).
            let both = cosh0 + cosh1;
            let grown = change * per_scale * (both + a0 + a1) / (both * (a0 + cosh0));
            let width = ln_1p(grown);
            panels.start[i] = z0;
            panels.scale[i] = c;
            panels.step[i] = width;
            let (wide, deep) = (width / widest, group.high * h * change / PANEL_DEPTH as f32);
            *most = if wide > deep { wide } else { deep };
        }
        let most = most.iter().fold(1.0f32, |a, &b| if b > a { b } else { a });
        panels.count = (most.ceil() as usize).clamp(1, 4096);
        for i in 0..LANES {
            panels.step[i] /= panels.count as f32;
        }
        panels
    }

    /// The relative intensity of a spot or an area light.
    #[inline(always)]
    fn intensity(&self, i: usize, tau: f32, distance: f32) -> f32 {
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
                let x = ((1.0 - off * setup.cone[0]) * setup.cone[1]).clamp(0.0, 1.0);
                x * x * (3.0 - 2.0 * x)
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
    fn value<const SHAPED: bool, const TURNED: bool>(&self, i: usize, z: f32) -> f32 {
        let setup = self.setup;
        let h = self.batch.height[i];
        let (mirrored, z2) = (1.0 / z, z * z);
        let distance = 0.5 * h * (z + mirrored);
        let square = if TURNED {
            let turned = if setup.anisotropy >= 0.0 { z2 } else { 1.0 } / (1.0 + z2);
            setup.phase[0] + setup.phase[1] * turned
        } else {
            1.0
        };
        let cubed = if TURNED { square * square.sqrt() } else { 1.0 };
        let r = setup.radius;
        let spread = if setup.is_sphere {
            let d = if distance > r { distance } else { r };
            let sine = r / d;
            d * d * (1.0 + (1.0 - sine * sine).sqrt())
        } else {
            let slant = (distance * distance + r * r).sqrt();
            slant * (slant + distance)
        };
        let value = 2.0 * setup.phase[2] * distance * mirrored / (cubed * spread);
        if SHAPED {
            value * self.intensity(i, 0.5 * h * (z - mirrored), distance)
        } else {
            value
        }
    }

    #[inline(always)]
    fn group<const SHAPED: bool, const TURNED: bool>(&self, group: &Group, sums: &mut [Lanes; 3]) {
        let panels = self.panels(group);
        let evaluated = &group.channels[..if group.is_grey { 1 } else { group.channels.len() }];
        let (mut start, mut before, mut slope) = (panels.start, [0.0f32; LANES], [0.0f32; LANES]);
        for _ in 0..panels.count {
            for i in 0..LANES {
                slope[i] = (panels.scale[i] * panels.scale[i] + start[i] * start[i]).sqrt();
            }
            for &(place, weight) in &self.setup.nodes {
                let mut values = [0.0f32; LANES];
                let mut depths = [0.0f32; LANES];
                for i in 0..LANES {
                    let (grown, sloped) = further(start[i], slope[i], panels.step[i] * place);
                    values[i] = self.value::<SHAPED, TURNED>(i, start[i] + grown)
                        * sloped
                        * (weight * panels.step[i]);
                    depths[i] = (before[i] + grown) * self.batch.height[i];
                }
                for &c in evaluated {
                    let extinction = group.extinction[c];
                    let sum = &mut sums[c];
                    for i in 0..LANES {
                        sum[i] += values[i] * exp(-extinction * depths[i]);
                    }
                }
            }
            for i in 0..LANES {
                let (grown, _) = further(start[i], slope[i], panels.step[i]);
                before[i] += grown;
                start[i] = panels.start[i] + before[i];
            }
        }
        for &c in &group.channels[evaluated.len()..] {
            sums[c] = sums[group.channels[0]];
        }
    }
}

/// From a panel's start, where z = c sinh(y) has the slope c cosh(y), further by d in y: what z grows by, and its
/// slope there. sinh(y + d) - sinh(y) = 2 sinh(d / 2) cosh(y + d / 2), and cosh likewise.
#[inline(always)]
fn further(start: f32, slope: f32, d: f32) -> (f32, f32) {
    let sinh = sinh(0.5 * d);
    let cosh = (1.0 + sinh * sinh).sqrt();
    let twice = 2.0 * sinh;
    (
        twice * (slope * cosh + start * sinh),
        slope + twice * (slope * sinh + start * cosh),
    )
}

impl Work for Integrate<'_> {
    type Output = [Lanes; 3];

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> [Lanes; 3] {
        let mut sums = [[0.0; LANES]; 3];
        for group in &self.setup.groups {
            match (
                self.setup.profile == Profile::Uniform,
                self.setup.anisotropy == 0.0,
            ) {
                (true, true) => self.group::<false, false>(group, &mut sums),
                (true, false) => self.group::<false, true>(group, &mut sums),
                (false, true) => self.group::<true, false>(group, &mut sums),
                (false, false) => self.group::<true, true>(group, &mut sums),
            }
            for &c in &group.channels {
                for (sum, travelled) in sums[c].iter_mut().zip(&self.batch.travelled) {
                    *sum *= self.setup.scattering[c] * exp(-group.extinction[c] * travelled);
                }
            }
        }
        sums
    }
}
