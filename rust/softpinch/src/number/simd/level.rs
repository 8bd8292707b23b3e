//! The SIMD levels, and the proof that a processor has one.

use crate::error::{Error, Result, lookup};

/// A SIMD level: a set of instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// AVX2 with FMA.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512 F, DQ and VL, with FMA.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// The instructions that the crate was compiled for.
    #[cfg(not(target_arch = "x86_64"))]
    Native,
}

/// The levels by the names that `SOFTPINCH_SIMD` accepts. The best level is the last one.
#[cfg(target_arch = "x86_64")]
pub const LEVELS: [(&str, Level); 2] = [("avx2", Level::Avx2), ("avx512", Level::Avx512)];
/// The levels by the names that `SOFTPINCH_SIMD` accepts. The best level is the last one.
#[cfg(not(target_arch = "x86_64"))]
pub const LEVELS: [(&str, Level); 1] = [("native", Level::Native)];

/// The environment variable that selects a level.
pub const VARIABLE: &str = "SOFTPINCH_SIMD";

impl Level {
    /// The best level that this processor has. If it has none, the lowest one, which [`Level::require`] refuses.
    pub fn detect() -> Self {
        let best = LEVELS.iter().rev().find(|(_, level)| level.is_available());
        best.map_or(LEVELS[0].1, |&(_, level)| level)
    }

    /// The level that `VARIABLE` selects, or the best one if the variable is not set.
    pub fn from_environment() -> Result<Self> {
        let Ok(name) = std::env::var(VARIABLE) else { return Ok(Self::detect()) };
        let level = lookup(VARIABLE, &name, &LEVELS)?;
        if level.is_available() {
            return Ok(level);
        }
        let allowed = format!("{:?}, the best that this processor has", Self::detect().name());
        Err(Error::unknown(VARIABLE, name, allowed))
    }

    /// The public name of the level.
    pub fn name(self) -> &'static str {
        LEVELS.iter().find(|(_, level)| *level == self).map_or("", |&(name, _)| name)
    }

    /// Whether this processor has the instructions of the level.
    pub fn is_available(self) -> bool {
        match self {
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
            Self::Native => true,
        }
    }

    /// Refuses a level whose instructions this processor lacks.
    pub fn require(self) -> Result {
        if self.is_available() { Ok(()) } else { Err(Error::Processor { level: self.name() }) }
    }
}
