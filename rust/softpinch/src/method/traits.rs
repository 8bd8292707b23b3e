//! What step loops ask of methods.

// Several small arrays run in step: an index says so best.
#![allow(clippy::needless_range_loop)]

use std::convert::Infallible;

use crate::formulation::chosen::{Choice, Chosen};
use crate::formulation::equations::{ROOM, States};
use crate::formulation::system::{Size, System};
use crate::formulation::tangent::Tangent;
use crate::model::drive::SegmentDrive;
use crate::model::parameters::{Parameters, Stabilization};
use crate::model::source::Duals;
use crate::number::lanes::{Bits, Lanes, MOST};
use crate::number::simd::level::Instructions;

/// An iteration that did not converge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unsolved {
    /// Iterations of the last attempt.
    pub iterations: u32,
    /// Its last correction, as a share of the states' sizes; not finite where a number overflowed.
    pub correction: f64,
}

/// Where nothing is solved, nothing fails.
impl From<Infallible> for Unsolved {
    fn from(never: Infallible) -> Self {
        match never {}
    }
}

/// The largest of the states' `values`, each times its weight; NaN where one is.
#[inline(always)]
#[must_use]
pub fn largest<R: Lanes>(size: Size, values: &States<R>, weights: &States<R>) -> R {
    let mut largest = R::zero();
    for (value, &weight) in values.iter().zip(weights).take(size.states) {
        let own = value.abs() * weight;
        largest = R::select(largest.less(own) | !own.at_most(own), own, largest);
    }
    largest
}

/// Counted work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stats {
    /// Steps taken.
    pub steps: u64,
    /// Attempts whose error was too large, or whose iteration did not converge, where the step is free.
    pub rejected: u64,
    /// Evaluations of the right-hand side.
    pub evaluations: u64,
    /// Evaluations of its Jacobian.
    pub jacobians: u64,
    /// Decompositions, each as large as there are degrees of freedom; a complex one counts as one.
    pub factorisations: u64,
    /// Newton's iterations.
    pub iterations: u64,
    /// Stretches between breakpoints.
    pub segments: u64,
}

impl Stats {
    /// The counts by their public names.
    #[must_use]
    pub fn named(&self) -> [(&'static str, u64); 7] {
        [
            ("steps", self.steps),
            ("rejected", self.rejected),
            ("evaluations", self.evaluations),
            ("jacobians", self.jacobians),
            ("factorisations", self.factorisations),
            ("iterations", self.iterations),
            ("segments", self.segments),
        ]
    }
}

/// The error that a step of free length may have.
#[derive(Debug, Clone, Copy)]
pub struct Allowed<R = f64> {
    /// As a share of each state's size.
    pub tolerance: f64,
    /// One over what is allowed of each state.
    pub weights: States<R>,
}

/// Where a step begins, and how long it is.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a, R = f64> {
    /// Time since the segment's start.
    pub tau: R,
    /// Its length.
    pub h: R,
    /// The state there.
    pub y: &'a States<R>,
    /// The state's derivative there.
    pub rate: &'a States<R>,
    /// What its error may be, where its length is free.
    pub allowed: Option<&'a Allowed<R>>,
}

impl<R: Lanes> Step<'_, R> {
    /// One over what is allowed of each state; zero where the length is not free.
    #[must_use]
    #[inline(always)]
    pub fn weights(&self) -> States<R> {
        self.allowed.map_or([R::zero(); ROOM], |allowed| allowed.weights)
    }
}

/// A one-step method for the runs in all lanes, with what it keeps between their steps.
pub trait Integrator<R: Lanes, S: System<R>> {
    /// How a step may fail: [`std::convert::Infallible`] where no equations are solved.
    type Failure: Into<Unsolved>;

    /// The state at the end of a step goes into `next`. Evaluations beside the one at its start are counted in `stats`.
    fn step(
        &mut self,
        system: &S,
        drive: &SegmentDrive<R>,
        step: &Step<'_, R>,
        next: &mut States<R>,
        stats: &mut Stats,
    ) -> Result<(), Self::Failure>;

    /// Forgets what it kept: a breakpoint lies between the last step and the next.
    #[inline(always)]
    fn restart(&mut self) {}

    /// Whether steps keep a Jacobian for those that follow.
    #[inline(always)]
    fn keeps(&self) -> bool {
        false
    }

