//! Laws of the tip: its elastic energy P as a function of theta_p, d_n and d_t.
//!
//! A new law is a file in `law/` with the functions `energy` and `gradient`, an entry of [`Law`] and one of [`TipLaw`].
//! The power law is compiled for the tests only: they show by it that a law can be another one.

mod inoue_hirai;
#[cfg(test)]
mod power;

pub use inoue_hirai::InoueHirai;
#[cfg(test)]
pub use power::Power;

use crate::error::Error;
use crate::model::parameters::Fingertip;
use crate::model::source::Source;
use crate::number::real::Real;

/// The law of a tip, with the numbers that only this law has.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum TipLaw {
    /// Parallel linear springs in a hemisphere (5): the paper's, with the modulus of the fingertip.
    #[default]
    InoueHirai,
    /// A force F = c d_n^n of the upright tip. The fingertip's modulus takes no part.
    #[cfg(test)]
    Power {
        /// c, N/m^n.
        coefficient: f64,
        /// n, at least 2.
        exponent: u32,
    },
}

impl TipLaw {
    /// Refuses numbers with which the law is none.
    #[cfg_attr(not(test), expect(unused_variables, reason = "the paper's law has no numbers of its own"))]
    pub fn check(&self, side: &str) -> Result<(), Error> {
        match self {
            Self::InoueHirai => Ok(()),
            #[cfg(test)]
            Self::Power { coefficient, exponent } => power::check(*coefficient, *exponent, side),
        }
    }

    /// The modulus E with which (5) is as stiff at full compression as this law, Pa.
    pub fn modulus(&self, tip: &Fingertip) -> f64 {
        match *self {
            Self::InoueHirai => tip.youngs_modulus,
            #[cfg(test)]
            Self::Power { coefficient, exponent } => power::equal_modulus(coefficient, exponent, tip.radius),
        }
    }
}

/// The gradient of one tip's elastic energy.
#[derive(Debug, Clone, Copy)]
pub struct ElasticGradient<R> {
    /// dP/d theta_p, N m.
    pub tilt: R,
    /// dP/d d_n, N.
    pub normal: R,
    /// dP/d d_t, N.
    pub tangential: R,
}

/// The law of one tip.
#[derive(Debug, Clone, Copy)]
pub enum Law<R> {
    /// (5).
    InoueHirai(InoueHirai<R>),
    /// A power of the compression.
    #[cfg(test)]
    Power(Power<R>),
}

impl<R: Real> Law<R> {
    #[inline(always)]
    fn new(source: &impl Source<R>, i: usize) -> Self {
        match source.kinds().laws[i] {
            TipLaw::InoueHirai => Self::InoueHirai(InoueHirai::new(source, i)),
            #[cfg(test)]
            TipLaw::Power { exponent, .. } => Self::Power(Power::new(source, i, exponent)),
        }
    }
}

/// The elastic and viscous constants of one tip.
#[derive(Debug, Clone, Copy)]
pub struct Tip<R> {
    law: Law<R>,
    /// Normal viscosity c_n.
    pub normal_viscosity: R,
    /// Tangential viscosity c_t.
    pub tangential_viscosity: R,
}

impl<R: Real> Tip<R> {
    /// The constants of the tip of finger `i`.
    #[inline(always)]
    pub fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            law: Law::new(source, i),
            normal_viscosity: source.number(|p| p.tips[i].normal_viscosity),
            tangential_viscosity: source.number(|p| p.tips[i].tangential_viscosity),
        }
    }

    /// The elastic energy, J.
    #[inline(always)]
    pub fn energy(&self, sin_tilt: R, cos_tilt: R, d_n: R, d_t: R) -> R {
        match &self.law {
            Law::InoueHirai(law) => law.energy(sin_tilt, cos_tilt, d_n, d_t),
            #[cfg(test)]
            Law::Power(law) => law.energy(sin_tilt, cos_tilt, d_n, d_t),
        }
    }

    /// The gradient of [`Tip::energy`] in theta_p, d_n and d_t.
    #[inline(always)]
    pub fn gradient(&self, sin_tilt: R, cos_tilt: R, d_n: R, d_t: R) -> ElasticGradient<R> {
        match &self.law {
            Law::InoueHirai(law) => law.gradient(sin_tilt, cos_tilt, d_n, d_t),
            #[cfg(test)]
            Law::Power(law) => law.gradient(sin_tilt, cos_tilt, d_n, d_t),
        }
    }
}
