//! Calls code that is compiled with the instructions of a SIMD level.

use crate::error::Result;
#[cfg(target_arch = "x86_64")]
use crate::number::simd::x86::{Ymm, Zmm};
use crate::number::{Instructions, LaneTask, Lanes, Level};

/// Calls a task on one lane, compiled with the instructions that a single run uses.
#[inline(always)]
pub(crate) fn call_alone<K: LaneTask<f64>>(proof: Instructions, task: K) -> K::Output {
    let _ = proof;
    #[cfg(target_arch = "x86_64")]
    {
        #[inline(never)]
        #[target_feature(enable = "avx2,fma")]
        fn fused<K: LaneTask<f64>>(task: K) -> K::Output {
            task.run()
        }
        // SAFETY: every level has AVX2 and FMA, and `proof` shows that this processor has a level.
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
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output;
}

/// Runs `kernel` with the instructions and the vectors of `level`. On a processor without these instructions
/// it returns an error that names the level.
pub fn dispatch_lanes<K: LaneKernel>(level: Level, kernel: K) -> Result<K::Output> {
    let instructions = level.require()?;
    match level {
        // SAFETY: `require` has just found that the processor has the features that this function is compiled for.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => Ok(unsafe { avx512_lanes(kernel, instructions) }),
        // SAFETY: `require` has just found that the processor has the features that this function is compiled for.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => Ok(unsafe { avx2_lanes(kernel, instructions) }),
        #[cfg(not(target_arch = "x86_64"))]
        Level::Native => Ok(kernel.run::<crate::number::row::Row4>(instructions)),
    }
}

/// Runs `kernel` on vectors of four lanes at every level, of which the caller has the proof. Code that is not the fastest
/// part of anything is compiled for one kind of vectors only.
pub fn call_four_lanes<K: LaneKernel>(proof: Instructions, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: every level has AVX2 and FMA, and `proof` shows that this processor has a level.
    return unsafe { avx2_lanes(kernel, proof) };
    #[cfg(not(target_arch = "x86_64"))]
    kernel.run::<crate::number::row::Row4>(proof)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
fn avx512_lanes<K: LaneKernel>(kernel: K, instructions: Instructions) -> K::Output {
    kernel.run::<Zmm>(instructions)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2_lanes<K: LaneKernel>(kernel: K, instructions: Instructions) -> K::Output {
    kernel.run::<Ymm>(instructions)
}
