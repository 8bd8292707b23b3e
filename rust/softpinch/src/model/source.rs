//! The parameters from which the kernel takes its numbers.

use crate::model::parameters::Parameters;
use crate::number::dual::Dual;
use crate::number::lanes::{Lanes, Lift, MOST};
use crate::number::real::Real;

/// A source of the kernel's numbers: the parameters of one run, or those of one run for each lane.
pub trait Source<R> {
    /// A number that is a linear function of the parameters, without a constant, so that its derivative is the
    /// same function of the parameters' derivatives.
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

/// The parameters of one run for each lane, as dual numbers with zero derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Duals<'a>(pub &'a [&'a Parameters; MOST]);

impl<R: Lanes, const W: usize> Source<Dual<R, W>> for Duals<'_> {
    #[inline(always)]
    fn number(&self, of: impl Fn(&Parameters) -> f64) -> Dual<R, W> {
        Dual::lift(self.0.number(of))
    }
}

/// The parameters of one run, with their derivatives in `W` directions.
#[derive(Debug, Clone)]
pub struct VariedParameters<'a, const W: usize> {
    /// The parameters.
    pub parameters: &'a Parameters,
    /// Their derivatives.
    pub slopes: [Parameters; W],
}

impl<const W: usize> Source<Dual<f64, W>> for VariedParameters<'_, W> {
    #[inline(always)]
    fn number(&self, of: impl Fn(&Parameters) -> f64) -> Dual<f64, W> {
        Dual { value: of(self.parameters), slope: std::array::from_fn(|k| of(&self.slopes[k])) }
    }
}

/// The same numbers as constants in one more direction.
impl<const W: usize> Source<Dual<Dual<f64, W>, 1>> for VariedParameters<'_, W> {
    #[inline(always)]
    fn number(&self, of: impl Fn(&Parameters) -> f64) -> Dual<Dual<f64, W>, 1> {
        Dual::lift(Source::<Dual<f64, W>>::number(self, of))
    }
}
