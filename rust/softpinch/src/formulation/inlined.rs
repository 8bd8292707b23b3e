//! The equations inlined into the work that uses them.
//!
//! RK4 does so, because its step does little besides evaluating them: if the equations were called, a step of a single
//! run would take 20 to 25 % longer (measured: docs/what-a-scene-pays.md).

use crate::formulation::equations::size_of;
use crate::formulation::scene_equations::{evaluate_into, rates_into};
use crate::formulation::{Carried, Equations, Evaluation, SceneEquations, Size, StageState, States, System};
use crate::model::{Input, SegmentDrive};
use crate::number::{Lanes, inlined};

/// The equations without the ledger, inlined wherever their rates are needed instead of called. That there is no
/// ledger, and how the fingers move, is known at compile time, which saves another 3 to 5 % of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inlined<'a, R, E, const DRIVEN: bool> {
    pub(crate) equations: &'a E,
    /// The same equations, called, for the rare work.
    pub(crate) called: &'a SceneEquations<R>,
}

impl<R: Lanes, E: Equations<R>, const DRIVEN: bool> System<R> for Inlined<'_, R, E, DRIVEN> {
    inlined! {
        size(&self) -> Size = size_of(self.equations, DRIVEN, Carried::default());
        rates(&self, input: &Input<R>, drive: &SegmentDrive<R>, at: StageState<'_, R>, rate: &mut States<R>) -> () =
            rates_into(self.equations, (DRIVEN, Carried::default()), ((input, None), &drive.contacts), at, rate);
    }

    #[inline(always)]
    fn evaluate_into(&self, drive: &SegmentDrive<R>, tau: R, y: &States<R>, now: &mut Evaluation<R>) {
        let input = drive.at(tau);
        evaluate_into(
            self.equations,
            (DRIVEN, Carried::default()),
            ((&input, None), &drive.contacts),
            y,
            now,
        );
    }
}
