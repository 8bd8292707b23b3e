//! Several runs side by side: a vector register holds one number of each run, and each run has its own lane.
//!
//! [`Lanes`] are [`Real`] numbers whose lanes can be read, set and compared one by one. A single run has one
//! lane, which is `f64` itself (`scalar.rs`); the vectors of the processor are in `simd/x86.rs`. Code that is
//! written in terms of [`Lanes`] gives each lane the bits that its run would have alone.

use crate::number::{Bits, Real, inlined};

/// The largest width of any [`Lanes`].
pub const MOST: usize = 8;

/// The lanes of a set in ascending order.
#[inline(always)]
pub fn each(mut bits: Bits) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = (bits != 0).then(|| bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        lane
    })
}

/// A vector of real numbers, one for each run.
pub trait Lanes: Real {
    /// The number of lanes, at most `MOST`.
    const WIDTH: usize;
    /// The set of all lanes.
    const ALL: Bits = if Self::WIDTH == MOST { Bits::MAX } else { (1 << Self::WIDTH) - 1 };

    /// Makes a vector from a function of the lane.
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self;
    /// The number in one lane.
    fn lane(self, lane: usize) -> f64;
    /// Sets the number in one lane.
    fn set(&mut self, lane: usize, value: f64);
    /// The lanes in which `self <= other`.
    fn at_most(self, other: Self) -> Bits;
    /// |self|.
    fn abs(self) -> Self;
    /// Sine and cosine of an angle that consists of a number of quarter turns and a remainder. `sin` and
    /// `cos` are those of the remainder; the lowest bits of `quadrants` hold the number of quarter turns.
    fn rotate_quadrants(quadrants: Self, sin: Self, cos: Self) -> (Self, Self);

    inlined! {
        /// The lanes in which the number is zero, of either sign. NaN is not zero.
        is_zero(self) -> Bits = self.abs().at_most(Self::zero());
        /// The larger of `self` and `other` in the lanes of `bits`; `self` in all other lanes, and where either is NaN.
        max_in(self, other: Self, bits: Bits) -> Self = Self::select(self.less(other) & bits, other, self);
        /// The smaller of `self` and `other` in the lanes of `bits`; `self` in all other lanes, and where either is NaN.
        min_in(self, other: Self, bits: Bits) -> Self = Self::select(other.less(self) & bits, other, self);
    }
}
