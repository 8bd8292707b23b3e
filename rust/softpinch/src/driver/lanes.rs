//! The step loops of an ensemble, compiled for each SIMD level.

use std::marker::PhantomData;

use crate::driver::queue::{Row, Shared, Worker};
use crate::error::Error;
use crate::formulation::chosen::{Choice, Chosen};
use crate::formulation::system::System;
use crate::method::traits::{AdaptiveInLanes, InLanes, Runs};
use crate::model::scene::Scene;
use crate::number::lanes::Lanes;
use crate::number::simd::dispatch::LaneKernel;
use crate::number::simd::level::Instructions;
use crate::stepping::adaptive::AdaptiveSteps;
use crate::stepping::equal::EqualSteps;
use crate::stepping::grid::Grid;
use crate::stepping::options::Options;
use crate::stepping::queue::{Equip, LaneParameters};

/// Makes the equations and the method for the runs in lanes. `I` selects the method.
struct Equipment<'a, I> {
    instructions: Instructions,
    choice: Choice,
    options: &'a Options,
    method: PhantomData<I>,
}

impl<I> Equipment<'_, I> {
    /// The runs for which they are made.
    fn runs<'b>(&'b self, parameters: &'b LaneParameters<'b>) -> Runs<'b> {
        let Self { instructions, choice, options, .. } = *self;
        Runs { instructions, choice, parameters, gains: &options.stabilization }
    }
}

impl<R: Lanes, I: InLanes> Equip<Chosen<R>, I::Method<R>> for Equipment<'_, I> {
    #[inline(always)]
    fn equip(&mut self, parameters: &LaneParameters<'_>) -> (Chosen<R>, I::Method<R>) {
        let runs = self.runs(parameters);
        let system = runs.system::<R>();
        let method = I::new(runs, system.size());
        (system, method)
    }

    #[inline(always)]
    fn renew(&mut self, parameters: &LaneParameters<'_>, system: &mut Chosen<R>, method: &mut I::Method<R>) {
        let runs = self.runs(parameters);
        *system = runs.system();
        I::renew(method, runs);
    }
}

/// The runs of one thread in equal steps, compiled for each SIMD level. `I` selects the method.
pub struct EqualKernel<'a, I> {
    shared: &'a Shared<'a>,
    choice: Choice,
    dt: f64,
    method: PhantomData<I>,
}

impl<'a, I> EqualKernel<'a, I> {
    /// A kernel with steps of at most `dt`.
    pub fn new(shared: &'a Shared<'a>, choice: Choice, dt: f64) -> Self {
        Self { shared, choice, dt, method: PhantomData }
    }
}

impl<I: InLanes> LaneKernel for EqualKernel<'_, I> {
    type Output = Result<Vec<Row>, Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { shared, choice, dt, .. } = self;
        let options = shared.options;
        let equip = Equipment::<I> { instructions, choice, options, method: PhantomData };
        let grid =
            |scene: &Scene| Grid::new(&scene.inputs, &scene.initial, scene.duration, dt, options.refine);
        let queue = Worker { shared, rows: Vec::new() };
        let steps = EqualSteps { instructions, options, queue, grid, equip };
        steps.run::<R, _, _>().map(|worker| worker.rows)
    }
}

/// The runs of one thread in adaptive steps, compiled for each SIMD level. `I` selects the method.
pub struct AdaptiveKernel<'a, I> {
    shared: &'a Shared<'a>,
    choice: Choice,
    tolerance: f64,
    method: PhantomData<I>,
}

impl<'a, I> AdaptiveKernel<'a, I> {
    /// A kernel with steps whose errors are below `tolerance`.
    pub fn new(shared: &'a Shared<'a>, choice: Choice, tolerance: f64) -> Self {
        Self { shared, choice, tolerance, method: PhantomData }
    }
}

impl<I: AdaptiveInLanes> LaneKernel for AdaptiveKernel<'_, I> {
    type Output = Result<Vec<Row>, Error>;

    #[inline(always)]
    fn run<R: Lanes>(self, instructions: Instructions) -> Self::Output {
        let Self { shared, choice, tolerance, .. } = self;
        let options = shared.options;
        let equip = Equipment::<I> { instructions, choice, options, method: PhantomData };
        let queue = Worker { shared, rows: Vec::new() };
        let steps = AdaptiveSteps { instructions, options, tolerance, queue, equip };
        steps.run::<R, _, _>().map(|worker| worker.rows)
    }
}
