//! The number trait that all mechanics are written in.
//!
//! A right-hand side that is generic over [`Real`] serves one run with `f64`; SIMD lanes and dual numbers
//! implement the same trait. Products and sums that belong together are written with [`Real::mul_add`], so
//! the operations and their roundings are the same for every number type and every processor.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A set of lanes: one bit for each lane, the lowest bit for the first lane. A number of a single run has the
/// first lane only.
pub type Bits = u8;

/// Work that is compiled as a function and called instead of inlined, because several places need it or because it is
/// large.
pub trait LaneTask<R> {
    /// The result of the work.
    type Output;
    /// Does the work. It must be `#[inline(always)]`, and so must all hot code in it.
    fn run(self) -> Self::Output;
}

/// Declares a computation as a task with named fields: `[parameters of the implementation]`, the task with its fields, the
/// numbers of the lanes, the result, and the expression that computes it.
macro_rules! task {
    (
        $(#[$doc:meta])* $visible:vis [$($bounds:tt)*] $name:ident<$($of:tt),*>($($field:ident: $type:ty),*)
        for $real:ty => $output:ty = $body:expr
    ) => {
        $(#[$doc])*
        $visible struct $name<$($of),*> {
            $($visible $field: $type),*
        }

        impl<$($bounds)*> LaneTask<$real> for $name<$($of),*> {
            type Output = $output;

            #[inline(always)]
            fn run(self) -> $output {
                let Self { $($field),* } = self;
                $body
            }
        }
    };
}
pub(crate) use task;

/// Declares functions of an implementation that are inlined, each by the expression that computes it.
macro_rules! inlined {
    ($($(#[$doc:meta])* $visible:vis $name:ident($($arguments:tt)*) -> $output:ty = $body:expr;)*) => {$(
        $(#[$doc])*
        #[inline(always)]
        $visible fn $name($($arguments)*) -> $output {
            $body
        }
    )*};
}
pub(crate) use inlined;

/// Declares the four operators of numbers, each by the expression that computes it from both operands.
macro_rules! operators {
    ([$($of:tt)*] $kind:ty, |$own:ident, $other:ident| $add:expr, $sub:expr, $mul:expr, $div:expr) => {
        operators!(Add, add, [$($of)*] $kind, $own, $other => $add);
        operators!(Sub, sub, [$($of)*] $kind, $own, $other => $sub);
        operators!(Mul, mul, [$($of)*] $kind, $own, $other => $mul);
        operators!(Div, div, [$($of)*] $kind, $own, $other => $div);
    };
    ($operator:ident, $name:ident, [$($of:tt)*] $kind:ty, $own:ident, $other:ident => $body:expr) => {
        impl<$($of)*> std::ops::$operator for $kind {
            type Output = Self;

            #[inline(always)]
            fn $name(self, $other: Self) -> Self {
                let $own = self;
                $body
            }
        }
    };
}
pub(crate) use operators;

/// Numbers that take the numbers `R` as constants: these themselves, or dual numbers of them.
pub trait Lift<R>: Real {
    /// The constant.
    fn lift(value: R) -> Self;
}

impl<R: Real> Lift<R> for R {
    inlined! { lift(value: R) -> Self = value; }
}

/// Functions of one number, with parameters `P`.
pub trait Functions<P, const N: usize> {
    /// The values of the functions.
    fn at<R: Lift<P>>(&self, x: R) -> [R; N];
}

/// Numbers to which functions of one number can be applied.
pub trait Compose: Sized {
    /// The values of functions of this number.
    #[inline(always)]
    fn compose<const N: usize>(self, functions: &impl Functions<Self, N>) -> [Self; N]
    where
        Self: Real,
    {
        functions.at(self)
    }
}

/// A real number with the operations that the mechanics need.
pub trait Real:
    Compose
    + Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Whether code for contacts that are not the paper's is compiled for these numbers. Where it is not, a scene that has
    /// them takes other numbers.
    const ANY_PARTS: bool = true;
    /// The same of their dual numbers.
    const VARIED_PARTS: bool = true;
    /// The order of the derivatives that the numbers carry.
    const ORDER: usize = 0;

    /// The constant `x`.
    fn constant(x: f64) -> Self;
    /// `self * a + b`, rounded once.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Sine and cosine together.
    fn sin_cos(self) -> (Self, Self);
    /// `a` in the lanes of `bits`, `b` in all other lanes.
    fn select(bits: Bits, a: Self, b: Self) -> Self;
    /// The lanes in which `self < other`.
    fn less(self, other: Self) -> Bits;
    /// The square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// The angle whose sine and cosine have the ratio of `self` to `cos`, in the quarter that their signs say.
    fn angle(self, cos: Self) -> Self;
    /// `self` to the power `n`; zero where `self` is not positive, so that no power has a pole.
    fn power(self, n: Self) -> Self;
    /// The natural logarithm; zero where `self` is not positive.
    fn ln(self) -> Self;
    /// Calls a task. Its code exists once for these numbers, with the instructions of their lanes.
    fn outlined<K: LaneTask<Self>>(task: K) -> K::Output;

    inlined! {
        /// Zero.
        zero() -> Self = Self::constant(0.0);
        /// The larger of `self` and zero.
        positive_part(self) -> Self = Self::select(Self::zero().less(self), self, Self::zero());
        /// `b - self * a`, rounded once.
        neg_mul_add(self, a: Self, b: Self) -> Self = (-self).mul_add(a, b);
        /// `self * b + a * c`. The product `a * c` is rounded; `self * b` is exact and rounded once with the sum.
        dot2(self, b: Self, a: Self, c: Self) -> Self = self.mul_add(b, a * c);
    }
}

/// `s_i x` with s_1 = -1 (right finger, index 0) and s_2 = +1 (left finger, index 1): the paper's (-1)^i.
#[inline(always)]
pub fn signed<R: Real>(i: usize, x: R) -> R {
    if i == 0 { -x } else { x }
}

/// The scalar product of two vectors with the components x, y and rotation.
#[inline(always)]
pub fn dot<R: Real>(a: &[R; 3], b: &[R; 3]) -> R {
    a[2].mul_add(b[2], a[0].dot2(b[0], a[1], b[1]))
}
