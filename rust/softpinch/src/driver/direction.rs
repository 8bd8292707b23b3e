//! What is asked of the derivatives of a run: the directions, and the quantities of its rows.

use crate::model::energy::BILATERAL_WORKS;
use crate::model::inputs::Inputs;
use crate::model::motion::Motion;
use crate::model::parameters::PARAMETER_COUNT;

/// A direction in which a run is differentiated.
#[derive(Debug, Clone)]
pub struct Direction {
    /// The derivatives of the parameters.
    pub parameters: [f64; PARAMETER_COUNT],
    /// The derivatives of the inputs while the breakpoints stay: pieces, sinusoids and impulses as many as those of
    /// the scene, at the same times.
    pub inputs: Inputs,
    /// The derivative of the start, besides what [`Start::varied`](crate::model::start::Start::varied) gives.
    pub initial: Motion<f64>,
    /// What inputs that jump add where their breakpoint moves.
    pub shifts: Vec<Shift>,
    /// The derivative of the time of each impulse, in the order of their times; empty if all are zero.
    pub impulse_times: Vec<f64>,
}

/// The derivative of inputs that jump at a breakpoint by the breakpoint's time is an impulse of the inputs:
/// minus the jump.
#[derive(Debug, Clone, Copy)]
pub struct Shift {
    /// The time of the breakpoint, s.
    pub time: f64,
    /// Minus the jump of the targets, rad or N m, times the derivative of the time.
    pub target: [f64; 2],
    /// The same for the accelerations of driven fingers.
    pub acceleration: [f64; 2],
    /// The same for the forces on the object, N and N m.
    pub force: [f64; 3],
}

/// The quantities whose derivatives a row has, with the number of components of each.
pub const QUANTITIES: [(&str, usize); 5] =
    [("state", 18), ("integral", 2), ("multipliers", 4), ("torque", 2), ("energy", 3 + BILATERAL_WORKS)];

/// Number of components of a row.
pub const COMPONENTS: usize = 18 + 2 + 4 + 2 + 3 + BILATERAL_WORKS;
