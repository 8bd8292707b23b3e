//! Dual numbers: a value with its derivatives in several directions at once. Evaluating the right-hand side
//! with dual numbers gives its Jacobian, exact to round-off, and its value to the same bits as plain numbers
//! give.

use std::ops::Neg;

use crate::number::real::operators;
use crate::number::{Bits, Compose, Functions, LaneTask, Lanes, Lift, Real, inlined};

/// A value and its derivatives in `W` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<R, const W: usize> {
    pub value: R,
    pub slope: [R; W],
}

/// A number like this one, but with this value and in each direction `k` with this derivative. Directions are written
/// out, because loops in each of some ten thousand inlined operations took the compiler a third of its time.
macro_rules! dual {
    ($like:ident, $k:ident => $value:expr, $slope:expr) => {{
        const { assert!(W <= 4) };
        let mut number = $like;
        number.value = $value;
        dual! { [number.slope, $k, $slope] 0 1 2 3 }
        number
    }};
    ([$slopes:expr, $k:ident, $slope:expr] $($direction:literal)*) => {$(
        if const { W > $direction } {
            let $k = $direction;
            $slopes[$k] = $slope;
        }
    )*};
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
        dual!(self, k => value, a * self.slope[k])
    }
}

impl<R: Lanes> Dual<R, 1> {
    /// Makes a number whose value is the same in every lane, from the derivative in each direction: those of the first
    /// vector of derivatives are in lanes, then those of the second, and so on. It is called, because it is rare.
    #[inline(never)]
    pub fn varied(value: f64, slopes: &[f64]) -> Self {
        let mut number = Self::constant(value);
        for (own, slopes) in number.slope.iter_mut().zip(slopes.chunks(R::WIDTH)) {
            *own = R::from_fn(|lane| slopes.get(lane).copied().unwrap_or(0.0));
        }
        number
    }

    #[inline(always)]
    pub fn direction(&self, k: usize) -> f64 {
        self.slope[k / R::WIDTH].lane(k % R::WIDTH)
    }
}

/// A number in vectors `X` that hold the lanes of `R` once for each of several directions, with the derivative in this
/// direction.
#[inline(always)]
pub fn spread<R: Lanes, X: Lanes>(value: R, slope: impl Fn(usize) -> R) -> Dual<X, 1> {
    Dual {
        value: X::from_fn(|lane| value.lane(lane % R::WIDTH)),
        slope: [X::from_fn(|lane| slope(lane / R::WIDTH).lane(lane % R::WIDTH))],
    }
}

/// The lanes of `R` in the direction `k` of such a vector.
#[inline(always)]
pub fn gathered<R: Lanes, X: Lanes>(of: X, k: usize) -> R {
    R::from_fn(|lane| of.lane(k * R::WIDTH + lane))
}

operators! {
    [R: Real, const W: usize] Dual<R, W>, |own, other|
    dual!(own, k => own.value + other.value, own.slope[k] + other.slope[k]),
    dual!(own, k => own.value - other.value, own.slope[k] - other.slope[k]),
    dual!(own, k => own.value * other.value, own.slope[k].dot2(other.value, own.value, other.slope[k])),
    {
        let inverse = R::constant(1.0) / other.value;
        let quotient = own.value / other.value;
        dual!(own, k => quotient, quotient.neg_mul_add(other.slope[k], own.slope[k]) * inverse)
    }
}

impl<R: Real, const W: usize> Neg for Dual<R, W> {
    type Output = Self;

    inlined! { neg(self) -> Self = dual!(self, k => -self.value, -self.slope[k]); }
}

impl<R: Real> Compose for Dual<R, 1> {}

/// The numbers of Jacobians in lanes. Parameters are constants there, so one derivative of the functions is enough, and the
/// chain rule gives all three directions.
impl<R: Real> Compose for Dual<R, 3> {
    #[inline(always)]
    fn compose<const N: usize>(self, functions: &impl Functions<Self, N>) -> [Self; N] {
        let found = functions.at(Dual::<R, 1>::variable(self.value, 0));
        let mut composed = [self; N];
        for n in 0..N {
            composed[n] = self.chain(found[n].value, found[n].slope[0]);
        }
        composed
    }
}

impl<R: Real> Lift<Dual<R, 3>> for Dual<R, 1> {
    inlined! { lift(parameter: Dual<R, 3>) -> Self = Self::lift(parameter.value); }
}

