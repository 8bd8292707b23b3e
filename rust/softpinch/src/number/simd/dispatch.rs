//! Calls code that is compiled with the instructions of a SIMD level.

#[cfg(target_arch = "x86_64")]
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::Result;
#[cfg(target_arch = "x86_64")]
use crate::number::simd::x86::{Ymm, Zmm};
use crate::number::{LaneTask, Lanes, Level};

/// Whether this processor is known to have a level: one byte, because each call for a single run looks at it.
#[cfg(target_arch = "x86_64")]
static HAS_A_LEVEL: AtomicBool = AtomicBool::new(false);

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn require_any_level() {
    #[cold]
    #[inline(never)]
    fn look() {
        if !Level::Avx2.is_available() {
            // Nothing is computed on such a processor: the module refuses it when it is imported.
            std::process::abort()
        }
        HAS_A_LEVEL.store(true, Ordering::Relaxed);
    }
    if !HAS_A_LEVEL.load(Ordering::Relaxed) {
        look();
    }
}

/// Calls a task on one lane, compiled with the instructions that a single run uses.
#[inline(always)]
pub(crate) fn call_alone<K: LaneTask<f64>>(task: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[inline(never)]
        #[target_feature(enable = "avx2,fma")]
        fn fused<K: LaneTask<f64>>(task: K) -> K::Output {
            task.run()
        }
        require_any_level();
        // SAFETY: every level has AVX2 and FMA, and this processor has a level.
        unsafe { fused(task) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    task.run()
}

/// Work on lanes that is compiled for the vectors of each level. `run` must be `#[inline(always)]`, and so
/// must all hot code in it, to be compiled with the instructions of the level.
pub trait LaneKernel {
    /// The result of the work.
    type Output;
    /// Does the work.
    fn run<R: Lanes>(self) -> Self::Output;
}

/// Runs `kernel` with the instructions and the vectors of `level`. On a processor without these instructions
/// it returns an error that names the level.
pub fn dispatch_lanes<K: LaneKernel>(level: Level, kernel: K) -> Result<K::Output> {
    level.require()?;
    match level {
        // SAFETY: `require` has just found that the processor has the features that this function is compiled for.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => Ok(unsafe { avx512_lanes(kernel) }),
        // SAFETY: `require` has just found that the processor has the features that this function is compiled for.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => Ok(unsafe { avx2_lanes(kernel) }),
        #[cfg(not(target_arch = "x86_64"))]
        Level::Native => Ok(kernel.run::<crate::number::row::Row4>()),
    }
}

/// Runs `kernel` on vectors of four lanes at every level. Code that is not the fastest part of anything is compiled
/// for one kind of vectors only.
pub fn call_four_lanes<K: LaneKernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        require_any_level();
        // SAFETY: every level has AVX2 and FMA, and this processor has a level.
        unsafe { avx2_lanes(kernel) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    kernel.run::<crate::number::row::Row4>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
fn avx512_lanes<K: LaneKernel>(kernel: K) -> K::Output {
    kernel.run::<Zmm>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2_lanes<K: LaneKernel>(kernel: K) -> K::Output {
    kernel.run::<Ymm>()
}
