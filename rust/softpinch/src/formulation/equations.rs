//! What a formulation gives: from a state to its derivative and the multipliers.

use std::fmt::Debug;

use crate::model::drive::Input;
use crate::model::energy::{Energies, WORKS};
use crate::model::motion::Motion;
use crate::number::real::Real;

/// Numbers of the largest state: nine coordinates, their rates, two memories, the ledger's works.
pub const ROOM: usize = 20 + WORKS;

/// A state as the integrators see it, in this order: as many coordinates as there are degrees of freedom; their rates; what depends on
/// both and drives the rates (shears, controllers' memories); behind these the ledger's works where they are carried, which drive nothing. How
/// many of each there are is the system's [`Size`](super::system::Size); zeros fill the rest.
pub type States<R> = [R; ROOM];

/// What a formulation says of one state.
#[derive(Debug, Clone, Copy)]
pub struct Evaluation<R> {
    /// The derivative of the state.
    pub rate: States<R>,
    /// The state in nine coordinates.
    pub motion: Motion<R>,
    /// (lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N).
    pub multipliers: [R; 4],
    /// (C_1^H, C_2^H, C_1^N, C_2^N).
    pub residuals: [R; 4],
    /// sin theta_p of both tips, for the monitors.
    pub sin_tilt: [R; 2],
    /// Torques on the fingers, N m.
    pub torque: [R; 2],
}

impl<R: Real> Evaluation<R> {
    /// Zeros, in whose place an evaluation goes.
    #[inline(always)]
    pub(crate) fn nothing() -> Self {
        let zero = R::zero();
        Self {
            rate: [zero; ROOM],
            motion: Motion { q: [zero; 9], p: [zero; 9], memory: [zero; 2] },
            multipliers: [zero; 4],
            residuals: [zero; 4],
            sin_tilt: [zero; 2],
            torque: [zero; 2],
        }
    }
}

/// The equations of a formulation and a kind of fingers, in numbers of any kind. `ledger` says whether the state carries the ledger's
/// works.
pub trait Equations<R: Real>: Copy + Debug {
    /// How many states the motion has.
    const STATES: usize;
    /// How many of them are coordinates, the first ones, with their rates behind them.
    const DEGREES: usize;

    /// The state of a motion, its works at zero.
    fn begin(&self, motion: &Motion<R>) -> States<R>;

    /// Derivative and multipliers of the state `y` under the inputs of the instant.
    fn evaluate(&self, input: &Input<R>, y: &States<R>, ledger: bool) -> Evaluation<R>;

    /// Adds the constraint-consistent velocity jump that an impulse (J_x, J_y, J_theta) makes:
    /// M dp = J + Phi^T Lambda, Phi dp = 0. The works of the impulse and of the constraints' answer join the ledger:
    /// J (p before + p after) / 2, which is exact.
    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3], ledger: bool);

    /// The energies of a motion, for the ledger.
    fn energies(&self, motion: &Motion<R>) -> Energies<R>;
}
