//! One run, and many.

pub mod ensemble;
pub mod lanes;
pub mod queue;
pub mod simulate;
#[cfg(test)]
mod tests;
