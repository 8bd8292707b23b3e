//! The methods as step loops use them.

use crate::formulation::{MAX_COMPONENTS, Runs, SceneEquations, Size, States, System};
use crate::model::SegmentDrive;
use crate::number::{Bits, Lanes, inlined};

/// An iteration that did not converge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unsolved {
    pub iterations: u32,
    /// The last correction, as a share of the states' magnitudes; not finite if a number overflowed.
    pub correction: f64,
}

pub type StepResult = Result<(), Unsolved>;

/// The largest of the states' `values`, each times its weight; NaN if any is NaN.
#[inline(always)]
pub fn largest<R: Lanes>(size: Size, values: &States<R>, weights: &States<R>) -> R {
    let mut largest = R::zero();
    for (value, &weight) in values.iter().zip(weights).take(size.states) {
        let own = value.abs() * weight;
        largest = R::select(largest.less(own) | !own.at_most(own), own, largest);
    }
    largest
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stats {
    pub steps: u64,
    /// Attempts of a step of free length whose error was too large, or whose iteration did not converge.
    pub rejected: u64,
    pub evaluations: u64,
    /// Evaluations of the Jacobian of the right-hand side.
    pub jacobians: u64,
    /// Decompositions of matrices that have one row for each degree of freedom. A complex decomposition counts as one.
    pub factorisations: u64,
    pub iterations: u64,
    pub segments: u64,
}

impl Stats {
    /// Adds the work of inner steps, which are not counted as steps.
    pub fn add(&mut self, other: &Self) {
        self.evaluations += other.evaluations;
        self.jacobians += other.jacobians;
        self.factorisations += other.factorisations;
        self.iterations += other.iterations;
    }

    /// The counts by their public names.
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

/// The error that is allowed in a step of free length.
#[derive(Debug, Clone, Copy)]
pub struct Allowed<R = f64> {
    /// The allowed error as a share of each state's magnitude.
    pub tolerance: f64,
    /// One over the allowed error of each state.
    pub weights: States<R>,
}

/// The start and the length of a step, and the equations that it solves.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a, R = f64, S = SceneEquations<R>> {
    pub system: &'a S,
    pub drive: &'a SegmentDrive<R>,
    /// Time since the segment's start.
    pub tau: R,
    pub h: R,
    pub y: &'a States<R>,
    pub rate: &'a States<R>,
    pub allowed: Option<&'a Allowed<R>>,
}

impl<R: Lanes, S> Step<'_, R, S> {
    /// One over the allowed error of each state; zero if the length is not free.
    #[inline(always)]
    pub fn weights(&self) -> States<R> {
        self.allowed.map_or([R::zero(); MAX_COMPONENTS], |allowed| allowed.weights)
    }
}

/// A one-step method for the runs in all lanes, with the data that it keeps between steps.
pub trait Integrator<R: Lanes, S: System<R>> {
    /// Takes a step and writes the state at its end into `next`. `stats` counts the evaluations, but not the
    /// one at the start of the step. A method that solves no equations cannot fail.
    fn step(&mut self, step: &Step<'_, R, S>, next: &mut States<R>, stats: &mut Stats) -> StepResult;

    inlined! {
        /// Forgets the data of the last step, because there is a breakpoint before the next one.
        restart(&mut self) -> () = ();
        /// Prepares another step from the start of the last one: its Jacobian is kept, the rest is forgotten.
        repeat(&mut self) -> () = self.restart();
        /// Renews the data that depend on the parameters of the runs, after some runs have changed.
        renew(&mut self, _runs: Runs<'_>) -> () = ();
        /// Whether steps keep a Jacobian for the steps that follow.
        keeps_jacobian(&self) -> bool = false;
        /// Whether the kept Jacobian is used in the next step too.
        jacobian_is_reusable(&self) -> bool = false;
        /// Takes the Jacobian at time `tau` of the segment and state `y`, as the run had done that is resumed.
        take_jacobian(&mut self, _drive: &SegmentDrive<R>, _tau: R, _y: &States<R>) -> () = ();
    }
}

/// A method that can choose the length of its steps.
pub trait Adaptive<R: Lanes, S: System<R>>: Integrator<R, S> {
    /// The error of the step just taken, in units of the allowed error. `retried` is the set of lanes in
    /// which the attempt before was rejected.
    fn error(&mut self, step: &Step<'_, R, S>, retried: Bits, stats: &mut Stats) -> R;

    inlined! {
        /// Notes that the step just taken, of length `h`, is accepted.
        accepted(&mut self, _h: R) -> () = ();
    }

    /// Computes the data that dense output needs besides the step itself.
    fn prepare(&mut self, _step: &Step<'_, R, S>, _next: &States<R>, _stats: &mut Stats) {}

    /// The state at the share `x` of the step just taken, from `y` to `next`.
    fn interpolate(&self, y: &States<R>, next: &States<R>, x: R) -> States<R>;
}
