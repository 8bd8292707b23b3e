//! Where the kernel's numbers come from.

use crate::model::parameters::Parameters;
use crate::number::dual::Dual;
use crate::number::lanes::{Lanes, Lift, MOST};
use crate::number::real::Real;

/// Where the kernel's numbers come from: the parameters of one run, or those of a run for each lane.
pub trait Source<R> {
    /// A number that follows from parameters.
    fn number(&self, of: impl Fn(&Parameters) -> f64) -> R;
}

impl<R: Real> Source<R> for Parameters {
    #[inline(always)]
    fn number(&self, of: impl Fn(&Parameters) -> f64) -> R {
        R::constant(of(self))
    }
}

impl<R: Lanes> Source<R> for [&Parameters; MOST] {
    #[inline(always)]
    fn number(&self, of: impl Fn(&Parameters) -> f64) -> R {
        R::from_fn(|lane| of(self[lane]))
    }
}

/// The parameters of a run for each lane, as the values of dual numbers.
#[derive(Debug, Clone, Copy)]
pub struct Duals<'a>(pub &'a [&'a Parameters; MOST]);

impl<R: Lanes, const W: usize> Source<Dual<R, W>> for Duals<'_> {
    #[inline(always)]
    fn number(&self, of: impl Fn(&Parameters) -> f64) -> Dual<R, W> {
        Dual::lift(self.0.number(of))
    }
}
