//! How the constraints are kept: from a state to its derivative and the multipliers.
//!
//! A new formulation is one file beside `csm.rs` and one line in [`FORMULATIONS`].

pub mod csm;

use crate::inputs::Input;

/// The formulations there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formulation {
    /// The constraint stabilisation method (19)-(24).
    Csm,
}

/// The formulations by their public names.
pub const FORMULATIONS: [(&str, Formulation); 1] = [("csm", Formulation::Csm)];

/// What a formulation says of one state.
#[derive(Debug, Clone, Copy)]
pub struct Evaluation<R, const N: usize> {
    /// The derivative of the state.
    pub rate: [R; N],
    /// (lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N).
    pub multipliers: [R; 4],
    /// (C_1^H, C_2^H, C_1^N, C_2^N).
    pub residuals: [R; 4],
    /// sin theta_p of both tips, for the monitors.
    pub sin_tilt: [R; 2],
}

/// A first-order system of `N` states, as the integrators see it.
pub trait System<R, const N: usize> {
    /// Derivative and multipliers of the state `y` under the inputs of the instant.
    fn evaluate(&self, input: &Input<R>, y: &[R; N]) -> Evaluation<R, N>;

    /// Adds the constraint-consistent velocity jump that an impulse (J_x, J_y, J_theta) makes:
    /// M dp = J + Phi^T Lambda, Phi dp = 0. Where the state carries the ledger, the works of the impulse and of the
    /// constraints' answer join it: J (p before + p after) / 2, which is exact.
    fn jump(&self, y: &mut [R; N], impulse: &[R; 3]);
}
