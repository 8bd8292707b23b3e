//! The methods as step loops call them, and the entry with which each states its properties. The loops do not know which
//! method they call, so that each loop is compiled once, and so is each step of a method, whatever calls it: a loop, the
//! search for an event, or a run with derivatives.

use nalgebra::Complex;

use crate::formulation::{Runs, SceneEquations, States, System};
use crate::method::{Adaptive, Integrator, Stats, Step, StepResult};
use crate::model::SegmentDrive;
use crate::number::{Bits, LaneTask, Lanes, inlined, task};

pub type AnyMethod<R = f64> = Box<dyn Integrator<R, SceneEquations<R>> + Send + Sync>;
pub type AnyAdaptiveMethod<R = f64> = Box<dyn Adaptive<R, SceneEquations<R>> + Send + Sync>;

/// Makes a method of a single run that chooses the length of its steps, before its first step.
pub type MakeAdaptiveMethod = fn(Runs<'_>, &SceneEquations<f64>) -> AnyAdaptiveMethod;

pub struct MethodEntry {
    /// Its order: the error falls with this power of the step if nothing is stiff.
    pub order: u32,
    /// The end of its stability region on the negative real axis, without its sign; `None` if there is none.
    pub real_stability_limit: Option<f64>,
    /// R(z): the factor by which a step of length h multiplies a mode of eigenvalue z / h.
    pub stability_function: fn(Complex<f64>) -> Complex<f64>,
    /// Whether its steps keep a Jacobian for the steps that follow.
    pub keeps_jacobian: bool,
    /// Makes the method of a single run, before its first step, for the equations of the run.
    pub alone: fn(Runs<'_>, &SceneEquations<f64>) -> AnyMethod,
    /// Makes the method as one that chooses the length of its steps, if it estimates its error.
    pub adaptive: Option<MakeAdaptiveMethod>,
    /// The error estimate grows with this power of the length of the step; zero if there is none.
    pub error_order: f64,
    /// Growth by a smaller factor than this does not change the length of the step.
    pub min_growth: f64,
}

/// A method whose computations are called, each compiled with the instructions of the lanes.
pub struct Called<M>(pub(super) M);

task! {
    pub(super) ['a, R: Lanes, S: System<R>, M: Integrator<R, S>]
    TakeStep<'a, R, S, M>(method: &'a mut M, step: &'a Step<'a, R, S>, next: &'a mut States<R>, stats: &'a mut Stats)
    for R => StepResult = method.step(step, next, stats)
}
task! {
    ['a, R: Lanes, M: Integrator<R, SceneEquations<R>>]
    TakeJacobian<'a, R, M>(method: &'a mut M, drive: &'a SegmentDrive<R>, tau: R, y: &'a States<R>)
    for R => () = method.take_jacobian(drive, tau, y)
}
task! {
    ['a, R: Lanes, M: Adaptive<R, SceneEquations<R>>]
    EstimateError<'a, R, M>(method: &'a mut M, step: &'a Step<'a, R>, retried: Bits, stats: &'a mut Stats)
    for R => R = method.error(step, retried, stats)
}
task! {
    ['a, R: Lanes, M: Adaptive<R, SceneEquations<R>>]
    Prepare<'a, R, M>(method: &'a mut M, step: &'a Step<'a, R>, next: &'a States<R>, stats: &'a mut Stats)
    for R => () = method.prepare(step, next, stats)
}
task! {
    ['a, R: Lanes, M: Adaptive<R, SceneEquations<R>>]
    Interpolate<'a, R, M>(method: &'a M, y: &'a States<R>, next: &'a States<R>, x: R)
    for R => States<R> = method.interpolate(y, next, x)
}

impl<R: Lanes, M: Integrator<R, SceneEquations<R>>> Integrator<R, SceneEquations<R>> for Called<M> {
    inlined! {
        restart(&mut self) -> () = self.0.restart();
        repeat(&mut self) -> () = self.0.repeat();
        renew(&mut self, runs: Runs<'_>) -> () = self.0.renew(runs);
        keeps_jacobian(&self) -> bool = self.0.keeps_jacobian();
        jacobian_is_reusable(&self) -> bool = self.0.jacobian_is_reusable();
    }

    fn step(&mut self, step: &Step<'_, R>, next: &mut States<R>, stats: &mut Stats) -> StepResult {
        R::outlined(TakeStep { method: &mut self.0, step, next, stats })
    }

    fn take_jacobian(&mut self, drive: &SegmentDrive<R>, tau: R, y: &States<R>) {
        R::outlined(TakeJacobian { method: &mut self.0, drive, tau, y });
    }
}

impl<R: Lanes, M: Adaptive<R, SceneEquations<R>>> Adaptive<R, SceneEquations<R>> for Called<M> {
    inlined! { accepted(&mut self, h: R) -> () = self.0.accepted(h); }

    fn error(&mut self, step: &Step<'_, R>, retried: Bits, stats: &mut Stats) -> R {
        R::outlined(EstimateError { method: &mut self.0, step, retried, stats })
    }

    fn prepare(&mut self, step: &Step<'_, R>, next: &States<R>, stats: &mut Stats) {
        R::outlined(Prepare { method: &mut self.0, step, next, stats });
    }

    fn interpolate(&self, y: &States<R>, next: &States<R>, x: R) -> States<R> {
        R::outlined(Interpolate { method: &self.0, y, next, x })
    }
}
