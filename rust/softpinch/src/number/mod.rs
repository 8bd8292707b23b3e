//! Number types: the operations of the mechanics for one run, for several runs side by side, and for derivatives.

pub(crate) mod dual;
pub(crate) mod lanes;
pub(crate) mod linear;
pub(crate) mod powers;
pub(crate) mod real;
#[cfg(any(test, not(target_arch = "x86_64")))]
pub(crate) mod row;
mod scalar;
// The only unsafe code of the crate.
#[allow(unsafe_code)]
pub(crate) mod simd;
#[cfg(test)]
mod tests;
pub(crate) mod trigonometry;

pub(crate) use dual::{Dual, gathered, spread};
pub use lanes::Lanes;
pub(crate) use lanes::{MOST, each};
pub(crate) use linear::{Entry, LaneEntry, Lu, MOST_ROWS, Square, solve2, solve3};
pub(crate) use real::{Bits, dot, inlined, signed, task};
pub use real::{Compose, Functions, LaneTask, Lift, Real};
pub(crate) use simd::dispatch::call_four_lanes;
pub use simd::dispatch::{LaneKernel, dispatch_lanes};
pub use simd::level::{LEVELS, Level};
pub(crate) use trigonometry::sin_cos;
