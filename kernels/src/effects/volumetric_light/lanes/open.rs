//! A row of rays from one eye to a source that nothing shadows: no intervals to look for.

use super::batch::{Batch, Integrate};
use super::functions::{exp, larger, smaller};
use super::setup::{PER_SPHERE, Setup};
use crate::effects::volumetric_light::rays::Lattice;
use crate::effects::volumetric_light::source::{CLOSEST, CLOSEST_SHARE, Source};
use crate::simd::{LANES, Lanes, Simd, Work};

/// A row of a lattice whose rays all start at one eye, seen by a source that shines evenly and that nothing shadows.
pub struct OpenRow<'a> {
    pub setup: &'a Setup,
    pub lattice: &'a Lattice,
    pub source: &'a Source,
    pub y: usize,
    pub depths: &'a [f32],
    pub image: &'a mut [[f32; 3]],
}

/// What the rays of a row have in common, in single precision.
struct Common {
    /// Of the direction before its length is made 1, by column: base + a right.
    base: [f32; 3],
    right: [f32; 3],
    step: f32,
    near: f32,
    /// From the source to the eye; of a distant source where its light goes.
    light: [f32; 3],
    closest: f32,
    /// Whether light mostly goes on.
    forwards: bool,
}

impl Common {
    /// Sixteen rays from column slope `first` on, which end at the depths `ends`; of a distant source, the phase
    /// function's argument in `tau`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // sixteen lanes go together
    fn rays<const DISTANT: bool>(&self, first: f32, ends: &Lanes, batch: &mut Batch) {
        let (base, right, v) = (self.base, self.right, self.light);
        for i in 0..LANES {
            let a = first + i as f32 * self.step;
            let d = [
                base[0] + a * right[0],
                base[1] + a * right[1],
                base[2] + a * right[2],
            ];
            let per_depth = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            let unit = 1.0 / per_depth;
            let d = [d[0] * unit, d[1] * unit, d[2] * unit];
            let cross = [
                v[1] * d[2] - v[2] * d[1],
                v[2] * d[0] - v[0] * d[2],
                v[0] * d[1] - v[1] * d[0],
            ];
            let square = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2];
            let along = v[0] * d[0] + v[1] * d[1] + v[2] * d[2];
            let start = self.near * per_depth;
            batch.length[i] = larger(smaller(ends[i], 1e15) * per_depth - start, 0.0);
            if DISTANT {
                // (1 - cos) / 2 with cos = -along, or (1 + cos) / 2 for backward phases.
                let small = 0.5 * square / (1.0 + along.abs());
                batch.tau[i] = if (along < 0.0) == self.forwards {
                    small
                } else {
                    1.0 - small
                };
            } else {
                let tau = start + along;
                let height = larger(larger(square.sqrt(), self.closest), CLOSEST_SHARE * tau);
                batch.height[i] = height;
                batch.tau[i] = tau;
                batch.travelled[i] = (height * height + tau * tau).sqrt();
            }
        }
    }
}

impl Work for OpenRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (lattice, setup) = (self.lattice, self.setup);
        let single = |v: [f64; 3]| v.map(|x| x as f32);
        let rows = lattice.first[1] + self.y as f64 * lattice.step[1];
        let distant = self.source.distant;
        let from_light = single(std::array::from_fn(|i| lattice.eye[i] - self.source.position[i]));
        let away = from_light.iter().map(|x| x * x).sum::<f32>().sqrt();
        let common = Common {
            base: single(std::array::from_fn(|i| lattice.forward[i] + rows * lattice.up[i])),
            right: single(lattice.right),
            step: lattice.step[0] as f32,
            near: lattice.near as f32,
            light: if distant {
                single(self.source.axis)
            } else {
                from_light
            },
            closest: CLOSEST.max(CLOSEST_SHARE * (away + setup.radius)),
            forwards: setup.anisotropy >= 0.0,
        };
        let mut batch = Batch::default();
        for (block, (depths, pixels)) in self
            .depths
            .chunks(LANES)
            .zip(self.image.chunks_mut(LANES))
            .enumerate()
        {
            let mut ends = [0.0f32; LANES];
            ends[..depths.len()].copy_from_slice(depths);
            let first = (lattice.first[0] + (block * LANES) as f64 * lattice.step[0]) as f32;
            let sums = if distant {
                common.rays::<true>(first, &ends, &mut batch);
                setup.distant(&batch.tau, &batch.length)
            } else {
                common.rays::<false>(first, &ends, &mut batch);
                Integrate { setup, batch: &batch }.run(simd)
            };
            for (i, pixel) in pixels.iter_mut().enumerate() {
                *pixel = [sums[0][i], sums[1][i], sums[2][i]];
            }
        }
    }
}

impl Setup {
    /// [`crate::effects::volumetric_light::integral::distant`] from the rays' starts on; `turn` as `Medium::phase` takes it.
    #[inline(always)]
    fn distant(&self, turn: &Lanes, length: &Lanes) -> [Lanes; 3] {
        let mut phase = [0.0; LANES];
        for (phase, turn) in phase.iter_mut().zip(turn) {
            let missing = self.phase[0];
            let square = missing * missing + 4.0 * (1.0 - missing) * turn;
            *phase = PER_SPHERE * missing * (2.0 - missing) / (square * square.sqrt());
        }
        let mut sums = [[0.0; LANES]; 3];
        for group in &self.groups {
            for &c in &group.channels {
                let (extinction, scattering) = (group.extinction[c], self.scattering[c]);
                for i in 0..LANES {
                    let x = extinction * length[i];
                    // The series of (1 - e^-x) / x, where the difference would lose digits.
                    let thin = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0)));
                    let mean = if x < 0.25 { thin } else { (1.0 - exp(-x)) / x };
                    sums[c][i] = phase[i] * scattering * length[i] * mean;
                }
            }
        }
        sums
    }
}
