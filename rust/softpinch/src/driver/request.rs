//! What is asked for of the derivatives of a run, and what is given back.

use crate::model::{BILATERAL_WORKS, Inputs, Motion, PARAMETER_COUNT, RELAXATIONS, Scene, Start};
use crate::stepping::{Options, Summary};

/// A direction in which a run is differentiated.
#[derive(Debug, Clone)]
pub struct Direction {
    /// The derivatives of the parameters.
    pub parameters: [f64; PARAMETER_COUNT],
    /// The derivatives of the inputs while the breakpoints stay, with as many pieces, sinusoids and impulses.
    pub inputs: Inputs,
    /// The derivative of the start, besides what [`Start::varied`](crate::model::start::Start::varied) gives.
    pub initial: Motion<f64>,
    /// What inputs that jump add where their breakpoint moves.
    pub shifts: Vec<Shift>,
    /// The derivative of the time of each impulse, in the order of their times; empty if all are zero.
    pub impulse_times: Vec<f64>,
}

impl Direction {
    /// Whether a breakpoint at which inputs jump moves.
    pub(super) fn moves(&self, time: f64) -> bool {
        self.shifts.iter().any(|shift| shift.time == time)
    }
}

/// The derivative of inputs by the time of a breakpoint at which they jump: an impulse of minus the jump.
#[derive(Debug, Clone, Copy)]
pub struct Shift {
    /// The time of the breakpoint, s.
    pub time: f64,
    /// Minus the jumps, times the derivative of the time: of the targets (rad or N m), of the accelerations of driven
    /// fingers, of the forces on the object (N and N m), and of the acceleration of the hand along fixed axes.
    pub by: [f64; 9],
}

/// The quantities whose derivatives a row has, with the number of components of each.
pub const QUANTITIES: [(&str, usize); 6] = [
    ("state", 18),
    ("integral", 2),
    ("relaxation", RELAXATIONS),
    ("multipliers", 4),
    ("torque", 2),
    ("energy", 3 + BILATERAL_WORKS),
];

/// Number of components of a row.
pub const COMPONENTS: usize = 20 + RELAXATIONS + 4 + 2 + 3 + BILATERAL_WORKS;

/// Why a run could not be followed to its end in a direction, if so; the numbers from there on are NaN. And the derivatives of
/// the times of the changes of contacts' modes until then.
pub type DirectionEnd = (Option<String>, Vec<f64>);

/// The derivatives of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Derivatives {
    /// For each direction the components of [`QUANTITIES`], row by row.
    pub numbers: Vec<f64>,
    /// The summaries, for each direction together. A summary that has no derivative, or has seen no instant, gives NaN.
    pub summaries: Vec<f64>,
    /// For each direction where its numbers end.
    pub ends: Vec<DirectionEnd>,
}

/// A run, and what is wanted of its derivatives.
#[derive(Clone, Copy)]
#[allow(missing_docs)] // of fields that their types explain
pub struct Request<'a> {
    pub scene: &'a Scene,
    pub options: &'a Options,
    /// What the scene's start follows from, if it is not given.
    pub start: Option<Start>,
    pub directions: &'a [Direction],
    /// The instants of the rows. At a breakpoint a row has the state before its shifts and impulses. Without rows, the scene is
    /// only checked.
    pub rows: &'a [f64],
    /// Summaries until the last row.
    pub summaries: &'a [Summary],
    /// Called every few milliseconds, says whether to stop.
    pub interrupted: &'a dyn Fn() -> bool,
}
