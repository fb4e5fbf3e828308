//! Sixteen numbers at a time, with the widest instructions that this processor has, chosen while running.
//!
//! Every operation is rounded exactly and none are fused, so all instruction sets give the same bits.

pub const LANES: usize = 16;
pub type Lanes = [f32; LANES];

/// Work to compile for each instruction set. `run` and all that it calls in its inner loops must be
/// `#[inline(always)]`, or they stay at the platform's baseline.
pub trait Work {
    type Output;
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// What the inner loops do with sixteen numbers at once. An implementor is the proof that the processor has
/// the instructions: only [`dispatch`] makes one, having looked.
pub trait Simd: Copy {
    type Float: Copy;
    type Mask: Copy;

    fn load(self, from: &Lanes) -> Self::Float;
    fn store(self, value: Self::Float, to: &mut Lanes);
    fn splat(self, value: f32) -> Self::Float;
    fn add(self, a: Self::Float, b: Self::Float) -> Self::Float;
    fn sub(self, a: Self::Float, b: Self::Float) -> Self::Float;
    fn mul(self, a: Self::Float, b: Self::Float) -> Self::Float;
    fn div(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// `a < b ? a : b`, so `b` where either is NaN; `max` likewise.
    fn min(self, a: Self::Float, b: Self::Float) -> Self::Float;
    fn max(self, a: Self::Float, b: Self::Float) -> Self::Float;
    fn less(self, a: Self::Float, b: Self::Float) -> Self::Mask;
    fn less_equal(self, a: Self::Float, b: Self::Float) -> Self::Mask;
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The mask as one bit a lane.
    fn bits(self, mask: Self::Mask) -> u32;
}

/// Any processor.
#[derive(Clone, Copy)]
struct Portable;

macro_rules! each {
    ($lane:ident => $value:expr) => {{
        let mut result = [Default::default(); LANES];
        for $lane in 0..LANES {
            result[$lane] = $value;
        }
        result
    }};
}

impl Simd for Portable {
    type Float = Lanes;
    type Mask = [bool; LANES];

