//! What can be done with many numbers at once.

use std::ops::{Add, Div, Mul, Sub};

/// A set of instructions. A value of the type proves that the processor has them: only
/// [`dispatch`](super::dispatch::dispatch) makes one, having looked.
pub trait Simd: Copy {
    type Eight: Eight;
    /// Sixteen lanes, in as many registers as they take.
    type Sixteen: Vector;
    /// As many lanes as a register has.
    type Widest: Vector;

    fn eight(self) -> Self::Eight;
    fn sixteen(self) -> Self::Sixteen;
    fn widest(self) -> Self::Widest;
}

/// Floats side by side.
pub trait Vector: Copy {
    const LANES: usize;
    /// One bit for each lane.
    const ALL: u32 = (1 << Self::LANES) - 1;
    type Floats: Copy
        + Add<Output = Self::Floats>
        + Sub<Output = Self::Floats>
        + Mul<Output = Self::Floats>
        + Div<Output = Self::Floats>;
    type Mask: Copy;

    fn splat(self, value: f32) -> Self::Floats;
    /// The first `LANES` of `from`.
    fn load(self, from: &[f32]) -> Self::Floats;
    /// Two vectors from the upper and the lower halves of the first `LANES` of `from`, which are the upper halves of floats.
    fn load_halves(self, from: &[u32]) -> [Self::Floats; 2];
    /// Into the first `LANES` of `to`.
    fn store(self, value: Self::Floats, to: &mut [f32]);

    fn sqrt(self, a: Self::Floats) -> Self::Floats;
    /// `a < b ? a : b`, so `b` where either is NaN.
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a > b ? a : b`, so `b` where either is NaN.
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;

    /// `a < b`, which a NaN is not; `less_equal` likewise.
    fn less(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;
    fn less_equal(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// One bit a lane, the first lowest.
    fn bits(self, mask: Self::Mask) -> u32;
    /// `value` where the lane's bit is set, else 0.
    fn keep(self, bits: u32, value: Self::Floats) -> Self::Floats;

    #[inline(always)]
    fn abs(self, a: Self::Floats) -> Self::Floats {
        self.max(a, self.splat(0.0) - a)
    }

    /// `a > b`, one bit a lane.
    #[inline(always)]
    fn greater(self, a: Self::Floats, b: Self::Floats) -> u32 {
        self.bits(self.less(b, a))
    }
}

/// Eight lanes of floats, or of whole numbers of 32 bits, which wrap around.
pub trait Eight: Vector {
    type Ints: Copy;

    fn splat_int(self, value: i32) -> Self::Ints;
    fn load_ints(self, from: &[u32; 8]) -> Self::Ints;
    fn store_ints(self, value: Self::Ints, to: &mut [u32; 8]);
    fn add_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    fn mul_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    fn and_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    fn or_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    fn xor_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    /// Whether every bit of every lane is set.
    fn all_set(self, a: Self::Ints) -> bool;
    /// Lanes below zero.
    fn negative(self, a: Self::Ints) -> Self::Mask;

    fn select(self, mask: Self::Mask, yes: Self::Floats, no: Self::Floats) -> Self::Floats;
    fn select_ints(self, mask: Self::Mask, yes: Self::Ints, no: Self::Ints) -> Self::Ints;
    /// The largest of the lanes, none of which may be NaN.
    fn largest(self, a: Self::Floats) -> f32;
}
