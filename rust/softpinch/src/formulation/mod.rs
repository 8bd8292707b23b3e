//! The formulations of the constraints. Each computes the derivative and the multipliers of a state.
//!
//! A new formulation needs one file beside `csm.rs` with its `Equations`, one line in [`FORMULATIONS`], and lines in
//! `scene_equations.rs`, where a scene gets its equations: `SceneEquations`, for numbers of every kind. `run_dual.rs`
//! has those of a run with derivatives. docs/architecture.md lists the files of unilateral contact.

pub(crate) mod constrained;
pub(crate) mod contact_equations;
pub(crate) mod contact_solve;
pub(crate) mod csm;
pub(crate) mod equations;
pub(crate) mod impact;
pub(crate) mod inlined;
pub(crate) mod jumps;
pub(crate) mod mode_selection;
pub(crate) mod nullspace;
pub(crate) mod projected;
pub(crate) mod run_dual;
pub(crate) mod scene_equations;
pub(crate) mod system;
pub(crate) mod table;
pub(crate) mod tangent;
pub(crate) mod unilateral;

pub(crate) use constrained::constrained;
pub(crate) use contact_equations::ContactEquations;
pub(crate) use contact_solve::{Response, response};
pub(crate) use csm::Csm;
pub(crate) use equations::{
    BLOCK, Carried, Equations, Evaluation, MAX_COMPONENTS, Size, States, Terms, for_fingers,
};
pub(crate) use inlined::Inlined;
pub(crate) use jumps::{ApplyJump, ContactJump};
pub(crate) use mode_selection::{Chosen, Contact, choose, contacts_in};
pub(crate) use run_dual::{RunDual, RunDualEquations};
pub(crate) use scene_equations::{Choice, EquationKind, InputAt, SceneEquations, with};
pub(crate) use system::{StageState, System};
pub use table::{FORMULATIONS, Formulation};
pub(crate) use tangent::{Jacobian, LaneParameters, Linear, Runs, Seeded, Tangent};
pub(crate) use unilateral::Unilateral;
