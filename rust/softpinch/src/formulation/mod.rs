//! How the constraints are kept: from a state to its derivative and the multipliers.
//!
//! A new formulation is one file beside `csm.rs` with its [`Equations`], one line in [`FORMULATIONS`], and its lines in `chosen.rs`,
//! where a scene gets its equations.

pub mod chosen;
pub mod constrained;
pub mod csm;
pub mod nullspace;
pub mod projected;
pub mod system;
pub mod tangent;

use std::fmt::Debug;

use crate::energy::{Energies, WORKS};
use crate::geometry::index::{D_N, FINGER, THETA};
use crate::inputs::Input;
use crate::parameters::Parameters;
use crate::real::Real;
pub(crate) use chosen::AroundEquations;
pub use chosen::{Choice, Chosen};
pub use system::{BLOCK, Jacobian, Linear, Moved, Size, System};
pub use tangent::Tangent;

/// The formulations there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formulation {
    /// The constraint stabilisation method (19)-(24).
    Csm,
    /// Independent velocities (Maggi's equations): no gains, no drift.
    Nullspace,
    /// Accelerations on the constraints, and after each step the state put back on them.
    Projected,
}

/// The formulations by their public names.
pub const FORMULATIONS: [(&str, Formulation); 3] =
    [("csm", Formulation::Csm), ("nullspace", Formulation::Nullspace), ("projected", Formulation::Projected)];

/// A state in the nine coordinates that every formulation is recorded in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<R> {
    /// Coordinates.
    pub q: [R; 9],
    /// Velocities.
    pub p: [R; 9],
    /// The controllers' memories.
    pub memory: [R; 2],
}

impl Motion<f64> {
    /// The usual size of each number of a scene: lengths against the larger tip's radius, angles against one, rates against
    /// these times sqrt(E a / M), at which such a tip moves the object. An integral without a gain drives nothing, so its error is
    /// none: its size is infinite.
    #[must_use]
    pub fn sizes(parameters: &Parameters) -> Self {
        let [right, left] = &parameters.tips;
        let length = right.radius.max(left.radius);
        let pace = (right.youngs_modulus.max(left.youngs_modulus) * length / parameters.grasped.mass).sqrt();
        let mut q = [length; 9];
        q[THETA] = 1.0;
        q[FINGER..D_N].fill(1.0);
        let memory = parameters.control.map(|pid| if pid.ki == 0.0 { f64::INFINITY } else { 1.0 / pace });
        Self { q, p: q.map(|size| size * pace), memory }
    }

    /// The same with the rates of a scene that its viscosity slows down: E a / c, at which a tip gives way.
    #[must_use]
    pub fn slow_sizes(parameters: &Parameters) -> Self {
        let usual = Self::sizes(parameters);
        let mut pace = usual.p[THETA];
        for tip in &parameters.tips {
            let viscosity = tip.normal_viscosity.max(tip.tangential_viscosity);
            pace = pace.min(tip.youngs_modulus * tip.radius / viscosity);
        }
        Self { p: usual.q.map(|size| size * pace), ..usual }
    }
}

/// Numbers of the largest state: nine coordinates, their rates, two memories, the ledger's works.
pub const ROOM: usize = 20 + WORKS;

/// A state as the integrators see it, in this order: as many coordinates as there are degrees of freedom; their rates; what depends on
/// both and drives the rates (shears, controllers' memories); behind these the ledger's works where they are carried, which drive nothing. How
/// many of each there are is the system's [`Size`]; zeros fill the rest.
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
