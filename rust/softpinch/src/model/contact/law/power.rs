//! A tip whose force on an upright face is F = c d_n^n, as springs of growing density have it.
//!
//! Springs at the depth z below the apex have the density F''(z), and each is compressed by d_n - z. As in (4) they are
//! parallel to the finger and linear, so that with Phi = c d_n^(n+1) / (n+1), the integral of F,
//! P = Phi / cos^2 + kappa F d_t tan + F' d_t^2 / 2. For n = 2 and c = pi E this is (5).

use super::{ElasticGradient, TipLaw};
use crate::error::Error;
use crate::model::rule::Rule;
use crate::model::source::Source;
use crate::number::real::Real;

/// The constants of a power law. Its exponent is a whole number: no kind of numbers has another power.
#[derive(Debug, Clone, Copy)]
pub struct Power<R> {
    coefficient: R,
    exponent: u32,
    coupling: R,
}

/// The coefficient c of a power law; 0 of other laws, as the derivatives of parameters have it.
fn coefficient(law: &TipLaw) -> f64 {
    if let TipLaw::Power { coefficient, .. } = *law { coefficient } else { 0.0 }
}

/// The force of the upright tip, its integral and its first two derivatives.
struct Curve<R> {
    integral: R,
    force: R,
    slope: R,
    bend: R,
}

/// Refuses a coefficient that is not positive, and an exponent below 2, with which the shear's stiffness has a pole at
/// d_n = 0.
pub(super) fn check(coefficient: f64, exponent: u32, side: &str) -> Result<(), Error> {
    let field = |name: &str| format!("hand.tip.{side}.law.{name}");
    Rule::Positive.check(field("coefficient"), coefficient)?;
    if exponent >= 2 {
        return Ok(());
    }
    Err(Error::Field { field: field("exponent"), value: f64::from(exponent), rule: "must be at least 2" })
}

/// The modulus E for which 2 pi E a, the stiffness of (5) at d_n = a, is that of F = c d_n^n.
pub(super) fn equal_modulus(coefficient: f64, exponent: u32, radius: f64) -> f64 {
    let mut slope = f64::from(exponent) * coefficient;
    for _ in 1..exponent {
        slope *= radius;
    }
    slope / (2.0 * std::f64::consts::PI * radius)
}

impl<R: Real> Power<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize, exponent: u32) -> Self {
        Self {
            coefficient: source.number(|p| coefficient(&p.laws[i])),
            exponent,
            coupling: source.number(|p| p.tips[i].tilt_coupling),
        }
    }

    #[inline(always)]
    fn curve(&self, d_n: R) -> Curve<R> {
        let n = f64::from(self.exponent);
        let mut bend = self.coefficient * R::constant(n * (n - 1.0));
        for _ in 2..self.exponent {
            bend = bend * d_n;
        }
        let slope = bend * d_n * R::constant(1.0 / (n - 1.0));
        let force = slope * d_n * R::constant(1.0 / n);
        Curve { integral: force * d_n * R::constant(1.0 / (n + 1.0)), force, slope, bend }
    }

    /// The elastic energy P.
    #[inline(always)]
    pub(super) fn energy(&self, sin_tilt: R, cos_tilt: R, d_n: R, d_t: R) -> R {
        let secant = R::constant(1.0) / cos_tilt;
        let Curve { integral, force, slope, .. } = self.curve(d_n);
        let mixed = self.coupling * force * d_t * (sin_tilt * secant);
        integral * secant * secant + (mixed + R::constant(0.5) * slope * d_t * d_t)
    }

    /// The gradient of the energy in theta_p, d_n and d_t.
    #[inline(always)]
    pub(super) fn gradient(&self, sin_tilt: R, cos_tilt: R, d_n: R, d_t: R) -> ElasticGradient<R> {
        let secant = R::constant(1.0) / cos_tilt;
        let tangent = sin_tilt * secant;
        let square = secant * secant;
        let Curve { integral, force, slope, bend } = self.curve(d_n);
        let half = R::constant(0.5) * d_t;
        let lean = self.coupling * tangent;
        ElasticGradient {
            tilt: square * (R::constant(2.0) * integral).dot2(tangent, self.coupling * force, d_t),
            normal: force.mul_add(square, d_t * slope.dot2(lean, bend, half)),
            tangential: force.dot2(lean, slope, d_t),
        }
    }
}
