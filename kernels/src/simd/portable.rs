//! Any processor: loops over arrays.

use super::vector::{Eight, Simd, Vector};
use std::array::from_fn;
use std::ops::{Add, Div, Mul, Sub};

#[derive(Clone, Copy)]
pub struct Portable;

impl Simd for Portable {
    type Eight = Array<8>;
    type Sixteen = Array<16>;
    type Widest = Array<8>;

    fn eight(self) -> Array<8> {
        Array
    }
    fn sixteen(self) -> Array<16> {
        Array
    }
    fn widest(self) -> Array<8> {
        Array
    }
}

#[derive(Clone, Copy)]
pub struct Array<const N: usize>;

macro_rules! lanes {
    ($(fn $name:ident($($argument:ident: $kind:ty),*) -> $result:ty { $lane:ident => $value:expr })*) => {
        $(#[inline(always)]
        fn $name(self, $($argument: $kind),*) -> $result {
            from_fn(|$lane| $value)
        })*
    };
}

#[derive(Clone, Copy)]
pub struct Floats<const N: usize>([f32; N]);

macro_rules! operators {
    ($($operator:ident $name:ident),*) => {
        $(impl<const N: usize> $operator for Floats<N> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Floats(from_fn(|i| self.0[i].$name(other.0[i])))
            }
        })*
    };
}

operators!(Add add, Sub sub, Mul mul, Div div);

macro_rules! floats {
    ($(fn $name:ident($($argument:ident: $kind:ty),*) { $lane:ident => $value:expr })*) => {
        $(#[inline(always)]
        fn $name(self, $($argument: $kind),*) -> Self::Floats {
            Floats(from_fn(|$lane| $value))
        })*
    };
}

impl<const N: usize> Vector for Array<N> {
    const LANES: usize = N;
    type Floats = Floats<N>;
    /// -1 where it holds, else 0.
    type Mask = [i32; N];

    floats! {
        fn splat(value: f32) { _i => value }
        fn load(from: &[f32]) { i => from[i] }
        fn sqrt(a: Floats<N>) { i => a.0[i].sqrt() }
        fn min(a: Floats<N>, b: Floats<N>) { i => if a.0[i] < b.0[i] { a.0[i] } else { b.0[i] } }
        fn max(a: Floats<N>, b: Floats<N>) { i => if a.0[i] > b.0[i] { a.0[i] } else { b.0[i] } }
        fn keep(bits: u32, value: Floats<N>) { i => if bits >> i & 1 == 1 { value.0[i] } else { 0.0 } }
    }

    lanes! {
        fn less(a: Floats<N>, b: Floats<N>) -> [i32; N] { i => -i32::from(a.0[i] < b.0[i]) }
        fn less_equal(a: Floats<N>, b: Floats<N>) -> [i32; N] { i => -i32::from(a.0[i] <= b.0[i]) }
        fn and(a: [i32; N], b: [i32; N]) -> [i32; N] { i => a[i] & b[i] }
        fn or(a: [i32; N], b: [i32; N]) -> [i32; N] { i => a[i] | b[i] }
    }

    #[inline(always)]
    fn load_halves(self, from: &[u32]) -> [Floats<N>; 2] {
        [
            Floats(from_fn(|i| f32::from_bits(from[i] & 0xffff_0000))),
            Floats(from_fn(|i| f32::from_bits(from[i] << 16))),
        ]
    }
    #[inline(always)]
    fn store(self, value: Floats<N>, to: &mut [f32]) {
        to[..N].copy_from_slice(&value.0);
    }
    #[inline(always)]
    fn bits(self, mask: [i32; N]) -> u32 {
        (0..N).fold(0, |bits, i| bits | u32::from(mask[i] < 0) << i)
    }
}

impl Eight for Array<8> {
    type Ints = [u32; 8];

    lanes! {
        fn splat_int(value: i32) -> [u32; 8] { _i => value.cast_unsigned() }
        fn load_ints(from: &[u32; 8]) -> [u32; 8] { i => from[i] }
        fn add_ints(a: [u32; 8], b: [u32; 8]) -> [u32; 8] { i => a[i].wrapping_add(b[i]) }
        fn mul_ints(a: [u32; 8], b: [u32; 8]) -> [u32; 8] { i => a[i].wrapping_mul(b[i]) }
        fn and_ints(a: [u32; 8], b: [u32; 8]) -> [u32; 8] { i => a[i] & b[i] }
        fn or_ints(a: [u32; 8], b: [u32; 8]) -> [u32; 8] { i => a[i] | b[i] }
        fn xor_ints(a: [u32; 8], b: [u32; 8]) -> [u32; 8] { i => a[i] ^ b[i] }
        fn negative(a: [u32; 8]) -> [i32; 8] { i => a[i].cast_signed() >> 31 }
        fn select_ints(mask: [i32; 8], yes: [u32; 8], no: [u32; 8]) -> [u32; 8] {
            i => if mask[i] < 0 { yes[i] } else { no[i] }
        }
    }

    floats! {
        fn select(mask: [i32; 8], yes: Floats<8>, no: Floats<8>) { i => if mask[i] < 0 { yes.0[i] } else { no.0[i] } }
    }

    #[inline(always)]
    fn store_ints(self, value: [u32; 8], to: &mut [u32; 8]) {
        *to = value;
    }
    #[inline(always)]
    fn all_set(self, a: [u32; 8]) -> bool {
        a == [u32::MAX; 8]
    }
    #[inline(always)]
    fn largest(self, a: Floats<8>) -> f32 {
        a.0.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }
}
