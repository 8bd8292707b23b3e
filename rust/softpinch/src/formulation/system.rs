//! The equations as step loops and methods use them.

use crate::formulation::{Evaluation, Size, States};
use crate::model::{Input, SegmentDrive};
use crate::number::Lanes;

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
