//! The parameters from which the kernel takes its numbers.

use crate::model::Parameters;
use crate::number::{Dual, Lanes, Lift, MOST, Real, inlined};

/// A source of the kernel's numbers: the parameters of one run, or those of one run for each lane.
pub trait Source<R> {
    /// A number that is a linear function of the parameters, without a constant, so that its derivative is the
    /// same function of the parameters' derivatives.
    fn number(&self, of: impl Fn(&Parameters) -> f64) -> R;

    /// Parameters that have the kinds of the parts, which are the same for all lanes.
    fn kinds(&self) -> &Parameters;
}

impl<R: Real> Source<R> for Parameters {
    inlined! {
        number(&self, of: impl Fn(&Parameters) -> f64) -> R = R::constant(of(self));
        kinds(&self) -> &Parameters = self;
    }
}

impl<R: Lanes> Source<R> for [&Parameters; MOST] {
    inlined! {
        number(&self, of: impl Fn(&Parameters) -> f64) -> R = R::from_fn(|lane| of(self[lane]));
        kinds(&self) -> &Parameters = self[0];
    }
}

/// Number of directions in which a run is differentiated at once.
pub const DIRECTIONS: usize = 4;

/// The parameters of one run, with their derivatives in several directions.
#[derive(Debug, Clone)]
pub struct VariedParameters<'a> {
    pub parameters: &'a Parameters,
    pub slopes: [Parameters; DIRECTIONS],
}

impl VariedParameters<'_> {
    /// Inlined into all that needs a number, it would take 28 KB more (measured).
    #[inline(never)]
    fn varied<R: Lanes>(&self, of: &dyn Fn(&Parameters) -> f64) -> Dual<R, 1> {
        Dual::varied(of(self.parameters), &self.slopes.each_ref().map(of))
    }
}

impl<R: Lanes> Source<Dual<R, 1>> for VariedParameters<'_> {
    inlined! {
        number(&self, of: impl Fn(&Parameters) -> f64) -> Dual<R, 1> = self.varied(&of);
        kinds(&self) -> &Parameters = self.parameters;
    }
}

/// The numbers of another source as constants in one more direction.
pub struct Constants<'a, S>(pub &'a S);

impl<R: Lanes, S: Source<R>, const W: usize> Source<Dual<R, W>> for Constants<'_, S>
where
    Dual<R, W>: Lift<R>,
{
    inlined! {
        number(&self, of: impl Fn(&Parameters) -> f64) -> Dual<R, W> = Dual::lift(self.0.number(of));
        kinds(&self) -> &Parameters = self.0.kinds();
    }
}
