//! Number types: the operations of the mechanics for one run, for several runs side by side, and for derivatives.

pub(crate) mod dual;
pub mod lanes;
pub(crate) mod linear;
pub mod real;
#[cfg(any(test, not(target_arch = "x86_64")))]
pub(crate) mod row;
mod scalar;
// The only unsafe code of the crate.
#[allow(unsafe_code)]
pub mod simd;
#[cfg(test)]
mod tests;
pub(crate) mod trigonometry;

pub(crate) use dual::{Dual, gather, gathered, spread};
pub use lanes::{Lanes, Lift, MOST, each};
pub(crate) use linear::{Entry, LaneEntry, Lu, MOST_ROWS, Square, solve2, solve3};
pub(crate) use real::task;
pub use real::{Bits, LaneTask, Real, dot, signed};
pub use simd::dispatch::{LaneKernel, call_four_lanes, dispatch_lanes};
pub use simd::level::{Instructions, LEVELS, Level};
pub(crate) use trigonometry::sin_cos;
