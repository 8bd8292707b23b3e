//! How time is stepped: one file a method, each with its tableau and its paper.
//!
//! A new method is one file beside `rk4.rs`, its line in [`Method`](table::Method), [`METHODS`](table::METHODS) and the properties
//! below them, and one in `driver/simulate.rs`, which compiles it. Explicit methods implement [`Integrator`](traits::Integrator)
//! themselves; one whose stages are solved for is a [`newton::Scheme`] that [`newton::Newton`] drives; one with an error estimate is
//! [`Adaptive`](traits::Adaptive) too.

// Several small arrays run in step: an index says so best.
#![allow(clippy::needless_range_loop)]

pub mod dop853;
pub mod implicit_midpoint;
pub mod linearize;
pub mod newton;
pub mod radau5;
pub mod rk4;
pub mod rosenbrock;
pub mod stability;
pub mod step_control;
pub mod table;
pub mod traits;

#[cfg(test)]
mod tests;
