//! The derivative of a step of the Rosenbrock method.

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::run_dual::RunDual;
use crate::formulation::system::{Linear, StageState, System};
use crate::method::linearize::Linearization;
use crate::method::rosenbrock::{A, BY_TIME, C, COUPLING, GAMMA, Rosenbrock, STAGES};
use crate::method::run_dual::{Differentiable, SolvedStep, add_scaled, solve_slopes};
use crate::method::traits::Step;
use crate::number::lanes::Lanes;
use crate::number::linear::LaneEntry;
use crate::number::real::Real;

/// `sum` plus the weighted stages times `by`.
#[inline(always)]
fn plus<R: Lanes>(sum: &mut States<RunDual<R>>, stages: &[States<RunDual<R>>], weights: &[f64], by: f64) {
    for (stage, weight) in stages.iter().zip(weights) {
        let weight = R::constant(weight * by);
        for n in 0..MAX_COMPONENTS {
            add_scaled(&mut sum[n], weight, &stage[n]);
        }
    }
}

impl<R: Lanes, T: Linear<f64>> Differentiable<R> for Rosenbrock<T> {
    /// (1/(gamma h) - J) du_i is the derivative of the right-hand side of the stage, plus dJ u_i and the derivative
    /// of d_i h df/dt. Both are the derivative of J u_i + d_i h df/dt for constant u_i, which is the derivative of
    /// the rates along u_i in the state and d_i h in time.
    #[inline(always)]
    fn differentiate(&self, solved: &SolvedStep<'_, R>) -> States<RunDual<R>> {
        let &SolvedStep { equations, step: &Step { system, drive, tau, h, y, rate, .. }, .. } = solved;
        let size = system.size();
        let h = h.lane(0);
        let linearization = Linearization::of(size, self.linearization.jacobian.everywhere());
        let factors = linearization.factor(LaneEntry(R::constant(1.0 / (GAMMA * h))));
        let mut stages = [[RunDual::zero(); MAX_COMPONENTS]; STAGES];
        let (mut load, mut at) = (*rate, *y);
        for i in 0..STAGES {
            if i > 0 {
                at = *y;
                plus(&mut at, &stages, &A[i][..i], 1.0);
                let state = StageState { from: &at, by: RunDual::zero(), along: y };
                let input = drive.at(tau + RunDual::constant(C[i] * h));
                system.rates(&input, drive, state, &mut load);
            }
            plus(&mut load, &stages, &COUPLING[i][..i], 1.0 / h);
            let own = &self.stages[i];
            let change = equations.along(drive, (tau, y), (own, BY_TIME[i] * h));
            for n in 0..size.all() {
                load[n] = load[n] + change[n];
            }
            let slopes = solve_slopes(&linearization, &factors, &load);
            for n in 0..size.all() {
                stages[i][n] = RunDual { value: R::constant(own[n]), ..slopes[n] };
            }
        }
        for n in 0..size.all() {
            at[n] = at[n] + stages[STAGES - 1][n];
        }
        at
    }
}
