//! The mechanics of a planar pinch with two soft fingertips (Inoue and Hirai, "Dynamic Stable Manipulation
//! via Soft-fingered Hand", ICRA 2007), with the errata of the paper corrected.
//!
//! A scene consists of [`model::parameters`], [`model::inputs`] and an initial state. [`driver::simulate`]
//! runs a scene once, [`driver::ensemble`] runs many, [`driver::simulator`] steps runs from outside:
//!
//! ```
//! use softpinch::driver::simulate::simulate;
//! use softpinch::model::inputs::Inputs;
//! use softpinch::model::parameters::{Fingertip, Parameters};
//! use softpinch::model::scene::Scene;
//! use softpinch::model::start::{State, contact};
//! use softpinch::stepping::options::{Options, Steps};
//! use softpinch::stepping::status::Status;
//!
//! let soft = Fingertip { youngs_modulus: 0.2e6, ..Fingertip::default() };
//! let parameters = Parameters { tips: [soft; 2], ..Parameters::default() }.checked()?;
//! let scene = Scene {
//!     initial: State::at_rest(contact(&parameters)?),
//!     parameters,
//!     inputs: Inputs::constant_targets([6_f64.to_radians(); 2]),
//!     check: true,
//!     duration: 0.5,
//! };
//! let options = Options { steps: Steps::Fixed(1e-4), every: 10, ..Options::default() };
//! let (run, _) = simulate(&scene, &options, &|| false)?;
//! assert_eq!(run.status, Status::Completed);
//! println!("after {} s: theta = {} rad", run.last.t, run.last.q[2]);
//! # Ok::<(), softpinch::error::Error>(())
//! ```
//!
//! `cargo run --release --example paper` simulates the manipulation of the paper. The example
//! `csm_by_nalgebra` writes (24) out with matrices, as a specification of what the kernels compute. Bad input
//! is an [`error::Error`]; a run that goes wrong is a result with a status. The crate has no Python in it and
//! no features to choose.
//!
//! The modules are listed from the ground up: a top-level module uses only those above it in this list.
//!
//! | module | contents | equations |
//! |---|---|---|
//! | [`number`] | real numbers, lanes of several runs, instructions, derivatives, sines, small solves | |
//! | [`model::parameters`] | hand, tips, object, gains, and their rules | Tables I, II |
//! | [`model::geometry`] | tip positions, residuals, constraint matrix and its rate | (6)-(12), (25)-(30) |
//! | [`model::energy`] | elastic and gravity energy, gradients, ledger | (5), (16), (34), (35) |
//! | [`model::forces`] | applied forces, the mass matrix | (14), (31)-(33), (43)-(45) |
//! | [`model::control`] | finger torques | (39) |
//! | [`model::inputs`], [`model::drive`], [`model::noise`] | schedules, disturbances | (40)-(42) |
//! | [`model::sampled`], [`model::measures`] | discrete controllers | |
//! | [`model::start`] | initial states | |
//! | [`model::contact_modes`] | modes of contacts that slip and open | |
//! | [`formulation`] | how constraints are kept; unilateral contact, impacts, the choice of modes | (19)-(24) |
//! | [`method`] | how time is stepped | |
//! | [`stepping`] | the two step loops, times of steps, events of contacts, monitors, summaries, recording | |
//! | [`driver`] | one run, many runs, runs stepped from outside | |
//! | [`analysis`] | every term at one state, as matrices; the linearised motion about it | (24), (25) |
//!
//! The coordinates are q = (x, y, theta, theta_1, theta_2, d_n1, d_n2, d_t1, d_t2), with the rates p. All
//! numbers are in SI units and radians. Finger 1, the right one, has index 0.

pub mod analysis;
pub mod driver;
pub mod error;
pub mod formulation;
pub mod method;
pub mod model;
pub mod number;
pub mod stepping;

// The examples that the tests include call the crate by its name.
#[cfg(test)]
extern crate self as softpinch;
#[cfg(test)]
mod tests;

/// Version of the results. It must change whenever the bits of a result change.
pub const RESULTS_VERSION: u32 = 6;
