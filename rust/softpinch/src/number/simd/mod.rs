//! Run-time choice of the instructions that a run uses, and the processor's vectors as [`Lanes`](super::lanes::Lanes). The only unsafe code of
//! the crate.
//!
//! On x86-64 all that is hot is compiled for AVX2 with FMA, and what runs in lanes for AVX-512 too: a [`LaneTask`](super::lanes::LaneTask)'s code is inlined
//! into one function for each kind of [`Lanes`](super::lanes::Lanes), which has the instructions enabled. The operations are the same in each, so the
//! bits of the result are too. One run gains nothing from AVX-512 (measured: within the noise of AVX2), so it has no code for it. An x86-64
//! without AVX2 and FMA is refused ([`Level::require`](level::Level::require)): a fused multiply-add would be a library call there, forty times as slow. Other
//! processors have one level, their compiler's own.

pub mod dispatch;
pub mod level;
#[cfg(target_arch = "x86_64")]
mod x86;
