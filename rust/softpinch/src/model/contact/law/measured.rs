//! A tip whose force on an upright face was measured: F'' is a sum of Bernstein polynomials with weights that are not
//! negative, over the range of compressions.
//!
//! So F'' >= 0, the density of springs that (4) needs, holds for any weights; F(0) = F'(0) = 0; and F is smooth, so that
//! every method keeps its order. Beyond the range F'' stays at its last value.

use super::springs::Curve;
use crate::model::Source;
use crate::number::Real;

pub const WEIGHTS: usize = 10;

#[derive(Debug, Clone, Copy)]
pub(super) struct Measured<R> {
    range: R,
    weights: [R; WEIGHTS],
}

impl<R: Real> Measured<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        let mut weights = [R::zero(); WEIGHTS];
        for (k, weight) in weights.iter_mut().enumerate() {
            *weight = source.number(|p| p.weights[i][k]);
        }
        Self { range: source.number(|p| p.laws[i].range), weights }
    }

    /// The curve at a compression that is not negative.
    #[inline(always)]
    pub(super) fn curve(&self, d: R) -> Curve<R> {
        let zero = R::zero();
        let beyond = (d - self.range).positive_part();
        let x = (d - beyond) / self.range;
        let y = R::constant(1.0) - x;
        // The integral of a polynomial of degree n is one of degree n + 1 with the running sums of its weights over n + 1.
        let (mut sums, mut doubles, mut triples) = ([zero; WEIGHTS], [zero; WEIGHTS], [zero; WEIGHTS]);
        let (mut one_sum, mut two_sum, mut three_sum) = (zero, zero, zero);
        for k in 0..WEIGHTS {
            one_sum = one_sum + self.weights[k];
            two_sum = two_sum + one_sum;
            three_sum = three_sum + two_sum;
            (sums[k], doubles[k], triples[k]) = (one_sum, two_sum, three_sum);
        }
        let degree = WEIGHTS as f64;
        let step = |own: f64| self.range * R::constant(1.0 / own);
        let (first, second, third) = (step(degree), step(degree + 1.0), step(degree + 2.0));
        let bend = bernstein(&self.weights, 0, x, y);
        let slope = first * bernstein(&sums, 1, x, y);
        let force = first * second * bernstein(&doubles, 2, x, y);
        let integral = first * second * third * bernstein(&triples, 3, x, y);
        let half = R::constant(0.5) * beyond;
        Curve {
            integral: integral + beyond * (force + half * (slope + bend * beyond * R::constant(1.0 / 3.0))),
            force: force + beyond * (slope + bend * half),
            slope: slope + bend * beyond,
            bend,
        }
    }
}

/// A polynomial by its coefficients in Bernstein polynomials of degree `WEIGHTS - 1 + shift`, of which the first `shift` are
/// zero, at `x` with `y` = 1 - x.
#[inline(always)]
fn bernstein<R: Real>(coefficients: &[R; WEIGHTS], shift: usize, x: R, y: R) -> R {
    let degree = (WEIGHTS - 1 + shift) as f64;
    let (mut binomial, mut power, mut sum) = (1.0, R::constant(1.0), R::zero());
    for k in 0..shift {
        binomial *= (degree - k as f64) / (k as f64 + 1.0);
        power = power * x;
    }
    for (k, &coefficient) in coefficients.iter().enumerate() {
        sum = sum.mul_add(y, R::constant(binomial) * coefficient * power);
        let place = (k + shift) as f64;
        binomial *= (degree - place) / (place + 1.0);
        power = power * x;
    }
    sum
}