    #[inline(always)]
    fn load(self, from: &Lanes) -> Lanes {
        *from
    }
    #[inline(always)]
    fn store(self, value: Lanes, to: &mut Lanes) {
        *to = value;
    }
    #[inline(always)]
    fn splat(self, value: f32) -> Lanes {
        [value; LANES]
    }
    #[inline(always)]
    fn add(self, a: Lanes, b: Lanes) -> Lanes {
        each!(i => a[i] + b[i])
    }
    #[inline(always)]
    fn sub(self, a: Lanes, b: Lanes) -> Lanes {
        each!(i => a[i] - b[i])
    }
    #[inline(always)]
    fn mul(self, a: Lanes, b: Lanes) -> Lanes {
        each!(i => a[i] * b[i])
    }
    #[inline(always)]
    fn div(self, a: Lanes, b: Lanes) -> Lanes {
        each!(i => a[i] / b[i])
    }
    #[inline(always)]
    fn min(self, a: Lanes, b: Lanes) -> Lanes {
        each!(i => if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn max(self, a: Lanes, b: Lanes) -> Lanes {
        each!(i => if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn less(self, a: Lanes, b: Lanes) -> Self::Mask {
        each!(i => a[i] < b[i])
    }
    #[inline(always)]
    fn less_equal(self, a: Lanes, b: Lanes) -> Self::Mask {
        each!(i => a[i] <= b[i])
    }
    #[inline(always)]
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        each!(i => a[i] & b[i])
    }
    #[inline(always)]
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        each!(i => a[i] | b[i])
    }
    #[inline(always)]
    fn bits(self, mask: Self::Mask) -> u32 {
        let mut bits = 0;
        for (i, lane) in mask.iter().enumerate() {
            bits |= u32::from(*lane) << i;
        }
        bits
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{LANES, Lanes, Simd};
    use std::arch::x86_64::*;

    #[derive(Clone, Copy)]
    pub struct Avx512(pub(super) ());
    #[derive(Clone, Copy)]
    pub struct Avx2(pub(super) ());

    macro_rules! proven {
        ($operation:expr) => {
            // SAFETY: the instruction set is there, which holding the token proves (`dispatch` has looked);
            // memory is only reached through a reference to `Lanes`, by unaligned loads and stores of its size.
            unsafe { $operation }
        };
    }

    macro_rules! operations {
        ($(fn $name:ident($($argument:ident: $kind:ty),*) -> $result:ty { $body:expr })*) => {
            $(#[inline(always)]
            fn $name(self, $($argument: $kind),*) -> $result {
                proven!($body)
            })*
        };
    }

    impl Simd for Avx512 {
        type Float = __m512;
        type Mask = __mmask16;

        operations! {
            fn load(from: &Lanes) -> __m512 { _mm512_loadu_ps(from.as_ptr()) }
            fn store(value: __m512, to: &mut Lanes) -> () { _mm512_storeu_ps(to.as_mut_ptr(), value) }
            fn splat(value: f32) -> __m512 { _mm512_set1_ps(value) }
            fn add(a: __m512, b: __m512) -> __m512 { _mm512_add_ps(a, b) }
            fn sub(a: __m512, b: __m512) -> __m512 { _mm512_sub_ps(a, b) }
            fn mul(a: __m512, b: __m512) -> __m512 { _mm512_mul_ps(a, b) }
            fn div(a: __m512, b: __m512) -> __m512 { _mm512_div_ps(a, b) }
            fn min(a: __m512, b: __m512) -> __m512 { _mm512_min_ps(a, b) }
            fn max(a: __m512, b: __m512) -> __m512 { _mm512_max_ps(a, b) }
            fn less(a: __m512, b: __m512) -> __mmask16 { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) }
            fn less_equal(a: __m512, b: __m512) -> __mmask16 { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b) }
            fn and(a: __mmask16, b: __mmask16) -> __mmask16 { _kand_mask16(a, b) }
            fn or(a: __mmask16, b: __mmask16) -> __mmask16 { _kor_mask16(a, b) }
        }

        #[inline(always)]
        fn bits(self, mask: __mmask16) -> u32 {
            u32::from(mask)
        }
    }

    const HALF: usize = LANES / 2;

    impl Simd for Avx2 {
        type Float = [__m256; 2];
        type Mask = [__m256; 2];

        operations! {
            fn load(from: &Lanes) -> [__m256; 2] {
                [_mm256_loadu_ps(from.as_ptr()), _mm256_loadu_ps(from[HALF..].as_ptr())]
            }
            fn store(value: [__m256; 2], to: &mut Lanes) -> () {{
                _mm256_storeu_ps(to.as_mut_ptr(), value[0]);
                _mm256_storeu_ps(to[HALF..].as_mut_ptr(), value[1]);
            }}
            fn splat(value: f32) -> [__m256; 2] { [_mm256_set1_ps(value); 2] }
            fn add(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_add_ps(a[0], b[0]), _mm256_add_ps(a[1], b[1])]
            }
            fn sub(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_sub_ps(a[0], b[0]), _mm256_sub_ps(a[1], b[1])]
            }
            fn mul(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])]
            }
            fn div(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_div_ps(a[0], b[0]), _mm256_div_ps(a[1], b[1])]
            }
            fn min(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_min_ps(a[0], b[0]), _mm256_min_ps(a[1], b[1])]
            }
            fn max(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_max_ps(a[0], b[0]), _mm256_max_ps(a[1], b[1])]
            }
            fn less(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_cmp_ps::<_CMP_LT_OQ>(a[0], b[0]), _mm256_cmp_ps::<_CMP_LT_OQ>(a[1], b[1])]
            }
            fn less_equal(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_cmp_ps::<_CMP_LE_OQ>(a[0], b[0]), _mm256_cmp_ps::<_CMP_LE_OQ>(a[1], b[1])]
            }
            fn and(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_and_ps(a[0], b[0]), _mm256_and_ps(a[1], b[1])]
            }
            fn or(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
                [_mm256_or_ps(a[0], b[0]), _mm256_or_ps(a[1], b[1])]
            }
            fn bits(mask: [__m256; 2]) -> u32 {
                _mm256_movemask_ps(mask[0]) as u32 | (_mm256_movemask_ps(mask[1]) as u32) << HALF
            }
        }
    }
}

/// Runs `work` compiled for this processor.
#[cfg(target_arch = "x86_64")]
pub fn dispatch<W: Work>(work: W) -> W::Output {
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi1,bmi2,popcnt")]
    fn with_avx512<W: Work>(work: W) -> W::Output {
        work.run(x86::Avx512(()))
    }
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn with_avx2<W: Work>(work: W) -> W::Output {
        work.run(x86::Avx2(()))
    }
    let avx2 = is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("popcnt");
    let avx512 = avx2
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512bw");
    if avx512 {
        // SAFETY: every feature that `with_avx512` enables was just detected on this processor.
        unsafe { with_avx512(work) }
    } else if avx2 {
        // SAFETY: every feature that `with_avx2` enables was just detected on this processor.
        unsafe { with_avx2(work) }
    } else {
        work.run(Portable)
    }
}

/// Runs `work` compiled for this processor.
#[cfg(not(target_arch = "x86_64"))]
pub fn dispatch<W: Work>(work: W) -> W::Output {
    work.run(Portable)
}
