//! Points under way.

use super::light::{Bits, Seen};

/// A point that the light may be hidden from.
pub struct Open {
    pub seen: Seen,
    /// Samples hidden so far.
    pub hidden: Bits,
    /// The rise above the point at which texels of level 0 are as fine as they need be.
    pub unit: f32,
    /// One beyond the last map that it reads.
    pub maps_end: usize,
    /// Where the result goes.
    pub place: usize,
}
