//! The methods that step time: one file for each, with its tableau and its paper.
//!
//! A new method needs one file beside `rk4.rs` with its `MethodEntry`, its lines in `table`, and
//! one each in `run_dual` and the driver's `loops`, where the compiler names what is missing. Explicit methods implement
//! `Integrator` themselves. A method that solves equations for its stages is a `newton::Scheme`,
//! which `newton::Newton` drives. A method with an error estimate implements `Adaptive` as well. An
//! entry makes the method as `called` code.

pub(crate) mod called;
pub(crate) mod dop853;
pub(crate) mod implicit_midpoint;
pub(crate) mod linearize;
pub(crate) mod newton;
pub(crate) mod radau5;
pub(crate) mod rk4;
pub(crate) mod rosenbrock;
pub(crate) mod run_dual;
pub(crate) mod step_control;
pub(crate) mod table;
pub(crate) mod traits;

#[cfg(test)]
mod tests;

pub(crate) use crate::formulation::Runs;
pub(crate) use called::{AnyAdaptiveMethod, AnyMethod, Called, MakeAdaptiveMethod, MethodEntry};
pub(crate) use dop853::Dop853;
pub(crate) use linearize::{Factors, Linearization};
pub(crate) use newton::{Iteration, Newton, Problem, Scheme, Solved};
pub(crate) use rk4::{Rk4, Rk4InLanes};
pub(crate) use rosenbrock::Rosenbrock;
pub(crate) use run_dual::{RunDualMethod, values};
pub(crate) use step_control::StepControl;
pub(crate) use table::MakeInLanes;
pub use table::{METHODS, Method};
pub(crate) use traits::{Adaptive, Allowed, Integrator, Stats, Step, StepResult, Unsolved, largest};
