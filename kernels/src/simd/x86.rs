//! AVX2 and AVX-512.

use super::pair::Pair;
use super::vector::{Eight, Simd, Vector};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

/// With BMI1, BMI2 and POPCNT.
#[derive(Clone, Copy)]
pub struct Avx2(());

/// F, BW, DQ and VL, and what [`Avx2`] has.
#[derive(Clone, Copy)]
pub struct Avx512(());

impl Avx2 {
    /// For a function that enables the instructions, and nothing else.
    pub(super) const PROVEN: Avx2 = Avx2(());
}

impl Avx512 {
    /// For a function that enables the instructions, and nothing else.
    pub(super) const PROVEN: Avx512 = Avx512(());
}

impl Simd for Avx2 {
    type Eight = Avx2;
    type Sixteen = Pair<Avx2>;
    type Widest = Avx2;

    #[inline(always)]
    fn eight(self) -> Avx2 {
        self
    }
    #[inline(always)]
    fn sixteen(self) -> Pair<Avx2> {
        Pair(self)
    }
    #[inline(always)]
    fn widest(self) -> Avx2 {
        self
    }
}

impl Simd for Avx512 {
    type Eight = Avx2;
    type Sixteen = Avx512;
    type Widest = Avx512;

    #[inline(always)]
    fn eight(self) -> Avx2 {
        Avx2::PROVEN
    }
    #[inline(always)]
    fn sixteen(self) -> Avx512 {
        self
    }
    #[inline(always)]
    fn widest(self) -> Avx512 {
        self
    }
}

/// Only [`Avx2`] makes one.
#[derive(Clone, Copy)]
pub struct Floats8(__m256);

/// Only [`Avx512`] makes one.
#[derive(Clone, Copy)]
pub struct Floats16(__m512);

macro_rules! operators {
    ($floats:ident: $($operator:ident $name:ident $instruction:ident),*) => {
        $(impl $operator for $floats {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                // SAFETY: that there is one proves that the processor has the instruction.
                $floats(unsafe { $instruction(self.0, other.0) })
            }
        })*
    };
}

operators!(Floats8: Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps, Div div _mm256_div_ps);
operators!(Floats16: Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps, Div div _mm512_div_ps);

macro_rules! operations {
    ($(fn $name:ident($($argument:ident: $kind:ty),*) -> $result:ty { $body:expr })*) => {
        $(#[inline(always)]
        fn $name(self, $($argument: $kind),*) -> $result {
            // SAFETY: holding `self` proves that the processor has the instruction; where it reads or writes memory, a
            // slice or array of that many elements was borrowed just before, and the instruction needs no alignment.
            unsafe { $body }
        })*
    };
}

impl Vector for Avx2 {
    const LANES: usize = 8;
    type Floats = Floats8;
    /// Only the sign bits count.
    type Mask = __m256;

    operations! {
        fn splat(value: f32) -> Floats8 { Floats8(_mm256_set1_ps(value)) }
        fn load(from: &[f32]) -> Floats8 { Floats8(_mm256_loadu_ps(from[..8].as_ptr())) }
        fn load_halves(from: &[u32]) -> [Floats8; 2] {{
            let packed = _mm256_loadu_si256(from[..8].as_ptr().cast());
            let upper = _mm256_and_si256(packed, _mm256_set1_epi32(0xffff_0000u32 as i32));
            let lower = _mm256_slli_epi32::<16>(packed);
            [Floats8(_mm256_castsi256_ps(upper)), Floats8(_mm256_castsi256_ps(lower))]
        }}
        fn store(value: Floats8, to: &mut [f32]) -> () { _mm256_storeu_ps(to[..8].as_mut_ptr(), value.0) }
        fn sqrt(a: Floats8) -> Floats8 { Floats8(_mm256_sqrt_ps(a.0)) }
        fn min(a: Floats8, b: Floats8) -> Floats8 { Floats8(_mm256_min_ps(a.0, b.0)) }
        fn max(a: Floats8, b: Floats8) -> Floats8 { Floats8(_mm256_max_ps(a.0, b.0)) }
        fn less(a: Floats8, b: Floats8) -> __m256 { _mm256_cmp_ps::<_CMP_LT_OQ>(a.0, b.0) }
        fn less_equal(a: Floats8, b: Floats8) -> __m256 { _mm256_cmp_ps::<_CMP_LE_OQ>(a.0, b.0) }
        fn and(a: __m256, b: __m256) -> __m256 { _mm256_and_ps(a, b) }
        fn or(a: __m256, b: __m256) -> __m256 { _mm256_or_ps(a, b) }
        fn bits(mask: __m256) -> u32 { _mm256_movemask_ps(mask) as u32 }
        fn keep(bits: u32, value: Floats8) -> Floats8 {{
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let set = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lane);
            Floats8(_mm256_and_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(set, lane)), value.0))
        }}
    }
}

