//! The equations as step loops and methods use them.

use crate::formulation::{Evaluation, MAX_COMPONENTS, Runs, States};
use crate::model::{Input, SegmentDrive};
use crate::number::{Lanes, Real, inlined};

/// The numbers of components of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    pub states: usize,
    /// Number of coordinates among these states. The coordinates come first, and their rates follow.
    pub degrees: usize,
    /// Number of works of the ledger that follow the states; 0 if the state does not carry them.
    pub works: usize,
    /// One if the distance of slips follows the works, else zero.
    pub slips: usize,
    /// Number of states of Maxwell branches, which are among the states.
    pub relaxations: usize,
}

/// Number of components that are computed together.
pub const BLOCK: usize = 4;

impl Size {
    inlined! {
        pub all(self) -> usize = self.states + self.works + self.slips;
        pub blocks(self) -> usize = self.all().div_ceil(BLOCK).min(MAX_COMPONENTS / BLOCK);
    }

    /// The distance of slips in a state; zero if it does not carry it.
    #[inline(always)]
    pub fn slipped<R: Real>(self, y: &States<R>) -> R {
        if self.slips > 0 { y[self.all() - 1] } else { R::zero() }
    }

    /// Calls `work` for each component of a state, and for the zeros that fill the last block. The length of
    /// a block is known at compile time.
    #[inline(always)]
    pub fn each(self, mut work: impl FnMut(usize)) {
        for block in 0..self.blocks() {
            for k in 0..BLOCK {
                work(BLOCK * block + k);
            }
        }
    }
}

/// The state `from` + `by` * `along`. Methods pass their stages so, and the equations read only these parts.
#[derive(Clone, Copy)]
pub struct StageState<'a, R> {
    pub from: &'a States<R>,
    /// The factor of `along`, in s if `along` is a rate.
    pub by: R,
    pub along: &'a States<R>,
}

/// The equations of one scene for each lane, as step loops and methods use them.
pub trait System<R: Lanes>: Sized {
    fn size(&self) -> Size;

    /// Evaluates the state `y` at time `tau` of a segment. The zeros that fill the derivative are left as they are.
    fn evaluate_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, now: &mut Evaluation<R>);

    /// Evaluates the state `y` at time `tau` of a segment and returns the result.
    #[inline(always)]
    fn evaluate(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>) -> Evaluation<R> {
        let mut now = Evaluation::nothing();
        self.evaluate_into(drive, tau, y, &mut now);
        now
    }

    /// Computes only the derivative, at the state `at` under the inputs of an instant of the segment, and in its modes of
    /// the contacts. The zeros that fill it are left as they are.
    fn rates(&self, input: &Input<R>, drive: &SegmentDrive<R>, at: StageState<'_, R>, rate: &mut States<R>);
}

/// The derivatives of a system's rates with respect to its states and to time.
pub trait Linear<R: Lanes> {
    /// Writes the Jacobian at time `tau` of a segment and state `y`. The zeros that fill it are left as they are.
    fn jacobian_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, jacobian: &mut Jacobian<R>);

    fn jacobian(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>) -> Jacobian<R> {
        let mut jacobian = Jacobian::zero();
        self.jacobian_into(drive, tau, y, &mut jacobian);
        jacobian
    }

    /// Renews what depends on the runs, after some runs have changed.
    fn renew(&mut self, _runs: Runs<'_>) {}
}

/// The derivatives of a system's rates with respect to its states and to time.
#[derive(Debug, Clone, Copy)]
pub struct Jacobian<R = f64> {
    /// Row by row. The column after the states is the derivative with respect to time.
    pub(crate) rows: [[R; MAX_COMPONENTS]; MAX_COMPONENTS],
}

impl<R: Lanes> Jacobian<R> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self { rows: [[R::zero(); MAX_COMPONENTS]; MAX_COMPONENTS] }
    }
}
