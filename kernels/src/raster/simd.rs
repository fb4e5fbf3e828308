//! The widest instructions that this processor has, chosen while running.

#[cfg(target_arch = "x86_64")]
use std::sync::LazyLock;

/// Work compiled once for every processor and once for AVX2. `run` and what it calls in its loops must be
/// `#[inline(always)]` to be compiled for both. Rust neither fuses nor reorders floating-point
/// operations, so both give the same bits.
pub trait Work {
    type Output;
    fn run(self) -> Self::Output;
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
    work.run()
}

pub fn run_widest<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    if *HAS_AVX2 {
        // SAFETY: `run_avx2` is safe but for needing AVX2, which was detected on this processor.
        return unsafe { run_avx2(work) };
    }
    work.run()
}
