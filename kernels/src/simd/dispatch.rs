//! The choice of instructions.

use super::portable::Portable;
use super::vector::Simd;

/// Work to compile for each set of instructions. `run` and all that it calls in its inner loops must be
/// `#[inline(always)]`, or they stay at the platform's baseline. Closures cannot be told to, so that vectors are no
/// matter for them, nor for `map`: each operation might become a call.
pub trait Work {
    type Output;
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

#[cfg(target_arch = "x86_64")]
mod chosen {
    use super::Work;
    use crate::simd::x86::{Avx2, Avx512};
    use std::arch::is_x86_feature_detected;
    use std::sync::LazyLock;

    #[derive(Clone, Copy)]
    pub enum Widest {
        Portable,
        Avx2,
        Avx512,
    }

    /// What the processor has and the environment allows: `STRATA_PORTABLE=1` keeps to the code for every
    /// processor, `STRATA_AVX512=0` to at most AVX2.
    pub static WIDEST: LazyLock<Widest> = LazyLock::new(|| {
        let is = |name: &str, value: &str| std::env::var_os(name).is_some_and(|v| v == value);
        let avx2 = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("popcnt");
        let avx512 = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl");
        if !avx2 || is("STRATA_PORTABLE", "1") {
            Widest::Portable
        } else if !avx512 || is("STRATA_AVX512", "0") {
            Widest::Avx2
        } else {
            Widest::Avx512
        }
    });

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,popcnt")]
    pub fn with_avx512<W: Work>(work: W) -> W::Output {
        work.run(Avx512::PROVEN)
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    pub fn with_avx2<W: Work>(work: W) -> W::Output {
        work.run(Avx2::PROVEN)
    }
}

/// Runs `work` compiled for this processor.
pub fn dispatch<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        use chosen::{WIDEST, Widest, with_avx2, with_avx512};
        match *WIDEST {
            // SAFETY: every feature that `with_avx512` enables was detected on this processor.
            Widest::Avx512 => return unsafe { with_avx512(work) },
            // SAFETY: every feature that `with_avx2` enables was detected on this processor.
            Widest::Avx2 => return unsafe { with_avx2(work) },
            Widest::Portable => {}
        }
    }
    work.run(Portable)
}
