//! Several runs side by side: one number of each in a vector register.
//!
//! [`Lanes`] are [`Real`] numbers that can be taken apart and compared lane by lane. One run is one lane, `f64` itself; the
//! vectors of the processor are in `simd.rs`. What is written in terms of [`Lanes`] gives each lane the bits that it would have alone.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::real::Real;
use crate::simd::{Instructions, call_alone};
use crate::trigonometry;

/// One bit a lane, the first lane's lowest.
pub type Bits = u8;

/// Most lanes that any [`Lanes`] have.
pub const MOST: usize = 8;

/// The lanes of a set, in order.
#[inline(always)]
pub fn each(mut bits: Bits) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = (bits != 0).then(|| bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        lane
    })
}

/// Work in lanes that is called, not inlined: what several places do, or what is large.
pub trait LaneTask<R> {
    /// What the work gives.
    type Output;
    /// Does the work; `#[inline(always)]`, as all that is hot in it.
    fn run(self) -> Self::Output;
}

/// Real numbers, one of each run.
pub trait Lanes: Real {
    /// How many, at most [`MOST`].
    const WIDTH: usize;
    /// All of them.
    const ALL: Bits = if Self::WIDTH == MOST { Bits::MAX } else { (1 << Self::WIDTH) - 1 };

    /// Lane by lane.
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self;
    /// The number of one lane.
    fn lane(self, lane: usize) -> f64;
    /// Sets the number of one lane.
    fn set(&mut self, lane: usize, value: f64);
    /// Where `self < other`.
    fn less(self, other: Self) -> Bits;
    /// Where `self <= other`.
    fn at_most(self, other: Self) -> Bits;
    /// `a` where the bits are set, else `b`.
    fn select(bits: Bits, a: Self, b: Self) -> Self;
    /// |self|.
    fn abs(self) -> Self;
    /// The square root, rounded once.
    fn sqrt(self) -> Self;
    /// sin and cos of an angle from those of its rest by quarter turns, whose number is in the lowest bits of `turns`.
    fn turned(turns: Self, sin: Self, cos: Self) -> (Self, Self);

    /// Calls a task, whose code is then there once, with the instructions of these lanes.
    #[inline(never)]
    fn call<K: LaneTask<Self>>(instructions: Instructions, task: K) -> K::Output {
        let _ = instructions;
        task.run()
    }

    /// Where the number is zero, of either sign; nowhere for NaN.
    #[inline(always)]
    fn vanishes(self) -> Bits {
        self.abs().at_most(Self::zero())
    }

    /// The larger one of both where `bits` are set and `other` is a number; else self.
    #[inline(always)]
    fn raised(self, other: Self, bits: Bits) -> Self {
        Self::select(self.less(other) & bits, other, self)
    }

    /// The smaller one of both where `bits` are set and `other` is a number; else self.
    #[inline(always)]
    fn lowered(self, other: Self, bits: Bits) -> Self {
        Self::select(other.less(self) & bits, other, self)
    }
}

/// Numbers that are made of lanes: lanes themselves, or duals of them.
pub trait Lift<R: Lanes>: Real {
    /// The constants in the lanes.
    fn lift(value: R) -> Self;
    /// `a` in the lanes whose bits are set, else `b`.
    fn where_lifted(bits: Bits, a: Self, b: Self) -> Self;
}

impl<R: Lanes> Lift<R> for R {
    #[inline(always)]
    fn lift(value: R) -> Self {
        value
    }

    #[inline(always)]
    fn where_lifted(bits: Bits, a: Self, b: Self) -> Self {
        R::select(bits, a, b)
    }
}

impl Lanes for f64 {
    const WIDTH: usize = 1;

