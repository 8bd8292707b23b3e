//! Dual numbers: a value with its derivatives in several directions at once. Evaluating the right-hand side
//! with dual numbers gives its Jacobian, exact to round-off, and its value to the same bits as plain numbers
//! give.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::number::lanes::{Bits, LaneTask, Lanes, Lift};
use crate::number::real::Real;
use crate::number::simd::dispatch::call_alone;
use crate::number::simd::level::Instructions;

/// A value and its derivatives in `W` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<R, const W: usize> {
    /// The value.
    pub value: R,
    /// Its derivatives.
    pub slope: [R; W],
}

impl<R: Real, const W: usize> Dual<R, W> {
    /// Makes the independent variable of `direction`. A direction beyond the last one makes a constant.
    #[inline(always)]
    pub fn variable(value: R, direction: usize) -> Self {
        let mut slope = [R::zero(); W];
        if let Some(own) = slope.get_mut(direction) {
            *own = R::constant(1.0);
        }
        Self { value, slope }
    }

    /// A number with this value, whose derivative in each direction is `a` times the derivative of `self`
    /// (the chain rule).
    #[inline(always)]
    fn chain(self, value: R, a: R) -> Self {
        let mut slope = self.slope;
        for s in &mut slope {
            *s = a * *s;
        }
        Self { value, slope }
    }
}

impl<R: Real, const W: usize> Add for Dual<R, W> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        self.value = self.value + other.value;
        for k in 0..W {
            self.slope[k] = self.slope[k] + other.slope[k];
        }
        self
    }
}

impl<R: Real, const W: usize> Sub for Dual<R, W> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, other: Self) -> Self {
        self.value = self.value - other.value;
        for k in 0..W {
            self.slope[k] = self.slope[k] - other.slope[k];
        }
        self
    }
}

impl<R: Real, const W: usize> Mul for Dual<R, W> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, other: Self) -> Self {
        for k in 0..W {
            self.slope[k] = self.slope[k].dot2(other.value, self.value, other.slope[k]);
        }
        self.value = self.value * other.value;
        self
    }
}

impl<R: Real, const W: usize> Div for Dual<R, W> {
    type Output = Self;
    #[inline(always)]
    fn div(mut self, other: Self) -> Self {
        let inverse = R::constant(1.0) / other.value;
        let quotient = self.value / other.value;
        for k in 0..W {
            self.slope[k] = quotient.neg_mul_add(other.slope[k], self.slope[k]) * inverse;
        }
        self.value = quotient;
        self
    }
}

impl<R: Real, const W: usize> Neg for Dual<R, W> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        self.value = -self.value;
        for k in 0..W {
            self.slope[k] = -self.slope[k];
        }
        self
    }
}

impl<R: Real, const W: usize> Real for Dual<R, W> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self { value: R::constant(x), slope: [R::zero(); W] }
    }

    #[inline(always)]
    fn mul_add(mut self, a: Self, b: Self) -> Self {
        for k in 0..W {
            self.slope[k] = self.slope[k].mul_add(a.value, self.value.mul_add(a.slope[k], b.slope[k]));
        }
        self.value = self.value.mul_add(a.value, b.value);
        self
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }

    #[inline(always)]
    fn select(bits: Bits, a: Self, mut b: Self) -> Self {
        b.value = R::select(bits, a.value, b.value);
        for k in 0..W {
            b.slope[k] = R::select(bits, a.slope[k], b.slope[k]);
        }
        b
    }
}

/// The number of a single run with its derivatives, so that methods take their steps in dual numbers. It is
/// compared by its value.
impl<const W: usize> Lanes for Dual<f64, W> {
    const WIDTH: usize = 1;

    #[inline(always)]
    fn call<K: LaneTask<Self>>(instructions: Instructions, task: K) -> K::Output {
        call_alone(instructions, task)
    }

    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        Self::constant(f(0))
    }

    #[inline(always)]
    fn lane(self, _: usize) -> f64 {
        self.value
    }

    #[inline(always)]
    fn set(&mut self, _: usize, value: f64) {
        *self = Self::constant(value);
    }

    #[inline(always)]
    fn less(self, other: Self) -> Bits {
        self.value.less(other.value)
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> Bits {
        self.value.at_most(other.value)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        if self.value < 0.0 { -self } else { self }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }

    #[inline(always)]
    fn rotate_quadrants(quadrants: Self, mut sin: Self, mut cos: Self) -> (Self, Self) {
        let turn = |sin, cos| f64::rotate_quadrants(quadrants.value, sin, cos);
        (sin.value, cos.value) = turn(sin.value, cos.value);
        for k in 0..W {
            (sin.slope[k], cos.slope[k]) = turn(sin.slope[k], cos.slope[k]);
        }
        (sin, cos)
    }
}

impl<R: Lanes, const W: usize> Lift<R> for Dual<R, W> {
    #[inline(always)]
    fn lift(value: R) -> Self {
        Self { value, slope: [R::zero(); W] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A function that uses every arithmetic operation.
    fn f<R: Real>(x: R, y: R) -> R {
        let (s, c) = (x * y).sin_cos();
        (s - x / y).mul_add(c, -(y + R::constant(3.0)).dot2(x, y, s))
    }

    proptest! {
        #[test]
        fn derivatives_agree_with_differences_and_values_to_the_bit(x in -2.0..2.0_f64, y in 0.5..2.0_f64) {
            let dual = f(Dual::<f64, 2>::variable(x, 0), Dual::variable(y, 1));
            prop_assert_eq!(dual.value.to_bits(), f(x, y).to_bits());
            let h = 1e-5;
            let difference = [
                (f(x + h, y) - f(x - h, y)) / (2.0 * h),
                (f(x, y + h) - f(x, y - h)) / (2.0 * h),
            ];
            for (slope, expected) in dual.slope.iter().zip(difference) {
                prop_assert!((slope - expected).abs() <= 1e-7 * (1.0 + expected.abs()), "{slope} {expected}");
            }
        }
    }
}
