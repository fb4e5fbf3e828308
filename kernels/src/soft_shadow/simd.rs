//! Rows of texels and of light samples, as many at a time as the processor's registers hold.
//!
//! Every operation is exactly rounded and none is fused, so all processors give the same bits.

#[cfg(target_arch = "x86_64")]
use std::sync::LazyLock;

/// Floats of the widest register; every width divides it.
pub const MOST_LANES: usize = 16;

/// A set of instructions. A value of the type proves that the processor has them.
pub trait Vector: Copy {
    const LANES: usize;
    /// One bit for each lane.
    const ALL: u32 = (1 << Self::LANES) - 1;
    type Floats: Copy;
    /// 256 bits.
    type Bits: Copy;

    fn load_bits(self, from: &[u32; 8]) -> Self::Bits;
    fn store_bits(self, value: Self::Bits, to: &mut [u32; 8]);
    /// `bits | (a ^ b) & (c ^ d)`.
    fn or_both(self, bits: Self::Bits, a: &[u32; 8], b: &[u32; 8], c: &[u32; 8], d: &[u32; 8]) -> Self::Bits;
    fn all_set(self, bits: Self::Bits) -> bool;

    fn splat(self, value: f32) -> Self::Floats;
    /// The first `LANES` floats of `from`.
    fn load(self, from: &[f32]) -> Self::Floats;
    /// Two rows of floats from their packed upper halves (`prepare::pack_tilt`).
    fn load_halves(self, from: &[u32]) -> [Self::Floats; 2];
    fn store(self, value: Self::Floats, to: &mut [f32; MOST_LANES]);
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn div(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn sqrt(self, a: Self::Floats) -> Self::Floats;
    /// `a < b ? a : b`, so `b` where either is NaN.
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a > b ? a : b`, so `b` where either is NaN.
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a > b`, one bit a lane, the first lowest.
    fn greater(self, a: Self::Floats, b: Self::Floats) -> u32;
    /// `value` where the lane's bit is set, else 0.
    fn keep(self, bits: u32, value: Self::Floats) -> Self::Floats;

    #[inline(always)]
    fn abs(self, a: Self::Floats) -> Self::Floats {
        self.max(a, self.sub(self.splat(0.0), a))
    }
}

/// Work compiled once for each set of instructions; what it calls in its loops must be inlined.
pub trait Work {
    fn run<V: Vector>(self, vector: V);
}

/// Any processor.
#[derive(Clone, Copy)]
struct Portable;

const PORTABLE_LANES: usize = 8;

type PortableFloats = [f32; PORTABLE_LANES];

fn each(a: PortableFloats, b: PortableFloats, f: impl Fn(f32, f32) -> f32) -> PortableFloats {
    std::array::from_fn(|i| f(a[i], b[i]))
}

impl Vector for Portable {
    const LANES: usize = PORTABLE_LANES;
    type Floats = PortableFloats;
    type Bits = [u32; 8];

