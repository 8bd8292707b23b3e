//! The step loops of many runs in lanes, compiled for each SIMD level.

use crate::error::Result;
use crate::method::{MakeInLanes, Method, Rk4, Runs};
use crate::model::Scene;
use crate::number::{LaneKernel, Lanes, call_four_lanes, dispatch_lanes};
use crate::stepping::{AdaptiveSteps, EqualSteps, GridOf, LoopSetup, Options, RunQueue, Steps};

/// The runs of one thread in lanes.
pub struct RunsInLanes<'a> {
    pub queue: RunQueue<'a>,
    pub grid: &'a GridOf<'a>,
    pub options: &'a Options,
    /// One of the scenes. All have the same kinds of parts, fingers and inputs.
    pub scene: &'a Scene,
}

impl RunsInLanes<'_> {
    /// Computes the runs. Returns `None` if the steps of the method have no lanes.
    pub fn compute(self) -> Result<Option<()>> {
        // Vectors of eight lanes have code for the paper's parts only.
        let papers = self.scene.parameters.has_the_papers_parts();
        let level = self.options.simd;
        if papers { dispatch_lanes(level, self)? } else { call_four_lanes(self) }
    }
}

impl LaneKernel for RunsInLanes<'_> {
    type Output = Result<Option<()>>;

    #[inline(always)]
    fn run<R: Lanes>(self) -> Self::Output {
        let Self { queue, grid, options, scene } = self;
        let choice = options.choice(&scene.inputs);
        let setup = LoopSetup { options, choice, queue };
        let method = options.method;
        let make = |runs: Runs<'_>, system: &_| R::outlined(MakeInLanes { method, runs, system });
        let build = |runs: Runs<'_>| runs.with_method(make);
        let computed = match (options.steps, options.method) {
            // A step of RK4 is so short that a call would take 3 % of it.
            (Steps::Fixed(_), Method::Rk4) => {
                let method = &mut Rk4::default();
                let build = move |runs: Runs<'_>| (runs.system::<R>(), method);
                R::outlined(EqualSteps { setup, grid, build })
            }
            (Steps::Fixed(_), Method::Dop853 | Method::Rosenbrock) => {
                R::outlined(EqualSteps { setup, grid, build })
            }
            (Steps::Free { tolerance }, Method::Dop853 | Method::Rosenbrock) => {
                R::outlined(AdaptiveSteps { setup, tolerance, build })
            }
            // Lanes of a method that iterates would wait for each other.
            (_, Method::ImplicitMidpoint | Method::Radau5) | (Steps::Free { .. }, Method::Rk4) => {
                return Ok(None);
            }
        };
        computed.map(Some)
    }
}
