//! Newton's iteration as the implicit methods share it: when it has converged, and how long Jacobian and factors serve.

use crate::formulation::equations::{ROOM, States};
use crate::formulation::system::{Linear, Moved, Size, System};
use crate::method::linearize::Linearization;
use crate::method::traits::{Integrator, Stats, Step, Unsolved, largest};
use crate::model::drive::{Drive, SegmentDrive};

/// Most iterations of a step whose length is free: a shorter one costs less than many. And of one whose length is not.
const MOST_FREE: u32 = 15;
const MOST_FIXED: u32 = 50;
/// With fixed steps an iteration ends where what is left is below this share of the states' sizes.
const FIXED: f64 = 1e-17;
/// An iteration that stops shrinking, or does so too slowly, has come to round-off where its corrections are below this share.
const STALLED: f64 = 1e-11;
/// A Jacobian serves the next step too while each correction is at most this share of the one before.
const SERVES: f64 = 1e-3;

/// One iteration, judged by the sizes of its corrections.
#[derive(Debug, Clone, Copy)]
pub struct Iteration {
    tolerance: f64,
    stalled: f64,
    unit: f64,
    most: u32,
    last: f64,
    count: u32,
    /// The largest share that a correction was of the one before it.
    pub rate: f64,
}

impl Iteration {
    /// For a step.
    #[must_use]
    #[inline(always)]
    pub fn new(step: &Step<'_>) -> Self {
        let (tolerance, stalled, unit, most) = match step.allowed {
            None => (FIXED, STALLED, 1.0, MOST_FIXED),
            Some(allowed) => {
                // In allowed errors: a small share of one, but no less than round-off.
                let unit = allowed.tolerance;
                let tolerance = f64::max(10.0 * f64::EPSILON / unit, f64::min(0.03, unit.sqrt()));
                (tolerance, f64::max(tolerance, 0.03), unit, MOST_FREE)
            }
        };
        Self { tolerance, stalled, unit, most, last: f64::INFINITY, count: 0, rate: 0.0 }
    }

    /// Whether a correction of this size was the last one; or that the iteration does not converge.
    #[inline(always)]
    pub fn judge(&mut self, size: f64) -> Result<bool, Unsolved> {
        self.count += 1;
        let failed = Unsolved { iterations: self.count, correction: size * self.unit };
        if !size.is_finite() {
            return Err(failed);
        }
        let rate = if self.count == 1 { 0.0 } else { size / self.last };
        if rate >= 1.0 || self.count == self.most {
            return if size <= self.stalled { Ok(true) } else { Err(failed) };
        }
        // What is next to round-off says nothing of the rate.
        if size > self.tolerance {
            self.rate = self.rate.max(rate);
        }
        self.last = size;
        // The first correction says nothing of the rate: only where it is next to nothing was it the last one.
        let left = if self.count == 1 { 1e3 * size } else { rate / (1.0 - rate) * size };
        Ok(left <= self.tolerance)
    }
}

/// A step's equations as an iteration needs them.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a, S, F> {
    /// The system.
    pub system: &'a S,
    drive: &'a SegmentDrive,
    /// Where the step begins.
    pub step: &'a Step<'a>,
    /// One over what a correction of each state is measured in.
    weights: States<f64>,
    /// The linearisation that serves.
    pub linearization: &'a Linearization,
    /// Its factors for the step's length.
    pub factors: &'a F,
}

impl<S: System<f64>, F> Problem<'_, S, F> {
    /// The rates at a share `c` of the step, the state `z` away from that at its start.
    #[inline(always)]
    pub fn rates(&self, c: f64, z: &States<f64>, stats: &mut Stats) -> States<f64> {
        stats.evaluations += 1;
        let mut rate = [0.0; ROOM];
        let at = Moved { from: self.step.y, by: 1.0, along: z };
        self.system.rates(&self.drive.at(c.mul_add(self.step.h, self.step.tau)), at, &mut rate);
        rate
    }

    /// The largest of the corrections, each against the size of its state; NaN where one is.
    #[must_use]
    #[inline(always)]
    pub fn size(&self, correction: &States<f64>) -> f64 {
        largest(self.system.size(), correction, &self.weights)
    }

    /// Whether the rates at the step's start foretell its change: not where a stiff part is only on its way to rest.
    #[must_use]
    #[inline(always)]
    pub fn is_smooth(&self) -> bool {
        const SMALL: f64 = 0.1;
        let size = self.size(self.step.rate) * self.step.h;
        size * self.step.allowed.map_or(1.0, |allowed| allowed.tolerance) <= SMALL
    }
}

