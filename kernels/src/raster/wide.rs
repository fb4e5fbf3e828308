//! Some neighbouring pixels of a row at a time, in double precision.

use super::block::BLOCK_WIDTH;
use crate::vector::Vec3;

/// Pixels of a row that are worked out at once: as many as an AVX2 register holds in double precision.
pub const WIDE: usize = BLOCK_WIDTH;

/// One number a pixel, and vectors of them by axis.
pub type Wide = [f64; WIDE];
pub type Wide3 = [Wide; 3];

/// Neighbouring pixels of a row; what is `wanted` of them, the others may be anything.
#[derive(Clone, Copy)]
pub struct Pixels {
    pub first: [i32; 2],
    /// Where each is sampled: column and row.
    pub x: Wide,
    pub y: Wide,
    pub wanted: [bool; WIDE],
}

impl Pixels {
    /// From pixel `first` on to the right, at their centres.
    #[inline(always)]
    pub fn new(first: [i32; 2], wanted: [bool; WIDE]) -> Self {
        Pixels {
            first,
            x: std::array::from_fn(|l| f64::from(first[0] + l as i32)),
            y: [f64::from(first[1]); WIDE],
            wanted,
        }
    }

    /// What is affine over the image: its value at the corner, its change from column to column and from row to row.
    #[inline(always)]
    pub fn affine(&self, [at, dx, dy]: Vec3) -> Wide {
        wide(|l| at + dx * self.x[l] + dy * self.y[l])
    }
}

#[inline(always)]
pub fn wide(of: impl Fn(usize) -> f64) -> Wide {
    std::array::from_fn(of)
}

/// The product with a vector that all pixels share.
#[inline(always)]
pub fn wide_dot(a: Vec3, b: &Wide3) -> Wide {
    wide(|l| a[0] * b[0][l] + a[1] * b[1][l] + a[2] * b[2][l])
}

/// A pixel's vector.
#[inline(always)]
pub fn lane(v: &Wide3, l: usize) -> Vec3 {
    [v[0][l], v[1][l], v[2][l]]
}
