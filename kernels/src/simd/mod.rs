//! Many numbers at a time, with the widest instructions that this processor has, chosen while running.
//!
//! Every operation is rounded exactly and none are fused or put in another order, so all processors give the same bits.

mod dispatch;
mod pair;
mod portable;
mod vector;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use dispatch::{Work, dispatch};
pub use vector::{Eight, Simd, Vector};

/// Floats of the widest register; the lanes of every vector divide it. Also the lanes of [`Simd::Sixteen`].
pub const LANES: usize = 16;

/// What a [`Simd::Sixteen`] is loaded from.
pub type Lanes = [f32; LANES];
