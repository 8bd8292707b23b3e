//! Newton's iteration for the implicit methods: when it has converged, and how long a Jacobian and its
//! factors are used.

use crate::formulation::{
    Linear, MAX_COMPONENTS, Runs, SceneEquations, Size, StageState, States, System, Tangent,
};
use crate::method::{Allowed, Called, Integrator, Linearization, Stats, Step, StepResult, Unsolved, largest};
use crate::model::{Motion, SegmentDrive};
use crate::number::inlined;

/// The largest number of iterations in a step of free length, where a shorter step costs less than many
/// iterations, and in a step of fixed length.
const MOST_FREE: u32 = 15;
const MOST_FIXED: u32 = 50;
/// With fixed steps an iteration ends when the remaining error is below this share of the states' magnitudes.
const FIXED: f64 = 1e-17;
/// An iteration that stops shrinking, or that uses up its iterations, has reached round-off if its last
/// correction is below this share.
const STALLED: f64 = 1e-11;
/// A Jacobian is used for the next step too if each correction is at most this share of the correction before it.
const REUSE_RATE: f64 = 1e-3;

/// One iteration, judged by the sizes of its corrections.
pub struct Iteration {
    tolerance: f64,
    stalled: f64,
    unit: f64,
    most: u32,
    last: f64,
    count: u32,
    /// The largest ratio of a correction to the correction before it.
    pub rate: f64,
}

impl Iteration {
    /// The iteration of a step whose error is `allowed`, if its length is free.
    #[inline(always)]
    pub fn new(allowed: Option<&Allowed>) -> Self {
        let (tolerance, stalled, unit, most) = match allowed {
            None => (FIXED, STALLED, 1.0, MOST_FIXED),
            Some(allowed) => {
                // In units of the allowed error: a small share of it, but not less than round-off.
                let unit = allowed.tolerance;
                let tolerance = f64::max(10.0 * f64::EPSILON / unit, f64::min(0.03, unit.sqrt()));
                (tolerance, f64::max(tolerance, 0.03), unit, MOST_FREE)
            }
        };
        Self { tolerance, stalled, unit, most, last: f64::INFINITY, count: 0, rate: 0.0 }
    }

    /// Whether a correction of this size was the last one. The error says that the iteration does not converge.
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
        // Corrections close to round-off say nothing about the rate.
        if size > self.tolerance {
            self.rate = self.rate.max(rate);
        }
        self.last = size;
        // The first correction says nothing about the rate, so it is the last one only if it is very small.
        let left = if self.count == 1 { 1e3 * size } else { rate / (1.0 - rate) * size };
        Ok(left <= self.tolerance)
    }
}

/// The equations of a step in the form that an iteration needs.
pub struct Problem<'a, S, F> {
    pub step: &'a Step<'a, f64, S>,
    /// One over the unit in which the correction of each state is measured.
    weights: States<f64>,
    pub linearization: &'a Linearization,
    /// The factors of the linearisation for the length of the step.
    pub factors: &'a F,
}

impl<S: System<f64>, F> Problem<'_, S, F> {
    /// The rates at the share `c` of the step, where the state differs by `z` from the state at its start.
    #[inline(always)]
    pub fn rates(&self, c: f64, z: &States<f64>, stats: &mut Stats) -> States<f64> {
        stats.evaluations += 1;
        let mut rate = [0.0; MAX_COMPONENTS];
        let &Step { system, drive, tau, h, y, .. } = self.step;
        let at = StageState { from: y, by: 1.0, along: z };
        system.rates(&drive.at(c.mul_add(h, tau)), drive, at, &mut rate);
        rate
    }

    /// The largest of the corrections, each in the unit of its state; NaN if any is NaN.
    #[inline(always)]
    pub fn size(&self, correction: &States<f64>) -> f64 {
        largest(self.step.system.size(), correction, &self.weights)
    }

    /// Whether the rates at the start of the step predict its change. They do not if a stiff part is still decaying.
    #[inline(always)]
    pub fn is_smooth(&self) -> bool {
        const SMALL: f64 = 0.1;
        let size = self.size(self.step.rate) * self.step.h;
        size * self.step.allowed.map_or(1.0, |allowed| allowed.tolerance) <= SMALL
    }
}

/// The state at the end of a step and the rate of convergence, or the failure of the iteration.
pub type Solved = Result<(States<f64>, f64), Unsolved>;

