//! The drivers of simulations: one run, and many runs.

pub mod ensemble;
pub mod lanes;
pub mod queue;
pub mod simulate;
#[cfg(test)]
mod tests;
