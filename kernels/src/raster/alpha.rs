//! Alpha clip: fragments that the material's texture cuts away.

use super::camera::Camera;
use super::hit::Locator;
use super::simd::Lanes;
use super::tile::BLOCK_WIDTH;
use crate::geometry::Data;

/// Looks up which fragments of a triangle are there.
pub struct AlphaTest<'a> {
    pub data: &'a Data,
    pub first_ids: &'a [u32],
    pub camera: &'a Camera,
}

impl AlphaTest<'_> {
    /// Sets the depths of absent fragments of a block, whose first pixel is given, to infinity.
    #[inline(never)]
    pub fn cut(&self, depths: &mut Lanes<f32>, id: u32, [x, y]: [usize; 2]) {
        let locator = Locator::new(self.data, self.first_ids, self.camera, id);
        let cutout = &self.data.cutouts[locator.material() as usize];
        for (lane, depth) in depths.0.iter_mut().enumerate() {
            if depth.is_finite() {
                let ray = self.camera.ray(x + lane % BLOCK_WIDTH, y + lane / BLOCK_WIDTH);
                let weights = locator.weights(self.camera, &ray);
                if !cutout.is_opaque(locator.uv(weights)) {
                    *depth = f32::INFINITY;
                }
            }
        }
    }
}
