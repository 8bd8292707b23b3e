//! `f64` as the number type of one run, and as lanes of width one.

use crate::number::simd::dispatch::call_alone;
use crate::number::trigonometry::elementary;
use crate::number::{Bits, Compose, LaneTask, Lanes, Real, inlined};

impl Compose for f64 {}

impl Real for f64 {
    inlined! {
        constant(x: f64) -> Self = x;
        mul_add(self, a: Self, b: Self) -> Self = f64::mul_add(self, a, b);
        select(bits: Bits, a: Self, b: Self) -> Self = if bits & 1 != 0 { a } else { b };
        less(self, other: Self) -> Bits = Bits::from(self < other);
        sqrt(self) -> Self = f64::sqrt(self);
    }

    elementary!();

    #[inline(always)]
    fn outlined<K: LaneTask<Self>>(task: K) -> K::Output {
        call_alone(task)
    }
}

impl Lanes for f64 {
    const WIDTH: usize = 1;

    inlined! {
        from_fn(mut f: impl FnMut(usize) -> f64) -> Self = f(0);
        lane(self, _lane: usize) -> f64 = self;
        set(&mut self, _lane: usize, value: f64) -> () = *self = value;
        at_most(self, other: Self) -> Bits = Bits::from(self <= other);
        abs(self) -> Self = f64::abs(self);
    }

    #[inline(always)]
    fn rotate_quadrants(quadrants: Self, sin: Self, cos: Self) -> (Self, Self) {
        let quadrant = quadrants.to_bits();
        let (s, c) = if quadrant & 1 == 0 { (sin, cos) } else { (cos, sin) };
        let sin_sign = (quadrant & 2) << 62;
        let cos_sign = ((quadrant + 1) & 2) << 62;
        (f64::from_bits(s.to_bits() ^ sin_sign), f64::from_bits(c.to_bits() ^ cos_sign))
    }
}
