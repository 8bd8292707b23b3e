//! The step loops of many runs in lanes, compiled for each SIMD level.

use crate::driver::queue::{LaneQueue, LaneRuns};
use crate::error::Error;
use crate::formulation::scene_equations::Choice;
use crate::method::called::AnyMethod;
use crate::method::entry::{AdaptiveLaneMethod, LaneMethod};
use crate::method::rk4::Rk4;
use crate::method::table::adaptive_in_lanes;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::simd::dispatch::{LaneKernel, dispatch_lanes};
use crate::number::simd::level::Instructions;
use crate::stepping::adaptive::AdaptiveSteps;
use crate::stepping::equal::EqualSteps;
use crate::stepping::grid::GridOf;
use crate::stepping::options::{Options, Steps};

/// The runs of one thread in equal steps, compiled for each SIMD level.
pub struct EqualKernel<'q, 'a> {
    /// The source and the destination of the runs.
    pub runs: &'q mut dyn LaneRuns<'a>,
    /// Finds the times of their steps.
    pub grid: &'q GridOf<'q>,
    /// The options of all runs.
    pub options: &'a Options,
    /// The equations of all runs.
    pub choice: Choice,
    /// The method that takes the steps.
    pub method: LaneMethod,
}

impl LaneKernel for EqualKernel<'_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { runs, grid, options, choice, method } = self;
        let steps = EqualSteps { instructions, options, choice, queue: LaneQueue(runs), grid };
        match method {
            LaneMethod::Rk4 => R::call(instructions, Rk4EqualSteps(steps)),
            LaneMethod::Adaptive(method) => R::call(instructions, CalledEqualSteps(steps, method)),
        }
    }
}

/// Equal steps of RK4, whose step is so short that a call would take 3 % of it.
struct Rk4EqualSteps<'g, 'q, 'a>(EqualSteps<'g, 'a, LaneQueue<'q, 'a>>);

impl<R: Lanes> LaneTask<R> for Rk4EqualSteps<'_, '_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        self.0.run(|runs| (runs.system::<R>(), Rk4::default())).map(|_| ())
    }
}

/// Equal steps of any other method.
struct CalledEqualSteps<'g, 'q, 'a>(EqualSteps<'g, 'a, LaneQueue<'q, 'a>>, AdaptiveLaneMethod);

impl<R: Lanes> LaneTask<R> for CalledEqualSteps<'_, '_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self(steps, method) = self;
        let done = steps.run(|runs| {
            let system = runs.system();
            let method: AnyMethod<R> = adaptive_in_lanes(method, runs, &system);
            (system, method)
        });
        done.map(|_| ())
    }
}

/// The runs of one thread in adaptive steps, compiled for each SIMD level.
pub struct AdaptiveKernel<'q, 'a> {
    /// The source and the destination of the runs.
    pub runs: &'q mut dyn LaneRuns<'a>,
    /// The options of all runs.
    pub options: &'a Options,
    /// The equations of all runs.
    pub choice: Choice,
    /// The error that is allowed in a step, as a share of each state's magnitude.
    pub tolerance: f64,
    /// The method that takes the steps.
    pub method: AdaptiveLaneMethod,
}

impl LaneKernel for AdaptiveKernel<'_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { runs, options, choice, tolerance, method } = self;
        let steps = AdaptiveSteps { instructions, options, choice, tolerance, queue: LaneQueue(runs) };
        steps.run::<R>(|runs, system| adaptive_in_lanes(method, runs, system)).map(|_| ())
    }
}

/// Computes runs in lanes, with the options of all of them. Returns `None` if the steps of the method have no
/// lanes, which its entry says. `grid` is for equal steps.
pub(super) fn compute_in_lanes<'a>(
    runs: &mut dyn LaneRuns<'a>,
    grid: &GridOf<'_>,
    options: &'a Options,
    choice: Choice,
) -> Result<Option<()>, Error> {
    let level = options.simd;
    let Some(method) = options.method.entry().lanes else { return Ok(None) };
    match (options.steps, method) {
        (Steps::Fixed(_), method) => {
            dispatch_lanes(level, EqualKernel { runs, grid, options, choice, method })?
        }
        (Steps::Free { tolerance }, LaneMethod::Adaptive(method)) => {
            dispatch_lanes(level, AdaptiveKernel { runs, options, choice, tolerance, method })?
        }
        (Steps::Free { .. }, LaneMethod::Rk4) => return Ok(None),
    }
    .map(Some)
}
