//! How the constraints are kept: from a state to its derivative and the multipliers.
//!
//! A new formulation is one file beside `csm.rs` with its [`Equations`](equations::Equations), one line in
//! [`FORMULATIONS`](table::FORMULATIONS), and its lines in `chosen.rs`, where a scene gets its equations.

pub mod chosen;
pub mod constrained;
pub mod csm;
pub mod equations;
pub mod nullspace;
pub mod projected;
pub mod system;
pub mod table;
pub mod tangent;
