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
