//! Panels of nodes along sixteen stretches, and the sums over them.

use super::batch::Integrate;
use super::functions::{exp, further, larger, ln_1p, smaller};
use super::setup::{Group, MOST_NODES, NEARBY_WIDTH, OPAQUE, SHAPED_WIDTH};
use crate::effects::volumetric_light::integral::{PANEL_DEPTH, PANEL_WIDTH};
use crate::effects::volumetric_light::source::Profile;
use crate::simd::{LANES, Lanes, Simd, Work};

/// Rays that pass a spot within its radius over this see it as many directions. Further away the mean of its
/// intensity and that of the phase function, each by itself, are within 0.1% of the mean of their product.
const NEAR_SPOT: f32 = 0.06;
/// The same of lights that shine evenly, where the phase function's mean alone is within 0.4%...
const NEAR_EVEN: f32 = 0.25;
/// ... and no sharper than this: of sharper ones sixteen directions would be sixteen peaks.
const SHARPEST: f32 = 0.9;

/// Scales below this share of the s that a stretch begins at move no node in single precision, and their inverse's
/// square would be beyond it.
const LEAST_SCALE: f32 = 1e-6;
/// Once s has grown by this share of itself and of the ray's distance from the light, nothing that follows counts, and
/// its square would be beyond single precision.
const MOST_GROWTH: f32 = 1e9;

/// Where a group's panels lie, lane by lane, in s over the ray's distance from the light.
struct Panels {
    start: Lanes,
    scale: Lanes,
    step: Lanes,
    count: usize,
}

impl Integrate<'_> {
    /// Whether any of these rays comes so near that the light is many directions.
    fn is_nearby(&self) -> bool {
        let setup = self.setup;
        let turned = setup.anisotropy.abs();
        let near = match setup.profile {
            Profile::Spot { .. } => NEAR_SPOT,
            Profile::Uniform if turned > 0.0 && turned <= SHARPEST => NEAR_EVEN,
            _ => return false,
        };
        let nearest = self.batch.height.iter().fold(f32::INFINITY, |a, &b| a.min(b));
        setup.radius > near * nearest
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // sixteen lanes go together
    fn panels(&self, group: &Group, widest: f32) -> Panels {
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
        let near = if setup.radius > 0.0 { setup.near } else { f32::MAX };
        let mut most = [1.0f32; LANES];
        // Only selections, no branches nor `min`, so that the lanes go together.
        for i in 0..LANES {
            let h = b.height[i];
            let (tau0, tau1) = (b.tau[i], b.tau[i] + b.length[i]);
            let (d0, d1) = ((h * h + tau0 * tau0).sqrt(), (h * h + tau1 * tau1).sqrt());
            let (sum0, sum1) = (d0 + tau0.abs(), d1 + tau1.abs());
            let per_height = 1.0 / h;
            let (z0, z1) = (
                if tau0 > 0.0 { sum0 * per_height } else { h / sum0 },
                if tau1 > 0.0 { sum1 * per_height } else { h / sum1 },
            );
            let most_change = smaller(longest * per_height, MOST_GROWTH * (1.0 + z0));
            let change = smaller(b.length[i] * ((z0 + z1) / (d0 + d1)), most_change);
            let c = smaller(smaller(peak, h * near), free_path * per_height);
            let c = larger(c, LEAST_SCALE * z0);
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
            most[i] = larger(width / widest, group.high * h * change / PANEL_DEPTH as f32);
        }
        let most = most.iter().fold(1.0f32, |a, &b| if b > a { b } else { a });
        panels.count = (most.ceil() as usize).clamp(1, 4096);
        for i in 0..LANES {
            panels.step[i] /= panels.count as f32;
        }
        panels
    }

    #[inline(always)]
    fn group<const SHAPED: bool, const TURNED: bool, const NEARBY: bool>(
        &self,
        group: &Group,
        sums: &mut [Lanes; 3],
    ) {
        let widest = match (SHAPED, NEARBY) {
            (false, _) => PANEL_WIDTH as f32,
            (true, false) => SHAPED_WIDTH,
            (true, true) => NEARBY_WIDTH,
        };
        let panels = self.panels(group, widest);
        let evaluated = &group.channels[..if group.is_grey { 1 } else { group.channels.len() }];
        // All panels of a stretch are as wide: how far the nodes, and the end, lie from a panel's start.
        let mut places = [[[0.0f32; LANES]; 2]; MOST_NODES + 1];
        let nodes = &self.setup.nodes;
        for (place, at) in nodes.iter().map(|node| node.0).chain([1.0]).zip(&mut places) {
            let [sinh, cosh_less_1] = at;
            for i in 0..LANES {
                (sinh[i], cosh_less_1[i]) = further(panels.step[i] * place);
            }
        }
        let (mut start, mut before, mut slope) = (panels.start, [0.0f32; LANES], [0.0f32; LANES]);
        for _ in 0..panels.count {
            for i in 0..LANES {
                slope[i] = (panels.scale[i] * panels.scale[i] + start[i] * start[i]).sqrt();
            }
            for (&(_, weight), [sinh, cosh_less_1]) in nodes.iter().zip(&places) {
                let (mut values, mut depths, mut z) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
                for i in 0..LANES {
                    let grown = start[i] * cosh_less_1[i] + slope[i] * sinh[i];
                    let sloped = slope[i] + slope[i] * cosh_less_1[i] + start[i] * sinh[i];
                    z[i] = start[i] + grown;
                    values[i] =
                        self.value::<SHAPED, TURNED, NEARBY>(i, z[i]) * sloped * (weight * panels.step[i]);
                    depths[i] = (before[i] + grown) * self.batch.height[i];
                }
                if NEARBY {
                    let shares = self.nearby::<SHAPED>(&z);
                    for i in 0..LANES {
                        values[i] *= shares[i];
                    }
                }
                for &c in evaluated {
                    let extinction = group.extinction[c];
                    let sum = &mut sums[c];
                    for i in 0..LANES {
                        sum[i] += values[i] * exp(-extinction * depths[i]);
                    }
                }
            }
            let [sinh, cosh_less_1] = &places[nodes.len()];
            for i in 0..LANES {
                before[i] += start[i] * cosh_less_1[i] + slope[i] * sinh[i];
                start[i] = panels.start[i] + before[i];
            }
        }
        for &c in &group.channels[evaluated.len()..] {
            sums[c] = sums[group.channels[0]];
        }
    }
}

impl Work for Integrate<'_> {
    type Output = [Lanes; 3];

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> [Lanes; 3] {
        let mut sums = [[0.0; LANES]; 3];
        for group in &self.setup.groups {
            let even = self.setup.profile == Profile::Uniform;
            match (even, self.setup.anisotropy == 0.0) {
                (true, _) if self.is_nearby() => self.group::<false, true, true>(group, &mut sums),
                (true, true) => self.group::<false, false, false>(group, &mut sums),
                (true, false) => self.group::<false, true, false>(group, &mut sums),
                (false, _) if self.is_nearby() => self.group::<true, true, true>(group, &mut sums),
                (false, true) => self.group::<true, false, false>(group, &mut sums),
                (false, false) => self.group::<true, true, false>(group, &mut sums),
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
