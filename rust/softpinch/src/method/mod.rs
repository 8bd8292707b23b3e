//! The methods that step time: one file for each, with its tableau and its paper.
//!
//! A new method needs one file beside `rk4.rs` with its [`MethodEntry`](entry::MethodEntry), its lines in [`table`], and
//! one in [`run_dual`], where the compiler names what is missing. Explicit methods implement
//! [`Integrator`](traits::Integrator) themselves. A method that solves equations for its stages is a [`newton::Scheme`],
//! which [`newton::Newton`] drives. A method with an error estimate implements [`Adaptive`](traits::Adaptive) as well. An
//! entry makes the method as [`called`] code.

// Loops over several arrays at once are clearer with an index.
#![allow(clippy::needless_range_loop)]

pub mod called;
pub mod dop853;
pub mod entry;
pub mod implicit_midpoint;
pub mod linearize;
pub mod newton;
pub mod radau5;
pub mod rk4;
pub mod rosenbrock;
pub mod run_dual;
pub mod stability;
pub mod step_control;
pub mod table;
pub mod traits;

#[cfg(test)]
mod tests;
