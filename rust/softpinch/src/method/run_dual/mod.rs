//! The derivatives of the steps of methods that solve equations. Explicit methods take their steps in dual numbers
//! themselves; here the step is taken in plain numbers, as in any run, and the equations of its solved stages are
//! differentiated after that.
//!
//! | file | contents |
//! |---|---|
//! | `implicit_midpoint.rs`, `radau5.rs` | the derivatives of the stages, by the Jacobian at each of them |
//! | `rosenbrock.rs` | the same for the linearly implicit stages, with the derivative of the Jacobian |

mod implicit_midpoint;
mod radau5;
mod rosenbrock;

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::run_dual::{RunDual, RunDualEquations, RunDualSystem};
use crate::formulation::scene_equations::SceneEquations;
use crate::method::called::{Called, implicit_midpoint, radau5, rosenbrock};
use crate::method::dop853::Dop853;
use crate::method::linearize::{Factors, Linearization};
use crate::method::rk4::Rk4;
use crate::method::table::Method;
use crate::method::traits::{Integrator, Runs, Stats, Step, Unsolved};
use crate::model::drive::SegmentDrive;
use crate::number::lanes::{LaneTask, Lanes, Lift};
use crate::number::linear::{Entry, LaneEntry};
use crate::number::real::Real;
use crate::number::simd::level::Instructions;

/// A method whose last step can be differentiated.
pub trait Differentiable<R: Lanes>: Integrator<f64, SceneEquations<f64>> {
    /// Writes the state `end` of the step just taken, with its derivatives, into `next`.
    fn differentiate(
        &self,
        equations: &RunDualEquations<R>,
        drive: &SegmentDrive<RunDual<R>>,
        step: &Step<'_, RunDual<R>>,
        end: &States<f64>,
        next: &mut States<RunDual<R>>,
    );
}

/// A method that takes each step in plain numbers and differentiates it after that.
struct Solved<M> {
    instructions: Instructions,
    method: Called<M>,
    system: SceneEquations<f64>,
    /// The inputs of the segment without their derivatives.
    drive: SegmentDrive,
}

/// A method as a run with derivatives uses it. Its steps are called, so that the code of the run exists once for all
/// methods.
pub trait RunDualSteps<R: Lanes> {
    /// Begins a segment with the inputs `drive`. `linearized` is the point of the Jacobian that a resumed run uses.
    fn begin(&mut self, drive: SegmentDrive, linearized: Option<(f64, States<f64>)>);

    /// Takes a step ([`Integrator::step`]).
    fn step(
        &mut self,
        equations: &RunDualEquations<R>,
        drive: &SegmentDrive<RunDual<R>>,
        step: &Step<'_, RunDual<R>>,
        next: &mut States<RunDual<R>>,
    ) -> Result<(), Unsolved>;
}

/// The method of a run with derivatives, before its first step.
pub fn run_dual_steps<R: Lanes>(runs: Runs<'_>, method: Method) -> Box<dyn RunDualSteps<R>> {
    // Called, so that a stack frame has one method at most: methods that keep a Jacobian are large.
    #[inline(never)]
    fn solved<R: Lanes, M: Differentiable<R> + 'static>(
        runs: Runs<'_>,
        method: impl Fn(Runs<'_>, &SceneEquations<f64>) -> Called<M>,
    ) -> Box<dyn RunDualSteps<R>> {
        let system = runs.system();
        let (instructions, method) = (runs.instructions, method(runs, &system));
        Box::new(Solved { instructions, method, system, drive: SegmentDrive::still() })
    }
    match method {
        Method::Rk4 => Box::new(Explicit(runs.instructions, Rk4::default())),
        Method::Dop853 => Box::new(Explicit(runs.instructions, Dop853::default())),
        Method::ImplicitMidpoint => solved(runs, implicit_midpoint),
        Method::Radau5 => solved(runs, radau5),
        Method::Rosenbrock => solved(runs, rosenbrock),
    }
}

/// An explicit method, which keeps nothing between steps.
struct Explicit<M>(Instructions, M);

/// A step of an explicit method.
struct ExplicitStep<'a, R, M> {
    method: &'a mut M,
    system: &'a RunDualSystem<R>,
    drive: &'a SegmentDrive<RunDual<R>>,
    step: &'a Step<'a, RunDual<R>>,
    next: &'a mut States<RunDual<R>>,
}

impl<R: Lanes, M: Integrator<RunDual<R>, RunDualSystem<R>>> LaneTask<R> for ExplicitStep<'_, R, M> {
    type Output = Result<(), Unsolved>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { method, system, drive, step, next } = self;
        method.step(system, drive, step, next, &mut Stats::default()).map_err(Into::into)
    }
}

