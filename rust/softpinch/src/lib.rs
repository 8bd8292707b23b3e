//! The mechanics of a planar pinch with two soft fingertips (Inoue and Hirai, "Dynamic Stable Manipulation via
//! Soft-fingered Hand", ICRA 2007), with the errata of the paper mended.
//!
//! A scene is [`parameters`], [`inputs`] and an initial state; [`simulate`] runs it once, [`ensemble`] many:
//!
//! ```
//! use softpinch::inputs::Inputs;
//! use softpinch::parameters::{Fingertip, Parameters};
//! use softpinch::simulate::{Options, Scene, Status, Steps, simulate};
//! use softpinch::start::{State, contact};
//!
//! let soft = Fingertip { youngs_modulus: 0.2e6, ..Fingertip::default() };
//! let parameters = Parameters { tips: [soft; 2], ..Parameters::default() }.checked()?;
//! let scene = Scene {
//!     initial: State::at_rest(contact(&parameters)?),
//!     parameters,
//!     inputs: Inputs::hold([6_f64.to_radians(); 2]),
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
//! `cargo run --release --example paper` simulates the manipulation of the paper, and the example `csm_by_nalgebra` is (24) written out
//! with matrices, as a specification of what the kernels compute. Bad input is an [`error::Error`]; a run that goes
//! wrong is a result with a status. There is no Python in here, and there are no features to choose.
//!
//! | module | what | equations |
//! |---|---|---|
//! | [`parameters`] | hand, tips, object, gains, and their rules | Tables I, II |
//! | [`geometry`] | tip positions, residuals, constraint matrix and its rate | (6)-(12), (25)-(30) |
//! | [`energy`] | elastic and gravity energy, gradients, ledger | (5), (16), (34), (35) |
//! | [`dynamics`] | applied forces | (31)-(33), (43)-(45) |
//! | [`control`] | finger torques | (39) |
//! | [`inputs`], [`noise`] | schedules, disturbances | (40)-(42) |
//! | [`formulation`] | how constraints are kept | (19)-(24) |
//! | [`integrator`] | how time is stepped | |
//! | [`grid`] | the times of the steps | |
//! | [`start`] | initial states | |
//! | [`monitor`] | where the model stops holding | |
//! | [`record`] | what a run keeps | |
//! | [`simulate`], [`stepping`] | one run, its step loops | |
//! | [`ensemble`], [`summary`] | many runs, what each comes to | |
//! | [`real`], [`lanes`], [`dual`], [`trigonometry`], [`linear`], [`simd`] | numbers, derivatives, sines, small solves, instructions | |
//! | [`evaluate`], [`modes`] | every term at one state, as matrices; the Jacobian of the motion about it | (24), (25) |
//!
//! Coordinates q = (x, y, theta, theta_1, theta_2, d_n1, d_n2, d_t1, d_t2), p their rates. SI units, radians. Finger 1, the
//! right one, has index 0.

pub mod control;
pub mod dual;
pub mod dynamics;
pub mod energy;
pub mod ensemble;
pub mod error;
pub mod evaluate;
pub mod formulation;
pub mod geometry;
pub mod grid;
pub mod inputs;
pub mod integrator;
pub mod lanes;
pub mod linear;
pub mod modes;
pub mod monitor;
pub mod noise;
pub mod parameters;
pub mod real;
pub mod record;
pub mod simd;
pub mod simulate;
pub mod start;
pub mod stepping;
pub mod summary;
pub mod trigonometry;

// The example calls the crate by its name.
#[cfg(test)]
extern crate self as softpinch;
#[cfg(test)]
mod tests;

/// Changes whenever the bits of a result do.
pub const RESULTS_VERSION: u32 = 6;
