//! The step loops of many runs in lanes, compiled for each SIMD level.

use crate::error::Result;
use crate::method::{AnyMethod, Method, Rk4, Runs, adaptive_in_lanes};
use crate::model::{Energies, Scene};
use crate::number::{Instructions, LaneKernel, Lanes, dispatch_four_lanes, dispatch_lanes};
use crate::stepping::{
    AdaptiveSteps, EqualSteps, Finished, GridOf, LoopSetup, Options, RunQueue, Steps, Taken,
};

/// The source and the destination of runs in lanes, whose step loops are compiled once for all of them.
pub struct LaneQueue<'q, 'a> {
    pub take: &'q mut dyn FnMut() -> Result<Option<Taken<'a>>>,
    pub stops: &'q dyn Fn() -> bool,
    pub finish: &'q mut dyn FnMut(Finished),
}

impl<'a> RunQueue<'a> for LaneQueue<'_, 'a> {
    fn take(&mut self) -> Result<Option<Taken<'a>>> {
        (self.take)()
    }

    fn stops(&mut self) -> bool {
        (self.stops)()
    }

    fn finish(&mut self, finished: Finished, _: impl FnOnce() -> Energies) {
        (self.finish)(finished);
    }
}

/// The runs of one thread in lanes.
pub struct RunsInLanes<'q, 'a> {
    pub queue: LaneQueue<'q, 'a>,
    pub grid: &'q GridOf<'q>,
    pub options: &'a Options,
    /// One of the scenes. All have the same kinds of parts, fingers and inputs.
    pub scene: &'q Scene,
}

impl RunsInLanes<'_, '_> {
    /// Computes the runs. Returns `None` if the steps of the method have no lanes.
    pub fn compute(self) -> Result<Option<()>> {
        // Vectors of eight lanes have code for the paper's parts only.
        let papers = self.scene.parameters.has_the_papers_parts();
        let level = self.options.simd;
        if papers { dispatch_lanes(level, self)? } else { dispatch_four_lanes(level, self)? }
    }
}

impl LaneKernel for RunsInLanes<'_, '_> {
    type Output = Result<Option<()>>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { queue, grid, options, scene } = self;
        let choice = options.choice(&scene.inputs);
        let setup = LoopSetup { instructions, options, choice, queue };
        let computed = match (options.steps, options.method) {
            // A step of RK4 is so short that a call would take 3 % of it.
            (Steps::Fixed(_), Method::Rk4) => {
                let method = &mut Rk4::default();
                let build = move |runs: Runs<'_>| (runs.system::<R>(), method);
                R::call(instructions, EqualSteps { setup, grid, build })
            }
            (Steps::Fixed(_), method @ (Method::Dop853 | Method::Rosenbrock)) => {
                let build = |runs: Runs<'_>| {
                    let system = runs.system();
                    let method: AnyMethod<R> = adaptive_in_lanes(method, runs, &system);
                    (system, method)
                };
                R::call(instructions, EqualSteps { setup, grid, build })
            }
            (Steps::Free { tolerance }, method @ (Method::Dop853 | Method::Rosenbrock)) => {
                let build = |runs: Runs<'_>, system: &_| adaptive_in_lanes::<R>(method, runs, system);
                R::call(instructions, AdaptiveSteps { setup, tolerance, build })
            }
            // Lanes of a method that iterates would wait for each other.
            (_, Method::ImplicitMidpoint | Method::Radau5) | (Steps::Free { .. }, Method::Rk4) => {
                return Ok(None);
            }
        };
        computed.map(|_| Some(()))
    }
}
