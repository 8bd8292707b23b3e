//! A tip whose force on an upright face is a power of its compression.
//!
//! F = c {(d + epsilon)^n - epsilon^n - n epsilon^(n-1) d}. The foot epsilon keeps F'' finite at d = 0, where n < 2 has a
//! pole, in which no shear can be released; it is zero for plain powers.

use super::springs::Curve;
use crate::model::Source;
use crate::number::{Lift, Real};

#[derive(Debug, Clone, Copy)]
pub(super) struct Power<R> {
    coefficient: R,
    exponent: R,
    /// One over n + 1.
    inverse: R,
    foot: R,
    /// The foot to the powers n - 1 and n.
    foot_powers: [R; 2],
}

impl<R: Real> Power<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        let [exponent, foot] = [source.number(|p| p.laws[i].exponent), source.number(|p| p.laws[i].foot)];
        let (_, slope, force) = powers(foot, exponent);
        let coefficient = source.number(|p| p.laws[i].coefficient);
        let inverse = R::constant(1.0) / (exponent + R::constant(1.0));
        Self { coefficient, exponent, inverse, foot, foot_powers: [slope, force] }
    }

    /// The curve at a compression that is not negative.
    #[inline(always)]
    pub(super) fn curve<T: Lift<R>>(&self, d: T) -> Curve<T> {
        let [c, n, inverse] = [T::lift(self.coefficient), T::lift(self.exponent), T::lift(self.inverse)];
        let (foot, [foot_slope, foot_force]) = (T::lift(self.foot), self.foot_powers);
        let (foot_slope, foot_force) = (T::lift(foot_slope), T::lift(foot_force));
        let one = T::constant(1.0);
        let y = d + foot;
        let (bend, slope, force) = powers(y, n);
        let rise = n * foot_slope;
        let integral = (force * y - foot_force * foot) * inverse;
        Curve {
            integral: c * (integral - d * (foot_force + T::constant(0.5) * rise * d)),
            force: c * (force - foot_force - rise * d),
            slope: c * n * (slope - foot_slope),
            bend: c * n * (n - one) * bend,
        }
    }
}

/// y to the powers n - 2, n - 1 and n. A closure would be compiled without the instructions of the lanes.
#[inline(always)]
fn powers<R: Real>(y: R, n: R) -> (R, R, R) {
    let bend = y.power(n - R::constant(2.0));
    let slope = bend * y;
    (bend, slope, slope * y)
}
