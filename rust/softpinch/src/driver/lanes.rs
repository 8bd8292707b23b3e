//! The step loops of many runs in lanes, compiled for each SIMD level.

use crate::error::Error;
use crate::formulation::scene_equations::Choice;
use crate::method::called::AnyMethod;
use crate::method::entry::LaneMethod;
use crate::method::rk4::Rk4;
use crate::method::table::adaptive_in_lanes;
use crate::method::traits::Runs;
use crate::model::energy::Energies;
use crate::number::lanes::Lanes;
use crate::number::simd::dispatch::{LaneKernel, dispatch_four_lanes, dispatch_lanes};
use crate::number::simd::level::Instructions;
use crate::stepping::adaptive::AdaptiveSteps;
use crate::stepping::batch::LoopSetup;
use crate::stepping::equal::EqualSteps;
use crate::stepping::grid::GridOf;
use crate::stepping::options::{Options, Steps};
use crate::stepping::queue::{Finished, RunQueue, Taken};

/// The source and the destination of runs in lanes, whose step loops are compiled once for all of them.
pub(super) struct LaneQueue<'q, 'a> {
    /// Gives the next run, if there is one.
    pub(super) take: &'q mut dyn FnMut() -> Result<Option<Taken<'a>>, Error>,
    /// Says whether the loop should stop its runs.
    pub(super) stops: &'q dyn Fn() -> bool,
    /// Takes a run that has ended.
    pub(super) finish: &'q mut dyn FnMut(Finished),
}

impl<'a> RunQueue<'a> for LaneQueue<'_, 'a> {
    fn take(&mut self) -> Result<Option<Taken<'a>>, Error> {
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
pub(super) struct RunsInLanes<'q, 'a> {
    pub(super) queue: LaneQueue<'q, 'a>,
    /// Finds the times of equal steps.
    pub(super) grid: &'q GridOf<'q>,
    /// The options and the equations of all runs.
    pub(super) options: &'a Options,
    pub(super) choice: Choice,
    /// Whether the parts of all runs are the paper's.
    pub(super) papers: bool,
}

impl RunsInLanes<'_, '_> {
    /// Computes the runs. Returns `None` if the steps of the method have no lanes, which its entry says.
    pub(super) fn compute(self) -> Result<Option<()>, Error> {
        if self.papers {
            dispatch_lanes(self.options.simd, self)?
        } else {
            // Vectors of eight lanes have code for the paper's parts only.
            dispatch_four_lanes(self.options.simd, self)?
        }
    }
}

/// The step loop, compiled for each SIMD level.
impl LaneKernel for RunsInLanes<'_, '_> {
    type Output = Result<Option<()>, Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { queue, grid, options, choice, .. } = self;
        let Some(method) = options.method.entry().lanes else { return Ok(None) };
        let setup = LoopSetup { instructions, options, choice, queue };
        let computed = match (options.steps, method) {
            // A step of RK4 is so short that a call would take 3 % of it.
            (Steps::Fixed(_), LaneMethod::Rk4) => {
                let method = &mut Rk4::default();
                let build = move |runs: Runs<'_>| (runs.system::<R>(), method);
                R::call(instructions, EqualSteps { setup, grid, build })
            }
            (Steps::Fixed(_), LaneMethod::Adaptive(method)) => {
                let build = |runs: Runs<'_>| {
                    let system = runs.system();
                    let method: AnyMethod<R> = adaptive_in_lanes(method, runs, &system);
                    (system, method)
                };
                R::call(instructions, EqualSteps { setup, grid, build })
            }
            (Steps::Free { tolerance }, LaneMethod::Adaptive(method)) => {
                let build = |runs: Runs<'_>, system: &_| adaptive_in_lanes::<R>(method, runs, system);
                R::call(instructions, AdaptiveSteps { setup, tolerance, build })
            }
            (Steps::Free { .. }, LaneMethod::Rk4) => return Ok(None),
        };
        computed.map(|_| Some(()))
    }
}