/// A method whose stages are solved for.
pub trait Scheme<S: System<f64>> {
    /// Its decompositions.
    type Factors: Copy;
    /// How many these are.
    const FACTORISATIONS: u64;

    /// Decomposes what a step of length `h` needs.
    fn factor(linearization: &Linearization, h: f64) -> Self::Factors;

    /// Iterates to the stages, and gives the state at the step's end with the rate of convergence.
    fn solve(
        &mut self,
        problem: &Problem<'_, S, Self::Factors>,
        stats: &mut Stats,
    ) -> Result<(States<f64>, f64), Unsolved>;

    /// Forgets what it kept of the step before.
    #[inline(always)]
    fn restart(&mut self) {}
}

/// A scheme with the Jacobian and factors that it keeps while they serve.
#[derive(Debug, Clone, Copy)]
pub struct Newton<M, F, T> {
    /// How many numbers a state has, and their usual sizes.
    size: Size,
    sizes: States<f64>,
    /// The system in dual numbers.
    tangent: T,
    /// The method.
    pub scheme: M,
    linearization: Linearization,
    serves: bool,
    /// With the length of step that they are for.
    factors: Option<(f64, F)>,
}

impl<M, F: Copy, T> Newton<M, F, T> {
    /// For a system, given in dual numbers, whose states have the `sizes`.
    #[inline(always)]
    pub fn new(size: Size, tangent: T, sizes: States<f64>, scheme: M) -> Self {
        let linearization = Linearization::new(size);
        Self { size, sizes, tangent, scheme, linearization, serves: false, factors: None }
    }

    /// Linearisation and factors of the last step.
    #[inline(always)]
    pub fn last(&self) -> Option<(&Linearization, &F)> {
        self.factors.as_ref().map(|(_, factors)| (&self.linearization, factors))
    }

    #[inline(always)]
    fn weights(&self, step: &Step<'_>) -> States<f64> {
        if let Some(allowed) = step.allowed {
            return allowed.weights;
        }
        let mut weights = [0.0; ROOM];
        self.size.each(|n| weights[n] = 1.0 / step.y[n].abs().max(self.sizes[n]));
        weights
    }
}

impl<M, F, T, S> Integrator<f64, S> for Newton<M, F, T>
where
    M: Scheme<S, Factors = F>,
    F: Copy,
    T: Linear<f64>,
    S: System<f64>,
{
    type Failure = Unsolved;

    #[inline(always)]
    fn step(
        &mut self,
        system: &S,
        drive: &SegmentDrive,
        step: &Step<'_>,
        next: &mut States<f64>,
        stats: &mut Stats,
    ) -> Result<(), Unsolved> {
        let weights = self.weights(step);
        loop {
            let fresh = !self.serves;
            if fresh {
                stats.jacobians += 1;
                Integrator::<f64, S>::keep(self, drive, step.tau, step.y);
            }
            let linearization = &self.linearization;
            let factors = match self.factors {
                Some((h, factors)) if h == step.h => factors,
                _ => {
                    stats.factorisations += M::FACTORISATIONS;
                    M::factor(linearization, step.h)
                }
            };
            self.factors = Some((step.h, factors));
            let problem = Problem { system, drive, step, weights, linearization, factors: &factors };
            match self.scheme.solve(&problem, stats) {
                Ok((end, rate)) => {
                    self.serves = rate <= SERVES;
                    *next = end;
                    return Ok(());
                }
                // A Jacobian of the step itself may do what an older one did not.
                Err(unsolved) => {
                    self.serves = false;
                    if fresh {
                        return Err(unsolved);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn keeps(&self) -> bool {
        true
    }

    #[inline(always)]
    fn serves(&self) -> bool {
        self.serves
    }

    #[inline(always)]
    fn keep(&mut self, drive: &SegmentDrive, tau: f64, y: &States<f64>) {
        self.linearization.take(&self.tangent, drive, tau, y);
        self.factors = None;
        self.serves = true;
    }

    #[inline(always)]
    fn restart(&mut self) {
        self.serves = false;
        self.scheme.restart();
    }
}
