//! The explicit Runge-Kutta method of order eight of Dormand and Prince (Prince and Dormand, "High order
//! embedded Runge-Kutta formulae", 1981). The coefficients, the error estimate of orders five and three and
//! the dense output of order seven are those of Hairer's DOP853 (Hairer, Norsett and Wanner, "Solving
//! Ordinary Differential Equations I", II.5 and II.6, 1993).

mod tableau;

use std::sync::LazyLock;

use nalgebra::Complex;

use crate::formulation::{BLOCK, MAX_COMPONENTS, Size, StageState, States, System};
use crate::method::{Adaptive, Called, Integrator, MethodEntry, Stats, Step, StepResult, largest};
use crate::number::{Bits, Lanes};
use tableau::{A, A_EXTRA, ALL, B, C, C_EXTRA, DENSE, E3, E5, EXTRA, STAGES};

pub const ENTRY: MethodEntry = MethodEntry {
    order: 8,
    // R has degree 12 and follows from the tableau.
    real_stability_limit: Some(6.393_65),
    stability_function,
    keeps_jacobian: false,
    alone: |_, _| Box::new(Called(Dop853::default())),
    adaptive: Some(|_, _| Box::new(Called(Dop853::default()))),
    error_order: 8.0,
    min_growth: 1.0,
};

pub struct Dop853<R = f64> {
    slopes: [States<R>; ALL],
    /// The direction from the start of the step to the current stage.
    along: States<R>,
    /// The terms of the dense output.
    terms: [States<R>; 7],
}

impl<R: Lanes> Default for Dop853<R> {
    #[inline(always)]
    fn default() -> Self {
        Self {
            slopes: [[R::zero(); MAX_COMPONENTS]; ALL],
            along: [R::zero(); MAX_COMPONENTS],
            terms: [[R::zero(); MAX_COMPONENTS]; 7],
        }
    }
}

/// The weighted sum of the slopes. The weights are constants where this function is inlined, so that the loop
/// over them is unrolled and the sums of a block stay in registers.
#[inline(always)]
fn weighted<R: Lanes>(size: Size, slopes: &[States<R>], weights: &[f64], sum: &mut States<R>) {
    for block in 0..size.blocks() {
        let mut sums = [R::zero(); BLOCK];
        for (slope, &weight) in slopes.iter().zip(weights) {
            if weight != 0.0 {
                for k in 0..BLOCK {
                    sums[k] = slope[BLOCK * block + k].mul_add(R::constant(weight), sums[k]);
                }
            }
        }
        sum[BLOCK * block..BLOCK * (block + 1)].copy_from_slice(&sums);
    }
}

/// Repeats code for each stage but the first. The number of the stage is a constant in this code, but for numbers with
/// derivatives, with which it is large.
macro_rules! each_stage {
    ($numbers:ident, $stage:ident => $body:expr) => {
        if $numbers::ORDER > 0 {
            for $stage in 1..STAGES {
                $body
            }
        } else {
            each_stage!($stage => $body; 1 2 3 4 5 6 7 8 9 10 11);
        }
    };
    ($stage:ident => $body:expr; $($number:literal)*) => {
        $({
            let $stage: usize = $number;
            $body
        })*
    };
}

impl<R: Lanes, S: System<R>> Integrator<R, S> for Dop853<R> {
    #[inline(always)]
    fn step(&mut self, step: &Step<'_, R, S>, next: &mut States<R>, stats: &mut Stats) -> StepResult {
        let &Step { system, drive, tau, h, y, rate, .. } = step;
        let Self { slopes, along, .. } = self;
        let size = system.size();
        stats.evaluations += STAGES as u64 - 1;
        slopes[0] = *rate;
        each_stage!(R, stage => {
            weighted(size, slopes, &A[stage][..stage], along);
            let input = drive.at(R::constant(C[stage]).mul_add(h, tau));
            system.rates(&input, drive, StageState { from: y, by: h, along }, &mut slopes[stage]);
        });
        weighted(size, slopes, &B, along);
        // A closure might be compiled without the instructions of the lanes.
        for n in 0..BLOCK * size.blocks() {
            next[n] = along[n].mul_add(h, y[n]);
        }
        Ok(())
    }
}

