//! The interface of a formulation: it computes the derivative and the multipliers of a state.

use std::fmt::Debug;

use crate::model::contact_modes::Contacts;
use crate::model::drive::Input;
use crate::model::energy::{BILATERAL_WORKS, Energies};
use crate::model::motion::Motion;
use crate::number::real::Real;

/// Number of components of the largest state: nine coordinates, their rates, two memories, the seven works of
/// the ledger, and one that fills the last block.
pub const MAX_COMPONENTS: usize = 28;

/// A state as the integrators see it. Its components are, in this order: one coordinate for each degree of
/// freedom; the rates of these coordinates; quantities that depend on both and drive the rates (shears,
/// controllers' memories); the works of the ledger if it is carried, which drive nothing. The system's
/// [`Size`](super::system::Size) has the number of each. Zeros fill the rest.
pub type States<R> = [R; MAX_COMPONENTS];

/// The results of a formulation at one state.
#[derive(Debug, Clone, Copy)]
pub struct Evaluation<R> {
    /// The derivative of the state.
    pub rate: States<R>,
    /// The state in the nine coordinates.
    pub motion: Motion<R>,
    /// (lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N).
    pub multipliers: [R; 4],
    /// (C_1^H, C_2^H, C_1^N, C_2^N).
    pub residuals: [R; 4],
    /// sin theta_p of both tips, for the monitors.
    pub sin_tilt: [R; 2],
    /// s_i G_i (11): where both contacts are along the faces, m, for the monitors.
    pub places: [R; 2],
    /// Torques on the fingers, N m.
    pub torque: [R; 2],
    /// The part psi of each tip's couple that acts. Only unilateral contact computes it.
    pub share: [R; 2],
}

impl<R: Real> Evaluation<R> {
    /// An evaluation of zeros, to be overwritten.
    #[inline(always)]
    pub(crate) fn nothing() -> Self {
        let zero = R::zero();
        Self {
            rate: [zero; MAX_COMPONENTS],
            motion: Motion { q: [zero; 9], p: [zero; 9], memory: [zero; 2] },
            multipliers: [zero; 4],
            residuals: [zero; 4],
            sin_tilt: [zero; 2],
            places: [zero; 2],
            torque: [zero; 2],
            share: [zero; 2],
        }
    }
}

/// The equations of a formulation for one kind of fingers, in numbers of any type. `ledger` says whether the
/// state carries the works of the ledger.
pub trait Equations<R: Real>: Copy + Debug {
    /// Number of states of the motion.
    const STATES: usize;
    /// Number of coordinates among these states. The coordinates come first, and their rates follow.
    const DEGREES: usize;
    /// Number of works of the ledger.
    const WORKS: usize = BILATERAL_WORKS;
    /// Whether contacts can slip and open.
    const UNILATERAL: bool = false;

    /// The state of a motion, with works of zero.
    fn begin(&self, motion: &Motion<R>) -> States<R>;

    /// Derivative and multipliers of the state `y` under the inputs of the instant. Bilateral contact ignores
    /// the modes in `contacts`.
    fn evaluate(
        &self,
        input: &Input<R>,
        contacts: &Contacts<R>,
        y: &States<R>,
        ledger: bool,
    ) -> Evaluation<R>;

    /// Adds the velocity jump that an impulse (J_x, J_y, J_theta) makes. It keeps the constraints: Phi dp = 0
    /// and M dp = J + Phi^T Lambda. The works of the impulse and of the constraint impulses Lambda are added
    /// to the ledger as J (p before + p after) / 2, which is exact.
    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3], ledger: bool);

    /// The energies of a motion, for the ledger. Bilateral contact ignores the modes in `contacts`.
    fn energies(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R>;
}
