//! Twice the lanes of a register, in two.

use super::vector::Vector;
use std::ops::{Add, Div, Mul, Sub};

#[derive(Clone, Copy)]
pub struct Pair<V>(pub V);

/// The first half of the lanes, and the second.
#[derive(Clone, Copy)]
pub struct Both<T>(T, T);

macro_rules! operators {
    ($($operator:ident $name:ident),*) => {
        $(impl<T: $operator<Output = T>> $operator for Both<T> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Both(self.0.$name(other.0), self.1.$name(other.1))
            }
        })*
    };
}

operators!(Add add, Sub sub, Mul mul, Div div);

macro_rules! both {
    ($(fn $name:ident($($argument:ident: $kind:ident),*) -> $result:ident;)*) => {
        $(#[inline(always)]
        fn $name(self, $($argument: Self::$kind),*) -> Self::$result {
            Both(self.0.$name($($argument.0),*), self.0.$name($($argument.1),*))
        })*
    };
}

impl<V: Vector> Vector for Pair<V> {
    const LANES: usize = 2 * V::LANES;
    type Floats = Both<V::Floats>;
    type Mask = Both<V::Mask>;

    both! {
        fn sqrt(a: Floats) -> Floats;
        fn min(a: Floats, b: Floats) -> Floats;
        fn max(a: Floats, b: Floats) -> Floats;
        fn less(a: Floats, b: Floats) -> Mask;
        fn less_equal(a: Floats, b: Floats) -> Mask;
        fn and(a: Mask, b: Mask) -> Mask;
        fn or(a: Mask, b: Mask) -> Mask;
    }

    #[inline(always)]
    fn splat(self, value: f32) -> Self::Floats {
        Both(self.0.splat(value), self.0.splat(value))
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> Self::Floats {
        Both(self.0.load(from), self.0.load(&from[V::LANES..]))
    }
    #[inline(always)]
    fn load_halves(self, from: &[u32]) -> [Self::Floats; 2] {
        let ([a, b], [c, d]) = (self.0.load_halves(from), self.0.load_halves(&from[V::LANES..]));
        [Both(a, c), Both(b, d)]
    }
    #[inline(always)]
    fn store(self, value: Self::Floats, to: &mut [f32]) {
        self.0.store(value.0, to);
        self.0.store(value.1, &mut to[V::LANES..]);
    }
    #[inline(always)]
    fn bits(self, mask: Self::Mask) -> u32 {
        self.0.bits(mask.0) | self.0.bits(mask.1) << V::LANES
    }
    #[inline(always)]
    fn keep(self, bits: u32, value: Self::Floats) -> Self::Floats {
        Both(self.0.keep(bits, value.0), self.0.keep(bits >> V::LANES, value.1))
    }
}
