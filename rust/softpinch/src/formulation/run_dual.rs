//! The equations of a run with their derivatives in directions of the caller's choice: by parameters, inputs and
//! start. Methods take their steps with them in dual numbers.

use crate::formulation::{Choice, MAX_COMPONENTS, SceneEquations, StageState, States, System};
use crate::model::{Constants, SegmentDrive, Stabilization, VariedParameters};
use crate::number::{Dual, Lanes, Lift, Real};

/// A number of a run, the same in every lane, with its derivatives in [`DIRECTIONS`](crate::model::source::DIRECTIONS)
/// directions, for vectors of four lanes.
pub type RunDual<R> = Dual<R, 1>;

/// A number with its derivatives, and the derivative of all of these in one more direction.
type SecondDual<R> = Dual<RunDual<R>, 1>;

/// The equations of one run in numbers with derivatives, as methods use them.
pub type RunDualSystem<R> = SceneEquations<RunDual<R>>;

/// The equations of one run, with all derivatives that methods need.
#[derive(Debug, Clone)]
pub struct RunDualEquations<R> {
    pub system: RunDualSystem<R>,
    /// The same equations for second derivatives, if they are wanted.
    second: Option<Box<SceneEquations<SecondDual<R>>>>,
}

impl<R: Lanes> RunDualEquations<R> {
    /// Builds the equations of a scene. `second` says whether second derivatives are wanted.
    pub fn new(choice: Choice, source: &VariedParameters<'_>, gains: &Stabilization, second: bool) -> Self {
        Self {
            system: SceneEquations::new(choice, source, gains),
            second: second.then(|| Self::second(choice, source, gains)),
        }
    }

    /// They are large, so they are built in a frame of their own.
    #[inline(never)]
    fn second(
        choice: Choice,
        source: &VariedParameters<'_>,
        gains: &Stabilization,
    ) -> Box<SceneEquations<SecondDual<R>>> {
        Box::new(SceneEquations::new(choice, &Constants(source), gains))
    }

    /// The derivative of the rates at the state `y` and time `tau` along the direction `along` of the states and
    /// `by` of time. Zeros if second derivatives were not wanted.
    #[inline(always)]
    pub fn along(
        &self,
        drive: &SegmentDrive<RunDual<R>>,
        (tau, y): (RunDual<R>, &States<RunDual<R>>),
        (along, by): (&States<f64>, RunDual<R>),
    ) -> States<RunDual<R>> {
        let mut change = [RunDual::zero(); MAX_COMPONENTS];
        let Some(system) = &self.second else { return change };
        let mut state = [SecondDual::zero(); MAX_COMPONENTS];
        for n in 0..MAX_COMPONENTS {
            state[n] = SecondDual { value: y[n], slope: [RunDual::constant(along[n])] };
        }
        let input = drive.at(SecondDual { value: tau, slope: [by] });
        let at = StageState { from: &state, by: SecondDual::zero(), along: &state };
        let mut rate = [SecondDual::zero(); MAX_COMPONENTS];
        let mut second = SegmentDrive::still();
        second.contacts = drive.contacts.map(<SecondDual<R> as Lift<RunDual<R>>>::lift);
        second.frame =
            drive.frame.as_ref().map(|frame| frame.lifted(<SecondDual<R> as Lift<RunDual<R>>>::lift).into());
        system.rates(&input, &second, at, &mut rate);
        for (change, rate) in change.iter_mut().zip(rate) {
            [*change] = rate.slope;
        }
        change
    }
}
