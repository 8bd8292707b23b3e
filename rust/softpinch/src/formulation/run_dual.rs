//! The equations of a run with their derivatives in directions of the caller's choice: by parameters, inputs and
//! start. Methods take their steps with them in dual numbers. Only bilateral contact is compiled for these numbers.

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::scene_equations::{Choice, SceneEquations};
use crate::formulation::system::{Jacobian, StageState, System};
use crate::model::contact_modes::Contacts;
use crate::model::drive::{Input, SegmentDrive};
use crate::model::parameters::Stabilization;
use crate::model::source::{Constants, DIRECTIONS, VariedParameters};
use crate::number::dual::Dual;
use crate::number::lanes::{Lanes, Lift};
use crate::number::real::Real;
use crate::number::simd::level::Instructions;

/// A number of a run, the same in every lane, with its derivatives in [`DIRECTIONS`]
/// directions, for vectors of four lanes.
pub type RunDual<R> = Dual<R, 2>;

/// A number with its derivatives, and the derivative of all of these in one more direction.
type SecondDual<R> = Dual<RunDual<R>, 1>;

/// The equations of one run in numbers with derivatives, as methods use them.
pub type RunDualSystem<R> = SceneEquations<RunDual<R>, false>;

/// The equations of one run, with all derivatives that methods need.
#[derive(Debug, Clone, Copy)]
pub struct RunDualEquations<R> {
    /// The equations.
    pub system: RunDualSystem<R>,
    /// The same equations without derivatives by parameters.
    without_parameters: RunDualSystem<R>,
    /// The same equations for second derivatives, if they are wanted.
    second: Option<SceneEquations<SecondDual<R>, false>>,
}

impl<R: Lanes> RunDualEquations<R> {
    /// Builds the equations of a scene. `second` says whether second derivatives are wanted.
    pub fn new(
        instructions: Instructions,
        choice: Choice,
        source: &VariedParameters<'_>,
        gains: &Stabilization,
        second: bool,
    ) -> Self {
        let constants = Constants(source.parameters);
        Self {
            system: SceneEquations::bilateral(instructions, choice, source, gains),
            without_parameters: SceneEquations::bilateral(instructions, choice, &constants, gains),
            second: second
                .then(|| SceneEquations::bilateral(instructions, choice, &Constants(source), gains)),
        }
    }

    /// The Jacobian of the rates by the states, under the inputs of an instant.
    #[inline(always)]
    pub fn jacobian(&self, input: &Input<RunDual<R>>, y: &States<f64>) -> Jacobian {
        let size = self.system.size();
        let constant = |number: RunDual<R>| RunDual::lift(number.value);
        let input = &Input {
            target: input.target.map(constant),
            target_rate: input.target_rate.map(constant),
            target_acceleration: input.target_acceleration.map(constant),
            force: input.force.map(constant),
        };
        let mut jacobian = Jacobian::zero();
        let mut rate = [RunDual::zero(); MAX_COMPONENTS];
        for first in (0..size.states).step_by(DIRECTIONS) {
            let mut state = y.map(RunDual::<R>::constant);
            for n in first..size.states.min(first + DIRECTIONS) {
                let (vector, lane) = ((n - first) / R::WIDTH, (n - first) % R::WIDTH);
                state[n].slope[vector].set(lane, 1.0);
            }
            let at = StageState { from: &state, by: RunDual::zero(), along: &state };
            self.without_parameters.rates(input, &Contacts::sticking(), at, &mut rate);
            for row in 0..size.all() {
                for n in first..size.states.min(first + DIRECTIONS) {
                    jacobian.rows[row][n] = rate[row].direction(n - first);
                }
            }
        }
        jacobian
    }

    /// The derivative of the rates at the state `y` and time `tau` along the direction `along` of the states and
    /// `by` of time. Zeros if second derivatives were not wanted.
    #[inline(always)]
    pub fn along(
        &self,
        drive: &SegmentDrive<RunDual<R>>,
        (tau, y): (RunDual<R>, &States<RunDual<R>>),
        (along, by): (&States<f64>, f64),
    ) -> States<RunDual<R>> {
        let mut change = [RunDual::zero(); MAX_COMPONENTS];
        let Some(system) = &self.second else { return change };
        let mut state = [SecondDual::zero(); MAX_COMPONENTS];
        for n in 0..MAX_COMPONENTS {
            state[n] = SecondDual { value: y[n], slope: [RunDual::constant(along[n])] };
        }
        let input = drive.at(SecondDual { value: tau, slope: [RunDual::constant(by)] });
        let at = StageState { from: &state, by: SecondDual::zero(), along: &state };
        let mut rate = [SecondDual::zero(); MAX_COMPONENTS];
        system.rates(&input, &Contacts::sticking(), at, &mut rate);
        for (change, rate) in change.iter_mut().zip(rate) {
            [*change] = rate.slope;
        }
        change
    }
}