impl<R: Lanes, M: Integrator<RunDual<R>, RunDualSystem<R>>> RunDualSteps<R> for Explicit<M> {
    fn begin(&mut self, _: SegmentDrive, _: Option<(f64, States<f64>)>) {}

    fn step(
        &mut self,
        equations: &RunDualEquations<R>,
        drive: &SegmentDrive<RunDual<R>>,
        step: &Step<'_, RunDual<R>>,
        next: &mut States<RunDual<R>>,
    ) -> Result<(), Unsolved> {
        let system = &equations.system;
        R::call(self.0, ExplicitStep { method: &mut self.1, system, drive, step, next })
    }
}

/// The derivative of a step.
struct Differentiate<'a, R, M> {
    method: &'a M,
    equations: &'a RunDualEquations<R>,
    drive: &'a SegmentDrive<RunDual<R>>,
    step: &'a Step<'a, RunDual<R>>,
    end: &'a States<f64>,
    next: &'a mut States<RunDual<R>>,
}

impl<R: Lanes, M: Differentiable<R>> LaneTask<R> for Differentiate<'_, R, M> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { method, equations, drive, step, end, next } = self;
        method.differentiate(equations, drive, step, end, next);
    }
}

impl<R: Lanes, M: Differentiable<R>> RunDualSteps<R> for Solved<M> {
    fn begin(&mut self, drive: SegmentDrive, linearized: Option<(f64, States<f64>)>) {
        self.method.restart();
        if let Some((tau, y)) = linearized
            && self.method.keeps_jacobian()
        {
            self.method.take_jacobian(&drive, tau, &y);
        }
        self.drive = drive;
    }

    fn step(
        &mut self,
        equations: &RunDualEquations<R>,
        drive: &SegmentDrive<RunDual<R>>,
        step: &Step<'_, RunDual<R>>,
        next: &mut States<RunDual<R>>,
    ) -> Result<(), Unsolved> {
        let (y, rate) = (values(step.y), values(step.rate));
        let own = &Step { tau: step.tau.lane(0), h: step.h.lane(0), y: &y, rate: &rate, allowed: None };
        let mut end = [0.0; MAX_COMPONENTS];
        let Self { instructions, method, system, drive: inputs } = self;
        method.step(system, inputs, own, &mut end, &mut Stats::default())?;
        let method = &method.method;
        R::call(*instructions, Differentiate { method, equations, drive, step, end: &end, next });
        Ok(())
    }
}

/// The values of numbers with derivatives.
#[inline(always)]
pub fn values<R: Lanes>(numbers: &States<RunDual<R>>) -> States<f64> {
    let mut values = [0.0; MAX_COMPONENTS];
    for n in 0..MAX_COMPONENTS {
        values[n] = numbers[n].lane(0);
    }
    values
}

/// Numbers with these values and with derivatives of zero.
#[inline(always)]
fn constants<R: Lanes>(values: &States<f64>) -> States<RunDual<R>> {
    let mut constants = [RunDual::zero(); MAX_COMPONENTS];
    for n in 0..MAX_COMPONENTS {
        constants[n] = RunDual::lift(R::constant(values[n]));
    }
    constants
}

/// For each direction the solution of (g I - J) x = b, where `loads` have the directions' b as derivatives. The
/// solutions are derivatives too.
#[inline(always)]
fn solve_slopes<R: Lanes>(
    linearization: &Linearization<R>,
    factors: &Factors<LaneEntry<R>>,
    loads: &States<RunDual<R>>,
) -> States<RunDual<R>> {
    let mut solutions = [RunDual::zero(); MAX_COMPONENTS];
    for k in 0..loads[0].slope.len() {
        let mut entries = [LaneEntry(R::zero()); MAX_COMPONENTS];
        for n in 0..MAX_COMPONENTS {
            entries[n] = LaneEntry(loads[n].slope[k]);
        }
        let solution = linearization.solve_with_works(factors, &entries);
        for n in 0..MAX_COMPONENTS {
            solutions[n].slope[k] = solution[n].real();
        }
    }
    solutions
}

/// Adds `of`, times a number without derivatives.
#[inline(always)]
fn add_scaled<R: Lanes>(sum: &mut RunDual<R>, weight: R, of: &RunDual<R>) {
    sum.value = weight.mul_add(of.value, sum.value);
    for k in 0..sum.slope.len() {
        sum.slope[k] = weight.mul_add(of.slope[k], sum.slope[k]);
    }
}
