//! Portable lanes, for processors other than x86-64 and for tests.

use std::ops::Neg;

use crate::number::real::operators;
use crate::number::trigonometry::elementary;
use crate::number::{Bits, Compose, LaneTask, Lanes, Real, inlined};

/// Four lanes in an array, for any processor. The compiler chooses the vector instructions.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub struct Row4([f64; 4]);

impl Row4 {
    #[inline(always)]
    fn where_both(self, other: Self, holds: impl Fn(&f64, &f64) -> bool) -> Bits {
        (0..4).fold(0, |bits, k| bits | Bits::from(holds(&self.0[k], &other.0[k])) << k)
    }
}

operators! {
    [] Row4, |own, other|
    Self(std::array::from_fn(|k| own.0[k] + other.0[k])),
    Self(std::array::from_fn(|k| own.0[k] - other.0[k])),
    Self(std::array::from_fn(|k| own.0[k] * other.0[k])),
    Self(std::array::from_fn(|k| own.0[k] / other.0[k]))
}

impl Neg for Row4 {
    type Output = Self;

    inlined! { neg(self) -> Self = Self(self.0.map(f64::neg)); }
}

impl Compose for Row4 {}

impl Real for Row4 {
    inlined! {
        constant(x: f64) -> Self = Self([x; 4]);
        mul_add(self, a: Self, b: Self) -> Self =
            Self(std::array::from_fn(|k| self.0[k].mul_add(a.0[k], b.0[k])));
        select(bits: Bits, a: Self, b: Self) -> Self =
            Self(std::array::from_fn(|k| if bits >> k & 1 != 0 { a.0[k] } else { b.0[k] }));
        less(self, other: Self) -> Bits = self.where_both(other, f64::lt);
        sqrt(self) -> Self = Self(self.0.map(f64::sqrt));
    }

    elementary!();

    #[inline(never)]
    fn outlined<K: LaneTask<Self>>(task: K) -> K::Output {
        task.run()
    }
}

impl Lanes for Row4 {
    const WIDTH: usize = 4;

    inlined! {
        from_fn(f: impl FnMut(usize) -> f64) -> Self = Self(std::array::from_fn(f));
        lane(self, lane: usize) -> f64 = self.0[lane];
        set(&mut self, lane: usize, value: f64) -> () = self.0[lane] = value;
        at_most(self, other: Self) -> Bits = self.where_both(other, f64::le);
        abs(self) -> Self = Self(self.0.map(f64::abs));
    }

    #[inline(always)]
    fn rotate_quadrants(quadrants: Self, mut sin: Self, mut cos: Self) -> (Self, Self) {
        for k in 0..4 {
            (sin.0[k], cos.0[k]) = f64::rotate_quadrants(quadrants.0[k], sin.0[k], cos.0[k]);
        }
        (sin, cos)
    }
}
