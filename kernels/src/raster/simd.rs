//! Eight pixels at a time, with the widest instructions that this processor has, chosen while running.
//!
//! Rust neither fuses nor reorders floating-point operations and every operation here is exactly
//! rounded, so both sets of instructions give the same bits.

#[cfg(target_arch = "x86_64")]
use std::sync::LazyLock;

/// Pixels in a block.
pub const LANES: usize = 8;

/// One value a pixel, where a vector register can load it at once.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Lanes<T>(pub [T; LANES]);

/// What the inner loops do. Masks are lanes whose sign bit is set where they hold.
pub trait Vector: Copy {
    type Float: Copy;
    type Int: Copy;

    fn floats(self, from: &Lanes<f32>) -> Self::Float;
    fn ints(self, from: &Lanes<i32>) -> Self::Int;
    fn store_floats(self, value: Self::Float, to: &mut Lanes<f32>);
    fn store_ints(self, value: Self::Int, to: &mut Lanes<i32>);
    fn splat(self, value: f32) -> Self::Float;
    fn splat_int(self, value: i32) -> Self::Int;

    fn add(self, a: Self::Float, b: Self::Float) -> Self::Float;
    fn mul(self, a: Self::Float, b: Self::Float) -> Self::Float;
    fn div(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// `a < b ? a : b`, so `b` where either is NaN.
    fn min(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// `a > b ? a : b`, so `b` where either is NaN.
    fn max(self, a: Self::Float, b: Self::Float) -> Self::Float;
    fn add_int(self, a: Self::Int, b: Self::Int) -> Self::Int;
    fn mul_int(self, a: Self::Int, b: Self::Int) -> Self::Int;
    fn or(self, a: Self::Int, b: Self::Int) -> Self::Int;

    fn less(self, a: Self::Float, b: Self::Float) -> Self::Int;
    fn select(self, mask: Self::Int, yes: Self::Float, no: Self::Float) -> Self::Float;
    fn select_int(self, mask: Self::Int, yes: Self::Int, no: Self::Int) -> Self::Int;
    /// The mask as one bit a lane.
    fn bits(self, mask: Self::Int) -> u32;
    /// The largest of the lanes, none of which may be NaN.
    fn largest(self, a: Self::Float) -> f32;
}

/// Any processor.
#[derive(Clone, Copy)]
pub struct Portable;

#[inline(always)]
fn each<A: Copy, B: Copy, R>(a: [A; LANES], b: [B; LANES], f: impl Fn(A, B) -> R) -> [R; LANES] {
    std::array::from_fn(|l| f(a[l], b[l]))
}

impl Vector for Portable {
    type Float = [f32; LANES];
    type Int = [i32; LANES];

    fn floats(self, from: &Lanes<f32>) -> Self::Float {
        from.0
    }
    fn ints(self, from: &Lanes<i32>) -> Self::Int {
        from.0
    }
    fn store_floats(self, value: Self::Float, to: &mut Lanes<f32>) {
        to.0 = value;
    }
    fn store_ints(self, value: Self::Int, to: &mut Lanes<i32>) {
        to.0 = value;
    }
    fn splat(self, value: f32) -> Self::Float {
        [value; LANES]
    }
    fn splat_int(self, value: i32) -> Self::Int {
        [value; LANES]
    }
    fn add(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(a, b, |a, b| a + b)
    }
    fn mul(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(a, b, |a, b| a * b)
    }
    fn div(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(a, b, |a, b| a / b)
    }
    fn min(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    fn max(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(a, b, |a, b| if a > b { a } else { b })
    }
    fn add_int(self, a: Self::Int, b: Self::Int) -> Self::Int {
        each(a, b, i32::wrapping_add)
    }
    fn mul_int(self, a: Self::Int, b: Self::Int) -> Self::Int {
        each(a, b, i32::wrapping_mul)
    }
    fn or(self, a: Self::Int, b: Self::Int) -> Self::Int {
        each(a, b, |a, b| a | b)
    }
    fn less(self, a: Self::Float, b: Self::Float) -> Self::Int {
        each(a, b, |a, b| -i32::from(a < b))
    }
    fn select(self, mask: Self::Int, yes: Self::Float, no: Self::Float) -> Self::Float {
        std::array::from_fn(|l| if mask[l] < 0 { yes[l] } else { no[l] })
    }
    fn select_int(self, mask: Self::Int, yes: Self::Int, no: Self::Int) -> Self::Int {
        std::array::from_fn(|l| if mask[l] < 0 { yes[l] } else { no[l] })
    }
    fn bits(self, mask: Self::Int) -> u32 {
        (0..LANES).fold(0, |bits, l| bits | u32::from(mask[l] < 0) << l)
    }
    fn largest(self, a: Self::Float) -> f32 {
        a.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Lanes, Vector};
    use std::arch::x86_64::*;

    /// Proof that the processor has AVX2: only [`super::run_widest`] makes one, having looked.
    #[derive(Clone, Copy)]
    pub struct Avx2(pub(super) ());

    macro_rules! avx2 {
        ($operation:expr) => {
            // SAFETY: the instruction needs AVX2, which holding an `Avx2` proves; where it reads or writes
            // memory, it does so through a reference to `Lanes`, which has its 32 bytes and alignment.
            unsafe { $operation }
        };
    }

    impl Vector for Avx2 {
        type Float = __m256;
        type Int = __m256i;

        #[inline(always)]
        fn floats(self, from: &Lanes<f32>) -> __m256 {
            avx2!(_mm256_load_ps(from.0.as_ptr()))
        }
        #[inline(always)]
        fn ints(self, from: &Lanes<i32>) -> __m256i {
            avx2!(_mm256_load_si256(from.0.as_ptr().cast()))
        }
        #[inline(always)]
        fn store_floats(self, value: __m256, to: &mut Lanes<f32>) {
            avx2!(_mm256_store_ps(to.0.as_mut_ptr(), value))
        }
        #[inline(always)]
        fn store_ints(self, value: __m256i, to: &mut Lanes<i32>) {
            avx2!(_mm256_store_si256(to.0.as_mut_ptr().cast(), value))
        }
        #[inline(always)]
        fn splat(self, value: f32) -> __m256 {
            avx2!(_mm256_set1_ps(value))
        }
        #[inline(always)]
        fn splat_int(self, value: i32) -> __m256i {
            avx2!(_mm256_set1_epi32(value))
        }
        #[inline(always)]
        fn add(self, a: __m256, b: __m256) -> __m256 {
            avx2!(_mm256_add_ps(a, b))
        }
        #[inline(always)]
        fn mul(self, a: __m256, b: __m256) -> __m256 {
            avx2!(_mm256_mul_ps(a, b))
        }
        #[inline(always)]
        fn div(self, a: __m256, b: __m256) -> __m256 {
            avx2!(_mm256_div_ps(a, b))
        }
        #[inline(always)]
        fn min(self, a: __m256, b: __m256) -> __m256 {
            avx2!(_mm256_min_ps(a, b))
        }
        #[inline(always)]
        fn max(self, a: __m256, b: __m256) -> __m256 {
            avx2!(_mm256_max_ps(a, b))
        }
        #[inline(always)]
        fn add_int(self, a: __m256i, b: __m256i) -> __m256i {
            avx2!(_mm256_add_epi32(a, b))
        }
        #[inline(always)]
        fn mul_int(self, a: __m256i, b: __m256i) -> __m256i {
            avx2!(_mm256_mullo_epi32(a, b))
        }
        #[inline(always)]
        fn or(self, a: __m256i, b: __m256i) -> __m256i {
            avx2!(_mm256_or_si256(a, b))
        }
        #[inline(always)]
        fn less(self, a: __m256, b: __m256) -> __m256i {
            avx2!(_mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)))
        }
        #[inline(always)]
        fn select(self, mask: __m256i, yes: __m256, no: __m256) -> __m256 {
            avx2!(_mm256_blendv_ps(no, yes, _mm256_castsi256_ps(mask)))
        }
        #[inline(always)]
        fn select_int(self, mask: __m256i, yes: __m256i, no: __m256i) -> __m256i {
            let (yes, no) = avx2!((_mm256_castsi256_ps(yes), _mm256_castsi256_ps(no)));
            avx2!(_mm256_castps_si256(self.select(mask, yes, no)))
        }
        #[inline(always)]
        fn bits(self, mask: __m256i) -> u32 {
            avx2!(_mm256_movemask_ps(_mm256_castsi256_ps(mask)) as u32)
        }
        #[inline(always)]
        fn largest(self, a: __m256) -> f32 {
            let halves = avx2!(_mm_max_ps(
                _mm256_castps256_ps128(a),
                _mm256_extractf128_ps::<1>(a)
            ));
            let pairs = avx2!(_mm_max_ps(halves, _mm_movehl_ps(halves, halves)));
            avx2!(_mm_cvtss_f32(_mm_max_ss(pairs, _mm_movehdup_ps(pairs))))
        }
    }
}

/// Work compiled once for every processor and once for AVX2. `run` and what it calls in its loops must be
/// `#[inline(always)]` to be compiled for both.
pub trait Work {
    type Output;
    fn run<V: Vector>(self, v: V) -> Self::Output;
}

/// `STRATA_PORTABLE=1` in the environment keeps to the code for every processor.
#[cfg(target_arch = "x86_64")]
static HAS_AVX2: LazyLock<bool> = LazyLock::new(|| {
    std::env::var_os("STRATA_PORTABLE").is_none_or(|v| v != "1")
        && std::arch::is_x86_feature_detected!("avx2")
});

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<W: Work>(work: W) -> W::Output {
    work.run(avx2::Avx2(()))
}

pub fn run_widest<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    if *HAS_AVX2 {
        // SAFETY: `run_avx2` is safe but for needing AVX2, which was detected on this processor.
        return unsafe { run_avx2(work) };
    }
    work.run(Portable)
}
