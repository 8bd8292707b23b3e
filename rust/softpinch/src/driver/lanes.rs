//! The step loops of many runs in lanes, compiled for each SIMD level.

use std::marker::PhantomData;

use crate::driver::queue::{LaneQueue, LaneRuns};
use crate::error::Error;
use crate::formulation::scene_equations::{Choice, SceneEquations};
use crate::formulation::system::System;
use crate::method::dop853::Dop853InLanes;
use crate::method::rk4::Rk4InLanes;
use crate::method::rosenbrock::RosenbrockInLanes;
use crate::method::table::Method;
use crate::method::traits::{AdaptiveInLanes, InLanes, Runs};
use crate::model::scene::Scene;
use crate::number::lanes::Lanes;
use crate::number::simd::dispatch::{LaneKernel, dispatch_lanes};
use crate::number::simd::level::Instructions;
use crate::stepping::adaptive::AdaptiveSteps;
use crate::stepping::equal::EqualSteps;
use crate::stepping::grid::Grid;
use crate::stepping::options::{Options, Steps};
use crate::stepping::queue::{Builder, LaneParameters};

/// Makes the equations and the method for the runs in lanes. `I` selects the method.
struct LaneBuilder<'a, I> {
    instructions: Instructions,
    choice: Choice,
    options: &'a Options,
    method: PhantomData<I>,
}

impl<I> LaneBuilder<'_, I> {
    /// The runs for which they are made.
    fn runs<'b>(&'b self, parameters: &'b LaneParameters<'b>) -> Runs<'b> {
        let Self { instructions, choice, options, .. } = *self;
        Runs { instructions, choice, parameters, gains: &options.stabilization }
    }
}

impl<R: Lanes, I: InLanes> Builder<SceneEquations<R>, I::Method<R>> for LaneBuilder<'_, I> {
    #[inline(always)]
    fn build(&mut self, parameters: &LaneParameters<'_>) -> (SceneEquations<R>, I::Method<R>) {
        let runs = self.runs(parameters);
        let system = runs.system::<R>();
        let method = I::new(runs, system.size());
        (system, method)
    }

    #[inline(always)]
    fn renew(
        &mut self,
        parameters: &LaneParameters<'_>,
        system: &mut SceneEquations<R>,
        method: &mut I::Method<R>,
    ) {
        let runs = self.runs(parameters);
        *system = runs.system();
        I::renew(method, runs);
    }
}

/// Finds the times of the steps of a run, from its number and its scene.
pub type GridOf<'a> = dyn Fn(usize, &Scene) -> Result<Grid, Error> + 'a;

/// The runs of one thread in equal steps, compiled for each SIMD level. `I` selects the method.
pub struct EqualKernel<'q, 'a, I> {
    runs: &'q mut dyn LaneRuns<'a>,
    grid: &'q GridOf<'q>,
    options: &'a Options,
    choice: Choice,
    method: PhantomData<I>,
}

impl<'q, 'a, I> EqualKernel<'q, 'a, I> {
    /// A kernel for these runs, whose equations are those of `choice`.
    pub fn new(
        runs: &'q mut dyn LaneRuns<'a>,
        grid: &'q GridOf<'q>,
        options: &'a Options,
        choice: Choice,
    ) -> Self {
        Self { runs, grid, options, choice, method: PhantomData }
    }
}

impl<I: InLanes> LaneKernel for EqualKernel<'_, '_, I> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { runs, grid, options, choice, .. } = self;
        let builder = LaneBuilder::<I> { instructions, choice, options, method: PhantomData };
        let steps = EqualSteps { instructions, options, queue: LaneQueue(runs), grid, builder };
        steps.run::<R, _, _>().map(|_| ())
    }
}

/// The runs of one thread in adaptive steps, compiled for each SIMD level. `I` selects the method.
pub struct AdaptiveKernel<'q, 'a, I> {
    runs: &'q mut dyn LaneRuns<'a>,
    options: &'a Options,
    choice: Choice,
    tolerance: f64,
    method: PhantomData<I>,
}

impl<'q, 'a, I> AdaptiveKernel<'q, 'a, I> {
    /// A kernel with steps whose errors are below `tolerance`.
    pub fn new(runs: &'q mut dyn LaneRuns<'a>, options: &'a Options, choice: Choice, tolerance: f64) -> Self {
        Self { runs, options, choice, tolerance, method: PhantomData }
    }
}

impl<I: AdaptiveInLanes> LaneKernel for AdaptiveKernel<'_, '_, I> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { runs, options, choice, tolerance, .. } = self;
        let builder = LaneBuilder::<I> { instructions, choice, options, method: PhantomData };
        let steps = AdaptiveSteps { instructions, options, tolerance, queue: LaneQueue(runs), builder };
        steps.run::<R, _, _>().map(|_| ())
    }
}

/// Computes runs in lanes, with the options of all of them. Returns `None` if the steps of the method have no
/// lanes. `grid` is for equal steps.
pub(super) fn in_lanes<'a>(
    runs: &mut dyn LaneRuns<'a>,
    grid: &GridOf<'_>,
    options: &'a Options,
    choice: Choice,
) -> Result<Option<()>, Error> {
    let level = options.simd;
    // Every method is named, so that none runs outside of lanes because it was forgotten.
    match (options.steps, options.method) {
        (_, Method::ImplicitMidpoint | Method::Radau5) | (Steps::Free { .. }, Method::Rk4) => {
            return Ok(None);
        }
        (Steps::Fixed(_), Method::Rk4) => {
            dispatch_lanes(level, EqualKernel::<Rk4InLanes>::new(runs, grid, options, choice))?
        }
        (Steps::Fixed(_), Method::Dop853) => {
            dispatch_lanes(level, EqualKernel::<Dop853InLanes>::new(runs, grid, options, choice))?
        }
        (Steps::Fixed(_), Method::Rosenbrock) => {
            dispatch_lanes(level, EqualKernel::<RosenbrockInLanes>::new(runs, grid, options, choice))?
        }
        (Steps::Free { tolerance }, Method::Dop853) => {
            dispatch_lanes(level, AdaptiveKernel::<Dop853InLanes>::new(runs, options, choice, tolerance))?
        }
        (Steps::Free { tolerance }, Method::Rosenbrock) => {
            dispatch_lanes(level, AdaptiveKernel::<RosenbrockInLanes>::new(runs, options, choice, tolerance))?
        }
    }
    .map(Some)
}
