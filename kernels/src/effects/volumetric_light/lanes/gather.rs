//! Stretches are gathered until sixteen are there.

use super::batch::{Batch, Integrate};
use super::functions::larger;
use super::setup::Setup;
use crate::effects::volumetric_light::source::{CLOSEST_SHARE, Seen};
use crate::simd::{LANES, dispatch};

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
