//! Several runs side by side: one number of each in a vector register.
//!
//! [`Lanes`] are [`Real`] numbers that can be taken apart and compared lane by lane. One run is one lane, `f64` itself (`scalar.rs`); the
//! vectors of the processor are in `simd/x86.rs`. What is written in terms of [`Lanes`] gives each lane the bits that it would have alone.

use crate::number::real::Real;
use crate::number::simd::level::Instructions;

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
