//! Portable lanes, for processors other than x86-64 and for tests.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::number::lanes::{Bits, Lanes};
use crate::number::real::Real;
use crate::number::trigonometry;

/// Four lanes in an array, for any processor. The compiler chooses the vector instructions.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub struct Row4([f64; 4]);

macro_rules! row_operator {
    ($($operator:ident, $name:ident;)*) => {$(
        impl $operator for Row4 {
            type Output = Self;
            #[inline(always)]
            fn $name(mut self, other: Self) -> Self {
                for k in 0..4 {
                    self.0[k] = self.0[k].$name(other.0[k]);
                }
                self
            }
        }
    )*};
}
row_operator! { Add, add; Sub, sub; Mul, mul; Div, div; }

impl Neg for Row4 {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        for k in 0..4 {
            self.0[k] = -self.0[k];
        }
        self
    }
}

impl Real for Row4 {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self([x; 4])
    }

    #[inline(always)]
    fn mul_add(mut self, a: Self, b: Self) -> Self {
        for k in 0..4 {
            self.0[k] = self.0[k].mul_add(a.0[k], b.0[k]);
        }
        self
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        trigonometry::sin_cos(self)
    }

    #[inline(always)]
    fn select(bits: Bits, a: Self, mut b: Self) -> Self {
        for k in 0..4 {
            b.0[k] = if bits >> k & 1 != 0 { a.0[k] } else { b.0[k] };
        }
        b
    }
}

impl Lanes for Row4 {
    const WIDTH: usize = 4;

    #[inline(always)]
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self {
        Self(std::array::from_fn(f))
    }

    #[inline(always)]
    fn lane(self, lane: usize) -> f64 {
        self.0[lane]
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, value: f64) {
        self.0[lane] = value;
    }

    #[inline(always)]
    fn less(self, other: Self) -> Bits {
        let mut bits = 0;
        for k in 0..4 {
            bits |= Bits::from(self.0[k] < other.0[k]) << k;
        }
        bits
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> Bits {
        let mut bits = 0;
        for k in 0..4 {
            bits |= Bits::from(self.0[k] <= other.0[k]) << k;
        }
        bits
    }

    #[inline(always)]
    fn abs(mut self) -> Self {
        for k in 0..4 {
            self.0[k] = self.0[k].abs();
        }
        self
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for k in 0..4 {
            self.0[k] = self.0[k].sqrt();
        }
        self
    }

    #[inline(always)]
    fn rotate_quadrants(quadrants: Self, mut sin: Self, mut cos: Self) -> (Self, Self) {
        for k in 0..4 {
            (sin.0[k], cos.0[k]) = f64::rotate_quadrants(quadrants.0[k], sin.0[k], cos.0[k]);
        }
        (sin, cos)
    }
}
