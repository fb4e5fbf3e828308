//! Sixteen rays at a time, as arrays that the compiler turns into vector registers.
//!
//! [`dispatch`] compiles the work once for AVX-512, once for AVX2 and once for the platform's baseline and
//! picks at run time. Products and sums are never fused, so all three give the same bits.

pub const LANES: usize = 16;
pub type Lanes = [f32; LANES];

/// `min` and `max` without the handling of NaN, one instruction each.
#[inline(always)]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
pub fn any(mask: &[bool; LANES]) -> bool {
    let mut result = false;
    for lane in mask {
        result |= lane;
    }
    result
}

/// Work to compile for several instruction sets. `run` and all that it calls in its inner loops must be
/// `#[inline(always)]`, or they stay at the baseline.
pub trait Work {
    type Output;
    fn run(self) -> Self::Output;
}

#[cfg(target_arch = "x86_64")]
pub fn dispatch<W: Work>(work: W) -> W::Output {
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi1,bmi2,popcnt")]
    fn with_avx512<W: Work>(work: W) -> W::Output {
        work.run()
    }
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn with_avx2<W: Work>(work: W) -> W::Output {
        work.run()
    }
    let bits = is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("popcnt");
    let avx2 = bits && is_x86_feature_detected!("avx2");
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
        work.run()
    }
}

#[cfg(not(target_arch = "x86_64"))]
pub fn dispatch<W: Work>(work: W) -> W::Output {
    work.run()
}