impl<R: Real, const W: usize> Real for Dual<R, W>
where
    Self: Compose,
{
    /// One direction after the other takes little code.
    const ANY_PARTS: bool = R::VARIED_PARTS && W == 1;
    const VARIED_PARTS: bool = Self::ANY_PARTS;
    const ORDER: usize = R::ORDER + 1;

    inlined! {
        constant(x: f64) -> Self = Self { value: R::constant(x), slope: [R::zero(); W] };
        less(self, other: Self) -> Bits = self.value.less(other.value);
        mul_add(self, a: Self, b: Self) -> Self = dual!(self, k =>
            self.value.mul_add(a.value, b.value),
            self.slope[k].mul_add(a.value, self.value.mul_add(a.slope[k], b.slope[k])));
        neg_mul_add(self, a: Self, b: Self) -> Self = dual!(self, k =>
            self.value.neg_mul_add(a.value, b.value),
            self.slope[k].neg_mul_add(a.value, self.value.neg_mul_add(a.slope[k], b.slope[k])));
        select(bits: Bits, a: Self, b: Self) -> Self =
            dual!(a, k => R::select(bits, a.value, b.value), R::select(bits, a.slope[k], b.slope[k]));
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, R::constant(0.5) / root)
    }

    #[inline(always)]
    fn angle(self, cos: Self) -> Self {
        let inverse = R::constant(1.0) / self.value.dot2(self.value, cos.value, cos.value);
        let (by_sin, by_cos) = (cos.value * inverse, -(self.value * inverse));
        dual!(self, k => self.value.angle(cos.value), by_sin.dot2(self.slope[k], by_cos, cos.slope[k]))
    }

    #[inline(always)]
    fn power(self, n: Self) -> Self {
        let (value, positive) = (self.value.power(n.value), R::zero().less(self.value));
        let by_base = R::select(positive, n.value * (value / self.value), R::zero());
        let by_exponent = value * self.value.ln();
        dual!(self, k => value, by_base.dot2(self.slope[k], by_exponent, n.slope[k]))
    }

    #[inline(always)]
    fn ln(self) -> Self {
        let one = R::constant(1.0);
        let positive = R::zero().less(self.value);
        self.chain(self.value.ln(), R::select(positive, one / self.value, R::zero()))
    }

    #[inline(always)]
    fn outlined<K: LaneTask<Self>>(task: K) -> K::Output {
        R::outlined(Wrapped::<_, W>(task))
    }
}

/// A task for dual numbers of lanes, which is called with the instructions of the lanes.
struct Wrapped<K, const W: usize>(K);

impl<R: Real, K: LaneTask<Dual<R, W>>, const W: usize> LaneTask<R> for Wrapped<K, W> {
    type Output = K::Output;

    inlined! { run(self) -> K::Output = self.0.run(); }
}

/// The numbers of lanes with their derivatives, so that methods take their steps in dual numbers. They are compared by
/// their values.
impl<R: Lanes, const W: usize> Lanes for Dual<R, W>
where
    Self: Compose,
{
    const WIDTH: usize = R::WIDTH;

    inlined! {
        from_fn(f: impl FnMut(usize) -> f64) -> Self = Self::lift(R::from_fn(f));
        lane(self, lane: usize) -> f64 = self.value.lane(lane);
        at_most(self, other: Self) -> Bits = self.value.at_most(other.value);
        abs(self) -> Self = Self::select(self.value.less(R::zero()), -self, self);
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, value: f64) {
        self.value.set(lane, value);
        for slope in &mut self.slope {
            slope.set(lane, 0.0);
        }
    }

    #[inline(always)]
    fn rotate_quadrants(quadrants: Self, sin: Self, cos: Self) -> (Self, Self) {
        let (mut s, mut c) = (sin, cos);
        (s.value, c.value) = R::rotate_quadrants(quadrants.value, sin.value, cos.value);
        for k in 0..W {
            (s.slope[k], c.slope[k]) = R::rotate_quadrants(quadrants.value, sin.slope[k], cos.slope[k]);
        }
        (s, c)
    }
}

impl<R: Real, const W: usize> Lift<R> for Dual<R, W>
where
    Self: Compose,
{
    inlined! { lift(value: R) -> Self = Self { value, slope: [R::zero(); W] }; }
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
            let dual = f(Dual::<f64, 3>::variable(x, 0), Dual::variable(y, 1));
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
