//! Stretches of rays, side by side.

use super::setup::Setup;
use crate::simd::{LANES, Lanes};

/// Up to sixteen stretches, and the pixels that they belong to.
#[derive(Default)]
pub struct Batch {
    pub count: usize,
    pub pixel: [usize; LANES],
    pub weight: Lanes,
    pub height: Lanes,
    pub tau: Lanes,
    pub length: Lanes,
    pub travelled: Lanes,
    pub along0: Lanes,
    pub along1: Lanes,
    pub across0: Lanes,
    pub across2: Lanes,
    pub across_tau: Lanes,
}

/// Work for [`dispatch`](crate::simd::dispatch).
pub struct Integrate<'a> {
    pub setup: &'a Setup,
    pub batch: &'a Batch,
}
