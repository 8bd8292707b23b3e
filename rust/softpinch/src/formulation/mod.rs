//! The formulations of the constraints. Each computes the derivative and the multipliers of a state.
//!
//! A new formulation needs one file beside `csm.rs` with its [`Equations`], one line in [`FORMULATIONS`], and lines in
//! `scene_equations.rs`, where a scene gets its equations: [`SceneEquations`], for numbers of every kind. `run_dual.rs`
//! has those of a run with derivatives.
//!
//! Unilateral contact, which slips and opens:
//!
//! | file | contents |
//! |---|---|
//! | `any_parts.rs` | the equations of parts that are not the paper's |
//! | `unilateral.rs` | the equations in given modes |
//! | `contact_solve.rs` | their 4 x 4 solve |
//! | `impact.rs` | the impact law |
//! | `mode_selection.rs` | the choice of modes |
//! | `jumps.rs` | what happens to the motion at events |
//! | `contact_equations.rs` | all of these as the search for events uses them |

// Loops over several arrays at once are clearer with an index.
#![allow(clippy::needless_range_loop)]

pub mod any_parts;
pub mod constrained;
pub mod contact_equations;
pub mod contact_solve;
pub mod csm;
pub mod equations;
pub mod impact;
pub mod inlined;
pub mod jumps;
pub mod mode_selection;
pub mod nullspace;
pub mod projected;
pub mod run_dual;
pub mod scene_equations;
pub mod system;
pub mod table;
pub mod tangent;
pub mod unilateral;

pub use any_parts::AnyParts;
pub use constrained::{Constrained, constrained};
pub use contact_equations::ContactEquations;
pub use contact_solve::{Response, response};
pub use csm::Csm;
pub(crate) use equations::for_fingers;
pub use equations::{Equations, Evaluation, MAX_COMPONENTS, States, Terms};
pub(crate) use inlined::Inlined;
pub(crate) use jumps::{ApplyJump, ContactJump};
pub use mode_selection::{Chosen, Contact, choose, contacts_in};
pub use run_dual::{RunDual, RunDualEquations, RunDualSystem};
pub use scene_equations::{Choice, SceneEquations};
pub(crate) use scene_equations::{EquationKind, InputAt, with};
pub use system::{BLOCK, Jacobian, Linear, Size, StageState, Stages, System};
pub use table::{FORMULATIONS, Formulation};
pub use tangent::{Seeded, Tangent};
pub use unilateral::Unilateral;
