//! The longest step of a method with which the mode of an eigenvalue does not grow.

use nalgebra::Complex;

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
        (self.entry().stability_function)(z)
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
            let growth = self.stability_function(direction * r).norm_sqr();
            growth > 1.0 + 2.0 * ROUND_OFF || growth.is_nan()
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
