//! Run-time choice of the instructions that a run uses. The only unsafe code of the crate.
//!
//! A [`Kernel`]'s code is inlined into one function for each level, so the same source is compiled with AVX-512,
//! with AVX2 and FMA, and portably. The operations are the same in each, so the bits of the result are too; without FMA
//! hardware a fused multiply-add is a library call and slow.

use crate::error::{Error, lookup};

/// A set of instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// Whatever the crate was compiled for.
    Portable,
    /// AVX2 with FMA.
    Avx2,
    /// AVX-512 F, DQ and VL, with FMA.
    Avx512,
}

/// The levels by the names that `SOFTPINCH_SIMD` takes.
pub const LEVELS: [(&str, Level); 3] =
    [("portable", Level::Portable), ("avx2", Level::Avx2), ("avx512", Level::Avx512)];

/// The environment variable that forces a level.
pub const VARIABLE: &str = "SOFTPINCH_SIMD";

impl Level {
    /// The best level of this processor.
    #[must_use]
    pub fn detect() -> Self {
        [Self::Avx512, Self::Avx2].into_iter().find(|level| level.is_available()).unwrap_or(Self::Portable)
    }

    /// The level that [`VARIABLE`] forces, or the best one where it is not set.
    pub fn from_environment() -> Result<Self, Error> {
        match std::env::var(VARIABLE) {
            Err(_) => Ok(Self::detect()),
            Ok(name) => {
                let level = lookup(VARIABLE, &name, &LEVELS)?;
                if level.is_available() {
                    Ok(level)
                } else {
                    Err(Error::Unknown {
                        field: VARIABLE,
                        name,
                        allowed: format!("{:?}, the best that this processor has", Self::detect().name()),
                    })
                }
            }
        }
    }

    /// Its public name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Whether this processor has it.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Avx512 => false,
        }
    }
}

/// Work whose code is compiled once for every level. `run` must be `#[inline(always)]`, and so must all that is hot in it.
pub trait Kernel {
    /// What the work gives.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs `kernel` with the instructions of `level`, or portably where this processor lacks them.
pub fn dispatch<K: Kernel>(level: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if level.is_available() {
        match level {
            // SAFETY: the processor has just been found to have the features that the function is compiled for.
            Level::Avx512 => return unsafe { avx512(kernel) },
            // SAFETY: as above.
            Level::Avx2 => return unsafe { avx2(kernel) },
            Level::Portable => {}
        }
    }
    let _ = level;
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
fn avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}