    /// Whether the kept Jacobian serves the next step too.
    #[inline(always)]
    fn serves(&self) -> bool {
        false
    }

    /// Takes the Jacobian at time `tau` of the segment and state `y`, as a run did from which this one goes on.
    #[inline(always)]
    fn keep(&mut self, drive: &SegmentDrive<R>, tau: R, y: &States<R>) {
        let _ = (drive, tau, y);
    }
}

/// A method that can choose its steps.
pub trait Adaptive<R: Lanes, S: System<R>>: Integrator<R, S> {
    /// The error estimate grows with this power of the step.
    const ERROR_ORDER: f64;
    /// Growth by less is not worth a change of the step.
    const WORTH: f64 = 1.0;

    /// The error of the step just taken, in allowed errors; `retried` in the lanes where it follows a rejected one.
    fn error(
        &mut self,
        system: &S,
        drive: &SegmentDrive<R>,
        step: &Step<'_, R>,
        retried: Bits,
        stats: &mut Stats,
    ) -> R;

    /// Notes that the step just taken, of length `h`, stands.
    #[inline(always)]
    fn accepted(&mut self, h: R) {
        let _ = h;
    }

    /// Computes what dense output needs beside the step itself.
    fn prepare(
        &mut self,
        system: &S,
        drive: &SegmentDrive<R>,
        step: &Step<'_, R>,
        next: &States<R>,
        stats: &mut Stats,
    ) {
        let _ = (system, drive, step, next, stats);
    }

    /// The state after a share `x` of the step just taken, which ended at `next`.
    fn interpolate(&self, step: &Step<'_, R>, next: &States<R>, x: R) -> States<R>;
}

/// What a method is made for: the equations of the runs in all lanes.
#[derive(Clone, Copy)]
pub struct Runs<'a> {
    /// Instructions to use.
    pub instructions: Instructions,
    /// Which equations.
    pub choice: Choice,
    /// Their parameters.
    pub parameters: &'a [&'a Parameters; MOST],
    /// Gains of (19) and (20).
    pub gains: &'a Stabilization,
}

impl Runs<'_> {
    /// The equations.
    #[must_use]
    pub fn system<R: Lanes>(&self) -> Chosen<R> {
        let Self { instructions, choice, parameters, gains } = *self;
        Chosen::new(instructions, choice, parameters, gains)
    }

    /// The same equations in dual numbers of `W` directions.
    #[must_use]
    pub fn tangent<R: Lanes, const W: usize>(&self) -> Tangent<R, W> {
        let Self { instructions, choice, parameters, gains } = *self;
        Tangent::new(instructions, choice, &Duals(parameters), gains)
    }
}

/// Names a method whose steps have lanes.
pub trait InLanes {
    /// The method.
    type Method<R: Lanes>: Integrator<R, Chosen<R>>;

    /// Before the first step, for states of this size.
    fn new<R: Lanes>(runs: Runs<'_>, size: Size) -> Self::Method<R>;

    /// Makes what depends on the runs' parameters again, after some of them have changed.
    #[inline(always)]
    fn renew<R: Lanes>(method: &mut Self::Method<R>, runs: Runs<'_>) {
        let _ = (method, runs);
    }
}

/// Names one whose lanes choose their steps, too.
pub trait AdaptiveInLanes {
    /// The method.
    type Method<R: Lanes>: Adaptive<R, Chosen<R>>;

    /// See [`InLanes::new`].
    fn new<R: Lanes>(runs: Runs<'_>, size: Size) -> Self::Method<R>;

    /// See [`InLanes::renew`].
    #[inline(always)]
    fn renew<R: Lanes>(method: &mut Self::Method<R>, runs: Runs<'_>) {
        let _ = (method, runs);
    }
}

impl<I: AdaptiveInLanes> InLanes for I {
    type Method<R: Lanes> = <I as AdaptiveInLanes>::Method<R>;

    #[inline(always)]
    fn new<R: Lanes>(runs: Runs<'_>, size: Size) -> <I as AdaptiveInLanes>::Method<R> {
        <I as AdaptiveInLanes>::new(runs, size)
    }

    #[inline(always)]
    fn renew<R: Lanes>(method: &mut <I as AdaptiveInLanes>::Method<R>, runs: Runs<'_>) {
        <I as AdaptiveInLanes>::renew(method, runs);
    }
}
