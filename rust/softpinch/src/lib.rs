//! The mechanics of a planar pinch with two soft fingertips (Inoue and Hirai, "Dynamic Stable Manipulation
//! via Soft-fingered Hand", ICRA 2007), with the errata of the paper corrected.
//!
//! A scene consists of `model::parameters`, `model::inputs` and an initial state. [`driver::simulate()`]
//! runs a scene once, [`driver::ensemble()`] runs many, [`driver::Simulator`] steps runs from outside. This is the paper's
//! operation 1, from the first contact of the tips to a grip at 6 degrees:
//!
//! ```
//! use softpinch::prelude::*;
//!
//! let parameters = Parameters::default().checked()?;
//! let initial = State::at_rest(contact(&parameters)?);
//! let inputs = Inputs::constant_targets([6_f64.to_radians(); 2]);
//! let scene = Scene { parameters, inputs, initial, check: true, duration: 1.0 };
//! let (run, _) = simulate(&scene, &Options::default(), &|| false)?;
//! println!("{}: d_n = {:.2} mm", run.status.name(), 1e3 * run.last.motion.q.compression[0]);
//! # assert_eq!(run.status, Status::Completed);
//! # Ok::<(), Error>(())
//! ```
//!
//! `cargo run --release --example paper` simulates the manipulation of the paper. The example
//! `csm_by_nalgebra` writes (24) out with nalgebra's matrices, as a specification of what the kernels compute, and
//! prints the time of a step of both. nalgebra is used wherever a matrix is a matrix ([`analysis`]); the kernels have small
//! solves of their own (`number::linear`), because these give the same bits in one lane, in eight and in dual numbers, scale
//! exactly by powers of two, and use the structure of M and Phi, most of whose entries are zero.
//!
//! Bad input is an [`error::Error`]; a run that goes wrong is a result with a status. The crate has no Python in it and no features to
//! choose.
//!
//! The modules are listed from the ground up: a top-level module uses only those above it in this list.
//! Each lists, in its first file, the names that other modules use.
//!
//! | module | contents | equations |
//! |---|---|---|
//! | [`number`] | real numbers, lanes of several runs, instructions, derivatives, sines, powers, small solves | |
//! | `model::parameters` | hand, tips, object, gains, and their rules | Tables I, II |
//! | `model::contact::mechanism` | the tip's centre and its tilt | (7), (8), (11) |
//! | `model::contact::shape` | the object's sides | |
//! | `model::contact::law` | elastic energy of a tip and its gradient | (5), (34), (35) |
//! | `model::contact` | one contact: tilt, residuals, rows and their rates | (6), (9), (10), (12), (26)-(30) |
//! | `model::coordinates` | the record of numbers by coordinate | (15) |
//! | `model::geometry` | both contacts: the constraint matrix | (17), (21), (25) |
//! | `model::energy` | energies, ledger | (16) |
//! | `model::forces` | applied forces, the mass matrix | (14), (31)-(33), (43)-(45) |
//! | `model::control` | finger torques | (39) |
//! | `model::inputs`, `model::drive`, `model::noise` | schedules, disturbances | (40)-(42) |
//! | `model::sampled`, `model::measures` | discrete controllers | |
//! | [`model::start`] | initial states | |
//! | `model::contact_modes` | modes of contacts that slip and open | |
//! | [`formulation`] | how constraints are kept; unilateral contact, impacts, the choice of modes | (19)-(24) |
//! | [`method`] | how time is stepped | |
//! | [`stepping`] | the two step loops, times of steps, events of contacts, monitors, summaries, recording | |
//! | [`driver`] | one run, many runs, runs stepped from outside | |
//! | [`analysis`] | every term at one state, as matrices; the linearised motion about it | (24), (25) |
//! | [`prelude`] | the names that the example above needs | |
//!
//! The coordinates are q = (x, y, theta, theta_1, theta_2, d_n1, d_n2, d_t1, d_t2), with the rates p. All
//! numbers are in SI units and radians. Finger 1, the right one, has index 0.

pub mod analysis;
pub mod driver;
pub mod error;
pub mod formulation;
pub mod method;
pub mod model;
mod names;
pub mod number;
pub mod prelude;
pub mod stepping;

// The examples that the tests include call the crate by its name.
#[cfg(test)]
extern crate self as softpinch;
#[cfg(test)]
mod tests;

/// Version of the results. It must change whenever the bits of a result change.
pub const RESULTS_VERSION: u32 = 13;
