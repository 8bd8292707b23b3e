//! Numbers: what the mechanics ask of them, one run's, those of several runs side by side, and derivatives.

pub mod dual;
pub mod lanes;
pub mod linear;
pub mod real;
pub mod row;
mod scalar;
pub mod simd;
#[cfg(test)]
mod tests;
pub mod trigonometry;
