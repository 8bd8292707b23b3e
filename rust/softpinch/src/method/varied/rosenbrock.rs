//! The derivative of a step of the Rosenbrock method.

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::system::{Linear, StageState, System};
use crate::formulation::varied_equations::{DIRECTIONS, Varied, VariedEquations};
use crate::method::rosenbrock::{A, BY_TIME, C, COUPLING, GAMMA, Rosenbrock, STAGES};
use crate::method::traits::Step;
use crate::method::varied::{Differentiable, Drives, constants, solve_slopes};
use crate::model::drive::Drive;
use crate::number::real::Real;

/// `sum` plus the weighted stages times `by`.
#[inline(always)]
fn plus(all: usize, sum: &mut States<Varied>, stages: &[States<Varied>], weights: &[f64], by: f64) {
    for (stage, weight) in stages.iter().zip(weights) {
        let weight = Varied::constant(weight * by);
        for n in 0..all {
            sum[n] = weight.mul_add(stage[n], sum[n]);
        }
    }
}

impl<T: Linear<f64>> Differentiable for Rosenbrock<T> {
    /// (1/(gamma h) - J) du_i is the derivative of the right-hand side of the stage, plus dJ u_i and the derivative
    /// of d_i h df/dt. Both are the derivative of J u_i + d_i h df/dt for constant u_i, which is the derivative of
    /// the rates along u_i in the state and d_i h in time.
    #[inline(always)]
    fn differentiate(
        &self,
        system: &VariedEquations,
        drives: &Drives<'_>,
        step: &Step<'_, Varied>,
        end: &States<f64>,
        next: &mut States<Varied>,
    ) {
        let all = system.size().all();
        let &Step { tau, h, y, rate, .. } = step;
        let h = h.value;
        let linearization = self.linearization();
        let factors = linearization.factor(1.0 / (GAMMA * h));
        let mut stages = [[Varied::zero(); MAX_COMPONENTS]; STAGES];
        let (mut load, mut at) = (*rate, *y);
        for i in 0..STAGES {
            if i > 0 {
                at = *y;
                plus(all, &mut at, &stages, &A[i][..i], 1.0);
                let state = StageState { from: &at, by: Varied::zero(), along: y };
                let input = drives.varied.at(tau + Varied::constant(C[i] * h));
                system.rates(&input, &drives.varied.contacts, state, &mut load);
            }
            plus(all, &mut load, &stages, &COUPLING[i][..i], 1.0 / h);
            let own = &self.stages()[i];
            let change = system.along(drives.varied, (tau, y), (own, BY_TIME[i] * h));
            for n in 0..all {
                load[n] = load[n] + change[n];
            }
            let slopes = solve_slopes(linearization, &factors, &load);
            for n in 0..all {
                stages[i][n] = Varied { value: own[n], slope: std::array::from_fn(|k| slopes[k][n]) };
            }
        }
        *next = constants(end);
        for n in 0..all {
            for k in 0..DIRECTIONS {
                next[n].slope[k] = at[n].slope[k] + stages[STAGES - 1][n].slope[k];
            }
        }
    }
}