/// A method that solves equations for its stages.
pub trait Scheme<S: System<f64>> {
    type Factors: Copy;
    const FACTORISATIONS: u64;

    fn factor(linearization: &Linearization, h: f64) -> Self::Factors;

    /// Iterates until the stages have converged. Returns the state at the end of the step, and the rate of convergence.
    fn solve(&mut self, problem: &Problem<'_, S, Self::Factors>, stats: &mut Stats) -> Solved;

    #[inline(always)]
    fn restart(&mut self) {}
}

/// A scheme with the Jacobian and the factors that it keeps while they are of use.
pub struct Newton<M, F, T = Tangent<f64>> {
    /// The numbers of components of a state, and their typical magnitudes.
    size: Size,
    magnitudes: States<f64>,
    pub(super) tangent: T,
    pub scheme: M,
    linearization: Linearization,
    reusable: bool,
    /// The factors, after the length of the step that they are for.
    factors: Option<(f64, F)>,
}

impl<M, F: Copy, T> Newton<M, F, T> {
    /// A scheme for a system that is given in dual numbers, and whose states have the typical magnitudes
    /// `magnitudes`.
    #[inline(always)]
    pub fn new(size: Size, tangent: T, magnitudes: States<f64>, scheme: M) -> Self {
        let linearization = Linearization::new(size);
        Self { size, magnitudes, tangent, scheme, linearization, reusable: false, factors: None }
    }

    #[inline(always)]
    pub fn last(&self) -> Option<(&Linearization, &F)> {
        self.factors.as_ref().map(|(_, factors)| (&self.linearization, factors))
    }

    #[inline(always)]
    fn weights<S>(&self, step: &Step<'_, f64, S>) -> States<f64> {
        if let Some(allowed) = step.allowed {
            return allowed.weights;
        }
        let mut weights = [0.0; MAX_COMPONENTS];
        self.size.each(|n| weights[n] = 1.0 / step.y[n].abs().max(self.magnitudes[n]));
        weights
    }
}

/// A scheme for single runs, before its first step.
pub(super) fn newton<M, F: Copy>(
    runs: Runs<'_>,
    system: &SceneEquations<f64>,
    scheme: M,
) -> Called<Newton<M, F>> {
    Called(Newton::new(system.size(), runs.tangent(), magnitudes(runs, system), scheme))
}

fn magnitudes(runs: Runs<'_>, system: &SceneEquations<f64>) -> States<f64> {
    system.begin(&Motion::typical_magnitudes(runs.parameters[0]))
}

impl<M, F, T, S> Integrator<f64, S> for Newton<M, F, T>
where
    M: Scheme<S, Factors = F>,
    F: Copy,
    T: Linear<f64>,
    S: System<f64>,
{
    #[inline(always)]
    fn step(&mut self, step: &Step<'_, f64, S>, next: &mut States<f64>, stats: &mut Stats) -> StepResult {
        let weights = self.weights(step);
        loop {
            let renewed = !self.reusable;
            if renewed {
                stats.jacobians += 1;
                Integrator::<f64, S>::take_jacobian(self, step.drive, step.tau, step.y);
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
            let problem = Problem { step, weights, linearization, factors: &factors };
            match self.scheme.solve(&problem, stats) {
                Ok((end, rate)) => {
                    self.reusable = rate <= REUSE_RATE;
                    *next = end;
                    return Ok(());
                }
                // With a Jacobian of this step the iteration may converge although it did not with an older one.
                Err(unsolved) => {
                    self.reusable = false;
                    if renewed {
                        return Err(unsolved);
                    }
                }
            }
        }
    }

    inlined! {
        keeps_jacobian(&self) -> bool = true;
        jacobian_is_reusable(&self) -> bool = self.reusable;
    }

    fn renew(&mut self, runs: Runs<'_>) {
        self.tangent.renew(runs);
        self.magnitudes = magnitudes(runs, &runs.system());
    }

    #[inline(always)]
    fn take_jacobian(&mut self, drive: &SegmentDrive, tau: f64, y: &States<f64>) {
        self.linearization.take(&self.tangent, drive, tau, y);
        self.factors = None;
        self.reusable = true;
    }

    #[inline(always)]
    fn restart(&mut self) {
        self.reusable = false;
        self.scheme.restart();
    }

    #[inline(always)]
    fn repeat(&mut self) {
        self.reusable = true;
        self.scheme.restart();
    }
}
