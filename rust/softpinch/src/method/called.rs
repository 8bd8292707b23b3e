//! The methods as step loops call them. The loops do not know which method they call, so that each loop is compiled once,
//! and so is each step of a method, whatever calls it: a loop, the search for an event, or a run with derivatives.

use crate::formulation::{SceneEquations, States};
use crate::method::{Adaptive, Integrator, Runs, Stats, Step, StepResult};
use crate::model::SegmentDrive;
use crate::number::{Bits, Instructions, LaneTask, Lanes};

pub type AnyMethod<R = f64> = Box<dyn Integrator<R, SceneEquations<R>> + Send + Sync>;
pub type AnyAdaptiveMethod<R = f64> = Box<dyn Adaptive<R, SceneEquations<R>> + Send + Sync>;

/// A method whose computations are called, each compiled with the instructions of the lanes.
pub struct Called<M> {
    pub(super) instructions: Instructions,
    pub(super) method: M,
    /// Renews what depends on the parameters of the runs.
    pub(super) renew: fn(&mut M, Runs<'_>),
}

impl<M> Called<M> {
    pub(super) fn new(runs: Runs<'_>, method: M) -> Self {
        Self { instructions: runs.instructions, method, renew: |_, _| {} }
    }
}

/// Declares a computation of a method as a task.
macro_rules! task {
    ($name:ident<$bound:ident>($method:ty, $($field:ident: $type:ty),*) -> $output:ty, $this:ident => $body:expr) => {
        struct $name<'a, R, M> {
            $this: $method,
            $($field: $type),*
        }

        impl<R: Lanes, M: $bound<R, SceneEquations<R>>> LaneTask<R> for $name<'_, R, M> {
            type Output = $output;

            #[inline(always)]
            fn run(self) -> $output {
                let Self { $this, $($field),* } = self;
                $body
            }
        }
    };
}
task! {
    TakeStep<Integrator>(&'a mut M, step: &'a Step<'a, R>, next: &'a mut States<R>, stats: &'a mut Stats)
        -> StepResult,
    method => method.step(step, next, stats)
}
task! {
    TakeJacobian<Integrator>(&'a mut M, drive: &'a SegmentDrive<R>, tau: R, y: &'a States<R>) -> (),
    method => method.take_jacobian(drive, tau, y)
}
task! {
    EstimateError<Adaptive>(&'a mut M, step: &'a Step<'a, R>, retried: Bits, stats: &'a mut Stats) -> R,
    method => method.error(step, retried, stats)
}
task! {
    Prepare<Adaptive>(&'a mut M, step: &'a Step<'a, R>, next: &'a States<R>, stats: &'a mut Stats) -> (),
    method => method.prepare(step, next, stats)
}
task! {
    Interpolate<Adaptive>(&'a M, y: &'a States<R>, next: &'a States<R>, x: R) -> States<R>,
    method => method.interpolate(y, next, x)
}

impl<R: Lanes, M: Integrator<R, SceneEquations<R>>> Integrator<R, SceneEquations<R>> for Called<M> {
    fn step(&mut self, step: &Step<'_, R>, next: &mut States<R>, stats: &mut Stats) -> StepResult {
        let Self { instructions, method, .. } = self;
        R::call(*instructions, TakeStep { method, step, next, stats })
    }

    fn restart(&mut self) {
        self.method.restart();
    }

    fn repeat(&mut self) {
        self.method.repeat();
    }

    fn renew(&mut self, runs: Runs<'_>) {
        (self.renew)(&mut self.method, runs);
    }

    fn keeps_jacobian(&self) -> bool {
        self.method.keeps_jacobian()
    }

    fn jacobian_is_reusable(&self) -> bool {
        self.method.jacobian_is_reusable()
    }

    fn take_jacobian(&mut self, drive: &SegmentDrive<R>, tau: R, y: &States<R>) {
        let Self { instructions, method, .. } = self;
        R::call(*instructions, TakeJacobian { method, drive, tau, y });
    }
}

impl<R: Lanes, M: Adaptive<R, SceneEquations<R>>> Adaptive<R, SceneEquations<R>> for Called<M> {
    fn error(&mut self, step: &Step<'_, R>, retried: Bits, stats: &mut Stats) -> R {
        let Self { instructions, method, .. } = self;
        R::call(*instructions, EstimateError { method, step, retried, stats })
    }

    fn accepted(&mut self, h: R) {
        self.method.accepted(h);
    }

    fn prepare(&mut self, step: &Step<'_, R>, next: &States<R>, stats: &mut Stats) {
        let Self { instructions, method, .. } = self;
        R::call(*instructions, Prepare { method, step, next, stats });
    }

    fn interpolate(&self, y: &States<R>, next: &States<R>, x: R) -> States<R> {
        R::call(self.instructions, Interpolate { method: &self.method, y, next, x })
    }
}
