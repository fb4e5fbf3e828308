//! What becomes of fragments.

use crate::simd::Eight;

/// Keeps what a tile's pixels need of the fragments. Owned by the one task that draws the tile.
pub trait Sink {
    /// Whether a block keeps nothing as far away as this, so that its fragments need not be worked out.
    #[inline(always)]
    fn hides(&self, _block: usize, _nearest: f32) -> bool {
        false
    }
    /// Whether any of a block's depths, infinite where the triangle is not, would be kept.
    fn wants<V: Eight>(&self, v: V, block: usize, depths: V::Floats) -> bool;
    /// Keeps what it wants of them.
    fn keep<V: Eight>(&mut self, v: V, block: usize, depths: V::Floats, id: u32);
}