impl<R: Lanes, S: System<R>> Adaptive<R, S> for Dop853<R> {
    /// The error estimate h e5^2 / sqrt(e5^2 + (e3 / 10)^2), from the estimates of orders five and three.
    #[inline(always)]
    fn error(&mut self, step: &Step<'_, R, S>, _: Bits, _: &mut Stats) -> R {
        let (size, weights) = (step.system.size(), step.weights());
        let mut sum = [R::zero(); MAX_COMPONENTS];
        let mut estimate = |by: &[f64; STAGES]| {
            weighted(size, &self.slopes, by, &mut sum);
            largest(size, &sum, &weights)
        };
        let (five, three) = (estimate(&E5), estimate(&E3));
        let ratio = R::constant(0.1) * three / five;
        let better = step.h * five / ratio.mul_add(ratio, R::constant(1.0)).sqrt();
        R::select(five.is_zero(), five, better)
    }

    #[inline(always)]
    fn prepare(&mut self, step: &Step<'_, R, S>, next: &States<R>, stats: &mut Stats) {
        let &Step { system, drive, tau, h, y, .. } = step;
        let size = system.size();
        stats.evaluations += 1 + EXTRA as u64;
        let Self { slopes, along, terms } = self;
        let end_state = StageState { from: next, by: R::zero(), along: y };
        system.rates(&drive.at(tau + h), drive, end_state, &mut slopes[STAGES]);
        for k in 0..EXTRA {
            weighted(size, slopes, &A_EXTRA[k][..=STAGES + k], along);
            let input = drive.at(R::constant(C_EXTRA[k]).mul_add(h, tau));
            system.rates(&input, drive, StageState { from: y, by: h, along }, &mut slopes[STAGES + 1 + k]);
        }
        let (first, last) = (&slopes[0], &slopes[STAGES]);
        size.each(|n| {
            let change = next[n] - y[n];
            terms[0][n] = change;
            terms[1][n] = h.mul_add(first[n], -change);
            terms[2][n] = R::constant(2.0).mul_add(change, -h * (last[n] + first[n]));
        });
        for (term, weights) in terms[3..].iter_mut().zip(DENSE) {
            weighted(size, slopes, &weights, term);
            size.each(|n| term[n] = term[n].mul_add(h, R::zero()));
        }
    }

    #[inline(always)]
    fn interpolate(&self, y: &States<R>, _: &States<R>, x: R) -> States<R> {
        let mut at = [R::zero(); MAX_COMPONENTS];
        for (k, term) in self.terms.iter().enumerate().rev() {
            let factor = if k % 2 == 0 { x } else { R::constant(1.0) - x };
            for n in 0..MAX_COMPONENTS {
                at[n] = (at[n] + term[n]) * factor;
            }
        }
        for n in 0..MAX_COMPONENTS {
            at[n] = at[n] + y[n];
        }
        at
    }
}

/// The coefficients of R(z) = 1 + z b^T (I - z A)^-1 1, a polynomial: 1, then b^T A^k 1.
static STABILITY: LazyLock<[f64; STAGES + 1]> = LazyLock::new(|| {
    let (mut coefficients, mut powers) = ([1.0; STAGES + 1], [1.0; STAGES]);
    for coefficient in &mut coefficients[1..] {
        *coefficient = powers.iter().zip(B).map(|(power, b)| power * b).sum();
        powers = A.map(|row| row.iter().zip(powers).map(|(a, power)| a * power).sum());
    }
    coefficients
});

fn stability_function(z: Complex<f64>) -> Complex<f64> {
    STABILITY.iter().rev().fold(Complex::new(0.0, 0.0), |sum, &coefficient| sum * z + coefficient)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each row of A adds up to its node, and the weights integrate 1, c, c^2, ... up to c^7 exactly. An
    /// error in any digit shows.
    #[test]
    fn the_tableau_satisfies_its_order_conditions() {
        for (row, c) in A.iter().zip(C) {
            assert!((row.iter().sum::<f64>() - c).abs() < 2e-14, "{c}");
        }
        for power in 0..8 {
            let sum: f64 = B.iter().zip(C).map(|(b, c)| b * c.powi(power)).sum();
            assert!((sum - 1.0 / f64::from(power + 1)).abs() < 1e-14, "{power} {sum}");
        }
    }
}