    fn load_bits(self, from: &[u32; 8]) -> [u32; 8] {
        *from
    }
    fn store_bits(self, value: [u32; 8], to: &mut [u32; 8]) {
        *to = value;
    }
    fn or_both(self, bits: [u32; 8], a: &[u32; 8], b: &[u32; 8], c: &[u32; 8], d: &[u32; 8]) -> [u32; 8] {
        std::array::from_fn(|i| bits[i] | (a[i] ^ b[i]) & (c[i] ^ d[i]))
    }
    fn all_set(self, bits: [u32; 8]) -> bool {
        bits == [u32::MAX; 8]
    }
    fn splat(self, value: f32) -> PortableFloats {
        [value; PORTABLE_LANES]
    }
    fn load(self, from: &[f32]) -> PortableFloats {
        std::array::from_fn(|i| from[i])
    }
    fn load_halves(self, from: &[u32]) -> [PortableFloats; 2] {
        [
            std::array::from_fn(|i| f32::from_bits(from[i] & 0xffff_0000)),
            std::array::from_fn(|i| f32::from_bits(from[i] << 16)),
        ]
    }
    fn store(self, value: PortableFloats, to: &mut [f32; MOST_LANES]) {
        to[..PORTABLE_LANES].copy_from_slice(&value);
    }
    fn add(self, a: PortableFloats, b: PortableFloats) -> PortableFloats {
        each(a, b, |a, b| a + b)
    }
    fn sub(self, a: PortableFloats, b: PortableFloats) -> PortableFloats {
        each(a, b, |a, b| a - b)
    }
    fn mul(self, a: PortableFloats, b: PortableFloats) -> PortableFloats {
        each(a, b, |a, b| a * b)
    }
    fn div(self, a: PortableFloats, b: PortableFloats) -> PortableFloats {
        each(a, b, |a, b| a / b)
    }
    fn sqrt(self, a: PortableFloats) -> PortableFloats {
        a.map(f32::sqrt)
    }
    fn min(self, a: PortableFloats, b: PortableFloats) -> PortableFloats {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    fn max(self, a: PortableFloats, b: PortableFloats) -> PortableFloats {
        each(a, b, |a, b| if a > b { a } else { b })
    }
    fn greater(self, a: PortableFloats, b: PortableFloats) -> u32 {
        (0..PORTABLE_LANES).fold(0, |bits, i| bits | u32::from(a[i] > b[i]) << i)
    }
    fn keep(self, bits: u32, value: PortableFloats) -> PortableFloats {
        std::array::from_fn(|i| if bits >> i & 1 == 1 { value[i] } else { 0.0 })
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{MOST_LANES, Vector};
    use std::arch::x86_64::*;

    /// Only [`super::run_widest`] makes one, having looked.
    #[derive(Clone, Copy)]
    pub struct Avx2(pub(super) ());

    /// Only [`super::run_widest`] makes one, having looked.
    #[derive(Clone, Copy)]
    pub struct Avx512(pub(super) ());

    macro_rules! proven {
        ($operation:expr) => {
            // SAFETY: holding `self` proves that the processor has the instruction; where it reads or
            // writes memory, a slice or array of that many elements was borrowed just before, and the
            // instruction needs no alignment.
            unsafe { $operation }
        };
    }

    macro_rules! bits_of_avx2 {
        () => {
            type Bits = __m256i;

            #[inline(always)]
            fn load_bits(self, from: &[u32; 8]) -> __m256i {
                proven!(_mm256_loadu_si256(from.as_ptr().cast()))
            }
            #[inline(always)]
            fn store_bits(self, value: __m256i, to: &mut [u32; 8]) {
                proven!(_mm256_storeu_si256(to.as_mut_ptr().cast(), value))
            }
            #[inline(always)]
            fn or_both(
                self,
                bits: __m256i,
                a: &[u32; 8],
                b: &[u32; 8],
                c: &[u32; 8],
                d: &[u32; 8],
            ) -> __m256i {
                let (a, b) = (self.load_bits(a), self.load_bits(b));
                let (c, d) = (self.load_bits(c), self.load_bits(d));
                proven!({
                    let both = _mm256_and_si256(_mm256_xor_si256(a, b), _mm256_xor_si256(c, d));
                    _mm256_or_si256(bits, both)
                })
            }
            #[inline(always)]
            fn all_set(self, bits: __m256i) -> bool {
                proven!(_mm256_testc_si256(bits, _mm256_set1_epi32(-1)) == 1)
            }
        };
    }

    impl Vector for Avx2 {
        const LANES: usize = 8;
        type Floats = __m256;
        bits_of_avx2!();

        #[inline(always)]
        fn splat(self, value: f32) -> __m256 {
            proven!(_mm256_set1_ps(value))
        }
        #[inline(always)]
        fn load(self, from: &[f32]) -> __m256 {
            let from = &from[..8];
            proven!(_mm256_loadu_ps(from.as_ptr()))
        }
        #[inline(always)]
        fn load_halves(self, from: &[u32]) -> [__m256; 2] {
            let from = &from[..8];
            proven!({
                let packed = _mm256_loadu_si256(from.as_ptr().cast());
                let upper = _mm256_and_si256(packed, _mm256_set1_epi32(0xffff_0000u32 as i32));
                let lower = _mm256_slli_epi32::<16>(packed);
                [_mm256_castsi256_ps(upper), _mm256_castsi256_ps(lower)]
            })
        }
        #[inline(always)]
        fn store(self, value: __m256, to: &mut [f32; MOST_LANES]) {
            proven!(_mm256_storeu_ps(to.as_mut_ptr(), value))
        }
        #[inline(always)]
        fn add(self, a: __m256, b: __m256) -> __m256 {
            proven!(_mm256_add_ps(a, b))
        }
        #[inline(always)]
        fn sub(self, a: __m256, b: __m256) -> __m256 {
            proven!(_mm256_sub_ps(a, b))
        }
        #[inline(always)]
        fn mul(self, a: __m256, b: __m256) -> __m256 {
            proven!(_mm256_mul_ps(a, b))
        }
        #[inline(always)]
        fn div(self, a: __m256, b: __m256) -> __m256 {
            proven!(_mm256_div_ps(a, b))
        }
        #[inline(always)]
        fn sqrt(self, a: __m256) -> __m256 {
            proven!(_mm256_sqrt_ps(a))
        }
        #[inline(always)]
        fn min(self, a: __m256, b: __m256) -> __m256 {
            proven!(_mm256_min_ps(a, b))
        }
        #[inline(always)]
        fn max(self, a: __m256, b: __m256) -> __m256 {
            proven!(_mm256_max_ps(a, b))
        }
        #[inline(always)]
        fn greater(self, a: __m256, b: __m256) -> u32 {
            proven!(_mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(a, b)) as u32)
        }
        #[inline(always)]
        fn keep(self, bits: u32, value: __m256) -> __m256 {
            proven!({
                let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let set = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lane);
                _mm256_and_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(set, lane)), value)
            })
        }
    }

    impl Vector for Avx512 {
        const LANES: usize = 16;
        type Floats = __m512;
        bits_of_avx2!();

        #[inline(always)]
        fn splat(self, value: f32) -> __m512 {
            proven!(_mm512_set1_ps(value))
        }
        #[inline(always)]
        fn load(self, from: &[f32]) -> __m512 {
            let from = &from[..16];
            proven!(_mm512_loadu_ps(from.as_ptr()))
        }
        #[inline(always)]
        fn load_halves(self, from: &[u32]) -> [__m512; 2] {
            let from = &from[..16];
            proven!({
                let packed = _mm512_loadu_si512(from.as_ptr().cast());
                let upper = _mm512_and_si512(packed, _mm512_set1_epi32(0xffff_0000u32 as i32));
                let lower = _mm512_slli_epi32::<16>(packed);
                [_mm512_castsi512_ps(upper), _mm512_castsi512_ps(lower)]
            })
        }
        #[inline(always)]
        fn store(self, value: __m512, to: &mut [f32; MOST_LANES]) {
            proven!(_mm512_storeu_ps(to.as_mut_ptr(), value))
        }
        #[inline(always)]
        fn add(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_add_ps(a, b))
        }
        #[inline(always)]
        fn sub(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_sub_ps(a, b))
        }
        #[inline(always)]
        fn mul(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_mul_ps(a, b))
        }
        #[inline(always)]
        fn div(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_div_ps(a, b))
        }
        #[inline(always)]
        fn sqrt(self, a: __m512) -> __m512 {
            proven!(_mm512_sqrt_ps(a))
        }
        #[inline(always)]
        fn min(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_min_ps(a, b))
        }
        #[inline(always)]
        fn max(self, a: __m512, b: __m512) -> __m512 {
            proven!(_mm512_max_ps(a, b))
        }
        #[inline(always)]
        fn greater(self, a: __m512, b: __m512) -> u32 {
            proven!(u32::from(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(a, b)))
        }
        #[inline(always)]
        fn keep(self, bits: u32, value: __m512) -> __m512 {
            proven!(_mm512_maskz_mov_ps(bits as u16, value))
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<W: Work>(work: W) {
    work.run(x86::Avx2(()));
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn run_avx512<W: Work>(work: W) {
    work.run(x86::Avx512(()));
}

/// What the processor has and the environment allows: `STRATA_PORTABLE=1` keeps to the code for every
/// processor, `STRATA_AVX512=0` to at most AVX2.
#[cfg(target_arch = "x86_64")]
static HAS: LazyLock<(bool, bool)> = LazyLock::new(|| {
    let is = |name: &str, value: &str| std::env::var_os(name).is_some_and(|v| v == value);
    let avx512 = std::arch::is_x86_feature_detected!("avx512f")
        && std::arch::is_x86_feature_detected!("avx512bw")
        && std::arch::is_x86_feature_detected!("avx512dq")
        && std::arch::is_x86_feature_detected!("avx512vl");
    let avx2 = std::arch::is_x86_feature_detected!("avx2") && !is("STRATA_PORTABLE", "1");
    (avx2, avx2 && avx512 && !is("STRATA_AVX512", "0"))
});

pub fn run_widest<W: Work>(work: W) {
    #[cfg(target_arch = "x86_64")]
    match *HAS {
        // SAFETY: safe but for needing the instructions, which were detected on this processor.
        (_, true) => return unsafe { run_avx512(work) },
        // SAFETY: likewise.
        (true, _) => return unsafe { run_avx2(work) },
        _ => {}
    }
    work.run(Portable);
}
