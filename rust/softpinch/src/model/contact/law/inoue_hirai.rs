//! The paper's law (5): linear springs, all parallel to the finger, in a hemisphere.

use super::ElasticGradient;
use crate::model::Source;
use crate::number::Real;

#[derive(Debug, Clone, Copy)]
pub struct InoueHirai<R> {
    /// Stiffness pi E.
    stiffness: R,
    /// Coupling kappa of shear and tilt in (5).
    coupling: R,
}

impl<R: Real> InoueHirai<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            stiffness: R::constant(std::f64::consts::PI) * source.number(|p| p.tips[i].youngs_modulus),
            coupling: source.number(|p| p.tips[i].tilt_coupling),
        }
    }

    /// The term of one tip in (5): pi E { d_n^3 / (3 cos^2) + kappa d_n^2 d_t tan + d_n d_t^2 }.
    #[inline(always)]
    pub(super) fn energy(&self, [sin_tilt, cos_tilt, d_n, d_t]: [R; 4]) -> R {
        let secant = R::constant(1.0) / cos_tilt;
        let tangent = sin_tilt * secant;
        let compression = d_n * secant;
        let cubic = compression * compression * d_n * R::constant(1.0 / 3.0);
        let mixed = self.coupling * d_n * d_n * d_t * tangent;
        self.stiffness * (cubic + (mixed + d_n * d_t * d_t))
    }

    /// The gradient of the energy in theta_p, d_n and d_t.
    #[inline(always)]
    pub(super) fn gradient(&self, [sin_tilt, cos_tilt, d_n, d_t]: [R; 4]) -> ElasticGradient<R> {
        let secant = R::constant(1.0) / cos_tilt;
        let tangent = sin_tilt * secant;
        // pi d_n^2 / cos^2 is the area that (3) integrates over. `area` is this area times E.
        let compressed = d_n * secant;
        let area = (self.stiffness * compressed) * compressed;
        let slope = self.coupling * tangent;
        let two = R::constant(2.0);
        let (stiff_n, stiff_t) = (self.stiffness * d_n, self.stiffness * d_t);
        ElasticGradient {
            tilt: area * (R::constant(2.0 / 3.0) * d_n).dot2(tangent, self.coupling, d_t),
            normal: stiff_t.mul_add((two * d_n).mul_add(slope, d_t), area),
            tangential: stiff_n * d_n.dot2(slope, two, d_t),
        }
    }
}