    #[inline(always)]
    fn call<K: LaneTask<Self>>(instructions: Instructions, task: K) -> K::Output {
        call_alone(instructions, task)
    }

    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        f(0)
    }

    #[inline(always)]
    fn lane(self, _: usize) -> f64 {
        self
    }

    #[inline(always)]
    fn set(&mut self, _: usize, value: f64) {
        *self = value;
    }

    #[inline(always)]
    fn less(self, other: Self) -> Bits {
        Bits::from(self < other)
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> Bits {
        Bits::from(self <= other)
    }

    #[inline(always)]
    fn select(bits: Bits, a: Self, b: Self) -> Self {
        if bits & 1 != 0 { a } else { b }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn turned(turns: Self, sin: Self, cos: Self) -> (Self, Self) {
        let quadrant = turns.to_bits();
        let (s, c) = if quadrant & 1 == 0 { (sin, cos) } else { (cos, sin) };
        let sin_sign = (quadrant & 2) << 62;
        let cos_sign = ((quadrant + 1) & 2) << 62;
        (f64::from_bits(s.to_bits() ^ sin_sign), f64::from_bits(c.to_bits() ^ cos_sign))
    }
}

/// Lanes for any processor: what its compiler makes of four numbers in a row.
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
    fn select(bits: Bits, a: Self, mut b: Self) -> Self {
        for k in 0..4 {
            b.0[k] = if bits >> k & 1 != 0 { a.0[k] } else { b.0[k] };
        }
        b
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
    fn turned(turns: Self, mut sin: Self, mut cos: Self) -> (Self, Self) {
        for k in 0..4 {
            (sin.0[k], cos.0[k]) = f64::turned(turns.0[k], sin.0[k], cos.0[k]);
        }
        (sin, cos)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::{Each, Lu, MOST_ROWS};
    use crate::simd::{LEVELS, LaneKernel, dispatch_lanes};

    /// Numbers of all sizes, among them angles that are wild and what is no number.
    fn numbers(k: usize) -> f64 {
        const ODD: [f64; 8] = [0.0, -0.0, 1e-310, 3e8, -1e22, f64::INFINITY, f64::NAN, 1.0];
        let u = libm::sin(12.9898 * k as f64) * 43_758.547;
        if k % 7 == 3 { ODD[k / 7 % 8] } else { u * libm::pow(10.0, (k % 11) as f64 - 5.0) }
    }

    /// Everything that lanes do, of three numbers.
    fn everything<R: Lanes>(a: R, b: R, c: R) -> [R; 12] {
        let (sin, cos) = a.sin_cos();
        [
            a.mul_add(b, c),
            a.neg_mul_add(b, c),
            a / b,
            (a + b) * (b - c),
            -a,
            a.abs().sqrt(),
            sin,
            cos,
            a.raised(b, R::ALL),
            a.lowered(b, R::ALL),
            R::select(a.less(b), b, c),
            R::select(a.at_most(b) | a.vanishes(), b, c),
        ]
    }

    fn same(a: f64, b: f64) -> bool {
        a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
    }

    /// Compares each lane with what `f64` gives.
    struct Compare;

    impl LaneKernel for Compare {
        type Output = usize;

        #[inline(always)]
        fn run<R: Lanes>(self, _: Instructions) -> usize {
            for start in 0..500 {
                let at = |shift: usize| move |lane: usize| numbers(3 * (start + lane) + shift);
                let (a, b, c) = (at(0), at(1), at(2));
                let together = everything(R::from_fn(a), R::from_fn(b), R::from_fn(c));
                for lane in 0..R::WIDTH {
                    let alone = everything(a(lane), b(lane), c(lane));
                    for (number, (ours, theirs)) in together.iter().zip(alone).enumerate() {
                        assert!(same(ours.lane(lane), theirs), "{number}: {} {theirs}", ours.lane(lane));
                    }
                }
            }
            let entry =
                |r: usize, c: usize| move |lane: usize| libm::sin((1 + 9 * r + c + 100 * lane) as f64);
            let matrix: [[Each<R>; 9]; 9] =
                std::array::from_fn(|r| std::array::from_fn(|c| Each(R::from_fn(entry(r, c)))));
            let load: [Each<R>; 9] = std::array::from_fn(|r| Each(R::from_fn(entry(r, 9))));
            let together = Lu::new(MOST_ROWS, matrix).solve(MOST_ROWS, &load);
            for lane in 0..R::WIDTH {
                let matrix: [[f64; 9]; 9] =
                    std::array::from_fn(|r| std::array::from_fn(|c| entry(r, c)(lane)));
                let load = std::array::from_fn(|r| entry(r, 9)(lane));
                let alone = Lu::new(MOST_ROWS, matrix).solve(MOST_ROWS, &load);
                for (ours, theirs) in together.iter().zip(alone) {
                    assert_eq!(ours.0.lane(lane).to_bits(), theirs.to_bits());
                }
            }
            R::WIDTH
        }
    }

    #[test]
    fn every_lane_is_what_it_is_alone() {
        for (_, level) in LEVELS {
            match dispatch_lanes(level, Compare) {
                Ok(width) => {
                    assert_eq!(Compare.run::<Row4>(level.require().expect("just done")), 4);
                    assert!([4, 8].contains(&width));
                }
                Err(error) => assert_eq!(level.require().err(), Some(error)),
            }
        }
    }

    #[test]
    fn the_lanes_of_a_set_come_in_order() {
        assert_eq!(each(0b1010_0110).collect::<Vec<_>>(), [1, 2, 5, 7]);
        assert_eq!(each(0).count(), 0);
    }
}
