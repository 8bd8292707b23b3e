//! The choice of instructions at run time, and the vectors of the processor as
//! [`Lanes`](super::lanes::Lanes). This is the only unsafe code of the crate.
//!
//! On x86-64 all hot code is compiled for AVX2 with FMA, and code in lanes for AVX-512 as well. The code of a
//! [`LaneTask`](super::LaneTask) is inlined into one function for each kind of
//! [`Lanes`](super::lanes::Lanes), and that function has the instructions enabled. Every kind performs the
//! same operations, so the results have the same bits. A single run gains nothing from AVX-512 (measured:
//! within the noise of AVX2), so it has no AVX-512 code. An x86-64 processor without AVX2 and FMA is refused
//! ([`Level::require`](level::Level::require)): a fused multiply-add would be a library call there, forty
//! times as slow. Other processors have one level, with the instructions that the crate was compiled for.

pub(crate) mod dispatch;
pub(crate) mod level;
#[cfg(target_arch = "x86_64")]
mod x86;
