//! A tip whose force on an upright face was measured: F'' is a sum of Bernstein polynomials with weights that are not
//! negative, over the range of compressions.
//!
//! So F'' >= 0, the density of springs that (4) needs, holds for any weights; F(0) = F'(0) = 0; and F is smooth, so that
//! every method keeps its order. Beyond the range F'' stays at its last value.

use super::springs::Curve;
use crate::model::Source;
use crate::number::{Lift, Real};

pub const WEIGHTS: usize = 10;

#[derive(Debug, Clone, Copy)]
pub(super) struct Measured<R> {
    range: R,
    /// One over the range.
    inverse: R,
    /// Of F'', F', F and Phi, the coefficients of x^(k+n) (1 - x)^(9-k), in which n says which integral of F'' it is.
    coefficients: [[R; WEIGHTS]; 4],
}

impl<R: Real> Measured<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        let range = source.number(|p| p.laws[i].range);
        let mut weights = [R::zero(); WEIGHTS];
        for (k, weight) in weights.iter_mut().enumerate() {
            *weight = source.number(|p| p.weights[i][k]);
        }
        let mut coefficients = [weights; 4];
        for n in 0..4 {
            let degree = (WEIGHTS - 1 + n) as f64;
            if n > 0 {
                // The integral of a polynomial is one of degree n + 1 with the running sums of its weights over n + 1.
                let step = range * R::constant(1.0 / degree);
                weights[0] = step * weights[0];
                for k in 1..WEIGHTS {
                    weights[k] = step.mul_add(weights[k], weights[k - 1]);
                }
            }
            let mut binomial = 1.0;
            for place in 0..WEIGHTS + n {
                if place >= n {
                    coefficients[n][place - n] = R::constant(binomial) * weights[place - n];
                }
                binomial *= (degree - place as f64) / (place as f64 + 1.0);
            }
        }
        Self { range, inverse: R::constant(1.0) / range, coefficients }
    }

    /// The curve at a compression that is not negative.
    #[inline(always)]
    pub(super) fn curve<T: Lift<R>>(&self, d: T) -> Curve<T> {
        let one = T::constant(1.0);
        let beyond = (d - T::lift(self.range)).positive_part();
        let x = (d - beyond) * T::lift(self.inverse);
        let (y, mut powers, mut terms) = (one - x, [one; 2], [one; WEIGHTS]);
        for k in 0..WEIGHTS {
            terms[k] = terms[k] * powers[0];
            terms[WEIGHTS - 1 - k] = terms[WEIGHTS - 1 - k] * powers[1];
            powers = [powers[0] * x, powers[1] * y];
        }
        let mut sums = [T::zero(); 4];
        // The middle terms are ready first.
        for k in (0..WEIGHTS / 2).rev() {
            for place in [k, WEIGHTS - 1 - k] {
                for n in 0..4 {
                    sums[n] = terms[place].mul_add(T::lift(self.coefficients[n][place]), sums[n]);
                }
            }
        }
        let [bend, slope, force, integral] =
            [sums[0], x * sums[1], (x * x) * sums[2], (x * x) * (x * sums[3])];
        let mut found = Curve { integral, force, slope, bend };
        if T::zero().less(beyond) != 0 {
            let half = T::constant(0.5) * beyond;
            let third = T::constant(1.0 / 3.0);
            found.integral = integral + beyond * (force + half * (slope + bend * beyond * third));
            found.force = force + beyond * (slope + bend * half);
            found.slope = slope + bend * beyond;
        }
        found
    }
}
