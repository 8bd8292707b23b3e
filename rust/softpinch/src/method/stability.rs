//! The stability functions of the methods, and the longest step with which the mode of an eigenvalue does not
//! grow.

use nalgebra::Complex;

use crate::method::dop853;
use crate::method::table::Method;

/// The steps in |z| by which the edge of a stability region is searched along a ray.
const STRIDE: f64 = 0.01;
/// Beyond this |z| every explicit method of the crate is outside of its stability region.
const OUTSIDE: f64 = 10.0;
/// If |R| exceeds one by no more than this, that is round-off: R is a sum of terms up to 10^5 in size.
const ROUND_OFF: f64 = 1e-10;

impl Method {
    /// R(z): the factor by which a step of length h multiplies a mode of eigenvalue z / h.
    pub fn stability_function(self, z: Complex<f64>) -> Complex<f64> {
        let one = Complex::new(1.0, 0.0);
        match self {
            Self::Rk4 => one + z * (one + z / 2.0 * (one + z / 3.0 * (one + z / 4.0))),
            Self::Dop853 => dop853::stability_function(z),
            Self::ImplicitMidpoint => (one + z / 2.0) / (one - z / 2.0),
            // Hairer and Wanner IV.5, (5.18): the Pade approximation (2, 3).
            Self::Radau5 => {
                (one + z * 0.4 + z * z / 20.0) / (one - z * 0.6 + z * z * 0.15 - z * z * z / 60.0)
            }
            // Hairer and Wanner IV.7: a polynomial over (1 - gamma z)^6, of degree five because of
            // L-stability. Order four determines its first five coefficients, which are those of
            // e^z (1 - z/4)^6. The last one comes from the tableau.
            Self::Rosenbrock => {
                const TOP: [f64; 6] = [1.0, -1.0 / 2.0, -1.0 / 16.0, 1.0 / 24.0, 5.0 / 768.0, -7.0 / 3072.0];
                let top = TOP.iter().rev().fold(Complex::new(0.0, 0.0), |sum, c| sum * z + c);
                top / (one - z / 4.0).powi(6)
            }
        }
    }

    /// The longest step with which a mode of this eigenvalue does not grow: there the ray through the
    /// eigenvalue first leaves the region |R| <= 1. The step is infinite for a method that is stable in the
    /// whole left half-plane. It is infinite for an eigenvalue in the right half-plane too, because a mode
    /// that grows by itself limits no step.
    pub fn longest_stable_step(self, rate: Complex<f64>) -> f64 {
        let size = rate.norm();
        if self.entry().real_stability_limit.is_none() || size == 0.0 || rate.re > 0.0 {
            return f64::INFINITY;
        }
        let direction = rate / size;
        // Overflow counts as growth.
        let grows = |r: f64| {
            let growth = self.stability_function(direction * r).norm();
            growth > 1.0 + ROUND_OFF || growth.is_nan()
        };
        let mut inside = 0.0;
        while inside < OUTSIDE && !grows(inside + STRIDE) {
            inside += STRIDE;
        }
        let mut outside = inside + STRIDE;
        for _ in 0..30 {
            let middle = 0.5 * (inside + outside);
            if grows(middle) { outside = middle } else { inside = middle }
        }
        inside / size
    }
}