impl Eight for Avx2 {
    type Ints = __m256i;

    operations! {
        fn splat_int(value: i32) -> __m256i { _mm256_set1_epi32(value) }
        fn load_ints(from: &[u32; 8]) -> __m256i { _mm256_loadu_si256(from.as_ptr().cast()) }
        fn store_ints(value: __m256i, to: &mut [u32; 8]) -> () { _mm256_storeu_si256(to.as_mut_ptr().cast(), value) }
        fn add_ints(a: __m256i, b: __m256i) -> __m256i { _mm256_add_epi32(a, b) }
        fn mul_ints(a: __m256i, b: __m256i) -> __m256i { _mm256_mullo_epi32(a, b) }
        fn and_ints(a: __m256i, b: __m256i) -> __m256i { _mm256_and_si256(a, b) }
        fn or_ints(a: __m256i, b: __m256i) -> __m256i { _mm256_or_si256(a, b) }
        fn xor_ints(a: __m256i, b: __m256i) -> __m256i { _mm256_xor_si256(a, b) }
        fn all_set(a: __m256i) -> bool { _mm256_testc_si256(a, _mm256_set1_epi32(-1)) == 1 }
        fn negative(a: __m256i) -> __m256 { _mm256_castsi256_ps(a) }
        fn select(mask: __m256, yes: Floats8, no: Floats8) -> Floats8 { Floats8(_mm256_blendv_ps(no.0, yes.0, mask)) }
        fn select_ints(mask: __m256, yes: __m256i, no: __m256i) -> __m256i {
            _mm256_castps_si256(_mm256_blendv_ps(_mm256_castsi256_ps(no), _mm256_castsi256_ps(yes), mask))
        }
        fn largest(a: Floats8) -> f32 {{
            let halves = _mm_max_ps(_mm256_castps256_ps128(a.0), _mm256_extractf128_ps::<1>(a.0));
            let pairs = _mm_max_ps(halves, _mm_movehl_ps(halves, halves));
            _mm_cvtss_f32(_mm_max_ss(pairs, _mm_movehdup_ps(pairs)))
        }}
    }
}

impl Vector for Avx512 {
    const LANES: usize = 16;
    type Floats = Floats16;
    type Mask = __mmask16;

    operations! {
        fn splat(value: f32) -> Floats16 { Floats16(_mm512_set1_ps(value)) }
        fn load(from: &[f32]) -> Floats16 { Floats16(_mm512_loadu_ps(from[..16].as_ptr())) }
        fn load_halves(from: &[u32]) -> [Floats16; 2] {{
            let packed = _mm512_loadu_si512(from[..16].as_ptr().cast());
            let upper = _mm512_and_si512(packed, _mm512_set1_epi32(0xffff_0000u32 as i32));
            let lower = _mm512_slli_epi32::<16>(packed);
            [Floats16(_mm512_castsi512_ps(upper)), Floats16(_mm512_castsi512_ps(lower))]
        }}
        fn store(value: Floats16, to: &mut [f32]) -> () { _mm512_storeu_ps(to[..16].as_mut_ptr(), value.0) }
        fn sqrt(a: Floats16) -> Floats16 { Floats16(_mm512_sqrt_ps(a.0)) }
        fn min(a: Floats16, b: Floats16) -> Floats16 { Floats16(_mm512_min_ps(a.0, b.0)) }
        fn max(a: Floats16, b: Floats16) -> Floats16 { Floats16(_mm512_max_ps(a.0, b.0)) }
        fn less(a: Floats16, b: Floats16) -> __mmask16 { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0) }
        fn less_equal(a: Floats16, b: Floats16) -> __mmask16 { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a.0, b.0) }
        fn and(a: __mmask16, b: __mmask16) -> __mmask16 { _kand_mask16(a, b) }
        fn or(a: __mmask16, b: __mmask16) -> __mmask16 { _kor_mask16(a, b) }
        fn keep(bits: u32, value: Floats16) -> Floats16 { Floats16(_mm512_maskz_mov_ps(bits as u16, value.0)) }
    }

    #[inline(always)]
    fn bits(self, mask: __mmask16) -> u32 {
        u32::from(mask)
    }
}
