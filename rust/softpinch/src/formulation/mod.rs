//! The formulations of the constraints. Each computes the derivative and the multipliers of a state.
//!
//! A new formulation needs one file beside `csm.rs` with its [`Equations`](equations::Equations), one line in
//! [`FORMULATIONS`](table::FORMULATIONS), and lines in `chosen.rs`, where a scene gets its equations.

pub mod chosen;
pub mod constrained;
pub mod csm;
pub mod equations;
pub mod nullspace;
pub mod projected;
pub mod system;
pub mod table;
pub mod tangent;
