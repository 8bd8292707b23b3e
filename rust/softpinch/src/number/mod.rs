//! Number types: the operations that the mechanics need, for one run, for several runs side by side, and for
//! derivatives.

pub mod dual;
pub mod lanes;
pub mod linear;
pub mod real;
pub mod row;
mod scalar;
// The only unsafe code of the crate.
#[allow(unsafe_code)]
pub mod simd;
#[cfg(test)]
mod tests;
pub mod trigonometry;
