//! What step loops and methods ask of the equations.

use crate::formulation::equations::{Evaluation, ROOM, States};
use crate::model::drive::{Input, SegmentDrive};
use crate::model::energy::{Energies, WORKS};
use crate::model::motion::Motion;
use crate::number::lanes::Lanes;

/// How many numbers a state has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// States of the motion.
    pub states: usize,
    /// How many of these are coordinates, the first ones, with their rates behind them.
    pub degrees: usize,
    /// Whether the ledger's works stand behind the states.
    pub ledger: bool,
}

/// Numbers that are computed at a time.
pub const BLOCK: usize = 4;

impl Size {
    /// Numbers in all.
    #[inline(always)]
    #[must_use]
    pub fn all(self) -> usize {
        self.states + if self.ledger { WORKS } else { 0 }
    }

    /// How many blocks its numbers fill.
    #[inline(always)]
    #[must_use]
    pub fn blocks(self) -> usize {
        self.all().div_ceil(BLOCK).min(ROOM / BLOCK)
    }

    /// Does something for each number of a state, and for the zeros that fill the last block: a block's length is known when this
    /// is compiled.
    #[inline(always)]
    pub fn each(self, mut work: impl FnMut(usize)) {
        for block in 0..self.blocks() {
            for k in 0..BLOCK {
                work(BLOCK * block + k);
            }
        }
    }
}

/// The state `from` + `by` * `along`: as stages are made, so that only what made them is read.
#[derive(Clone, Copy)]
pub struct Moved<'a, R> {
    /// Where it starts from.
    pub from: &'a States<R>,
    /// How far it goes, s where `along` is a rate.
    pub by: R,
    /// In which direction.
    pub along: &'a States<R>,
}

/// The equations of a scene in each lane, as step loops and methods ask for them.
pub trait System<R: Lanes> {
    /// How many numbers its states have.
    fn size(&self) -> Size;

    /// Does something for each number of a state.
    #[inline(always)]
    fn each(&self, work: impl FnMut(usize)) {
        self.size().each(work);
    }

    /// The state of a motion, its works at zero.
    fn begin(&self, motion: &Motion<R>) -> States<R>;

    /// Derivative and multipliers of the state `y` at time `tau` of a segment; what fills the derivative stays as it is.
    fn evaluate_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, now: &mut Evaluation<R>);

    /// The same, given back.
    #[inline(always)]
    fn evaluate(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>) -> Evaluation<R> {
        let mut now = Evaluation::nothing();
        self.evaluate_into(drive, tau, y, &mut now);
        now
    }

    /// The derivative alone, at a state from another one, under the inputs of an instant; what fills it stays as it is.
    fn rates(&self, input: &Input<R>, at: Moved<'_, R>, rate: &mut States<R>);

    /// The velocity jump that an impulse makes ([`crate::formulation::equations::Equations::jump`]).
    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3]);

    /// The energies of a motion, for the ledger.
    fn energies(&self, motion: &Motion<R>) -> Energies<R>;

    /// Whether the formulation puts the end of a step back on the constraints.
    fn corrects(&self) -> bool {
        false
    }

    /// Puts the end of a step back on the constraints, where the formulation does that.
    fn correct(&self, drive: &SegmentDrive<R>, tau: R, y: &mut States<R>) {
        let _ = (drive, tau, y);
    }
}

/// The derivatives of a system's rates, by its states and by time.
pub trait Linear<R: Lanes> {
    /// At time `tau` of a segment and state `y`, in place; what fills the Jacobian stays as it is.
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>);

    /// The same, given back.
    fn jacobian(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>) -> Jacobian<R> {
        let mut jacobian = Jacobian::zero();
        self.jacobian_into(drive, tau, y, &mut jacobian);
        jacobian
    }
}

/// The derivatives of a system's rates by its states and by time.
#[derive(Debug, Clone, Copy)]
pub struct Jacobian<R = f64> {
    /// Row by row; the column behind the states is the derivative by time.
    pub(crate) rows: [[R; ROOM]; ROOM],
}

impl<R: Lanes> Jacobian<R> {
    /// In whose place a Jacobian goes.
    #[must_use]
    #[inline(always)]
    pub fn zero() -> Self {
        Self { rows: [[R::zero(); ROOM]; ROOM] }
    }
}
