//! The drivers of simulations: one run, many runs, and runs that are stepped from outside.

pub mod ensemble;
mod lanes;
pub mod sensitivities;
pub mod simulate;
pub mod simulator;
#[cfg(test)]
pub(crate) mod tests;
mod threads;
