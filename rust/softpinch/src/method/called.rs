//! The methods as step loops call them. The loops do not know which method they call, so that each loop is compiled once,
//! and so is each step of a method, whatever calls it: a loop, the search for an event, or a run with derivatives.

use crate::formulation::{Runs, SceneEquations, States, System};
use crate::method::{Adaptive, Integrator, Stats, Step, StepResult};
use crate::model::SegmentDrive;
use crate::number::{Bits, LaneTask, Lanes, inlined, task};

pub type AnyMethod<R = f64> = Box<dyn Integrator<R, SceneEquations<R>> + Send + Sync>;
pub type AnyAdaptiveMethod<R = f64> = Box<dyn Adaptive<R, SceneEquations<R>> + Send + Sync>;

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
