//! Exact edge functions over whole pixels.

use super::grid::{SUBPIXEL_BITS, TILE};
use std::ops::{Mul, Shr, Sub};

/// One edge's half plane over whole pixels: inside where `at + dx * x + dy * y >= 0`.
///
/// Pixel centres are 256 subpixels apart, so the exact edge function changes by multiples of 256 from
/// pixel to pixel and can be divided by 256, rounding down, without moving its sign anywhere. The
/// top-left rule is in `at`: a pixel centre on an edge belongs to the triangle on its right or below.
#[derive(Clone, Copy, Default)]
pub struct Edge<T> {
    pub at: T,
    pub dx: T,
    pub dy: T,
}

/// The edge from `a` to `b` in subpixels, inside on its left (y up). `T` must hold the products.
#[inline(always)]
pub fn edge<T>(a: [T; 2], b: [T; 2]) -> Edge<T>
where
    T: Copy + Default + PartialOrd + From<bool> + Sub<Output = T> + Mul<Output = T> + Shr<u32, Output = T>,
{
    let (x, y, zero) = (b[0] - a[0], b[1] - a[1], T::default());
    let owns = y < zero || (y == zero && x < zero);
    Edge {
        at: (y * a[0] - x * a[1] - T::from(!owns)) >> SUBPIXEL_BITS,
        dx: zero - y,
        dy: x,
    }
}

impl Edge<i64> {
    fn value(&self, at: [i32; 2]) -> i64 {
        self.at + self.dx * i64::from(at[0]) + self.dy * i64::from(at[1])
    }

    /// Largest value over the pixels of the tile that starts at `origin`.
    pub fn largest(&self, origin: [i32; 2]) -> i64 {
        self.value(origin) + (self.dx.max(0) + self.dy.max(0)) * (TILE as i64 - 1)
    }

    /// Smallest value over the pixels of the tile that starts at `origin`.
    pub fn smallest(&self, origin: [i32; 2]) -> i64 {
        self.value(origin) + (self.dx.min(0) + self.dy.min(0)) * (TILE as i64 - 1)
    }
}
