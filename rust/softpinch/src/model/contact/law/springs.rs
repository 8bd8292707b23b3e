//! Springs as (4) has them, whose force on an upright face is a given curve F(d).
//!
//! Springs at the depth z below the apex have the density F''(z), and each is compressed by d_n - z. As in (4) they are
//! parallel to the finger and linear, so that with Phi, the integral of F,
//! P = chi {Phi / cos^2 + kappa F d_t tan + eta F' d_t^2 / 2}. F = pi E d^2 is (5). chi is the share of (4) that is left on
//! a curved side, and eta, one in (4), makes the springs softer or stiffer in shear.

use super::relaxation::Branches;
use super::{ElasticGradient, Force, LawKind};
use crate::model::{Counterface, ShapeKind, Source};
use crate::number::{Functions, LaneTask, Lift, Real, task};

/// The force of the upright tip, its integral and its first two derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Curve<R> {
    /// Phi, J.
    pub integral: R,
    /// F, N.
    pub force: R,
    /// F', N/m.
    pub slope: R,
    /// F'', N/m^2.
    pub bend: R,
}

impl<R: Real> Curve<R> {
    /// That of F = c d^2.
    #[inline(always)]
    pub(super) fn square(c: R, d: R) -> Self {
        let stretched = c * d;
        let (force, two) = (stretched * d, R::constant(2.0));
        Self { integral: force * d * R::constant(1.0 / 3.0), force, slope: two * stretched, bend: two * c }
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Springs<R> {
    force: Force<R>,
    pub(super) branches: Branches<R>,
    /// chi.
    pub(super) share: R,
    /// kappa.
    coupling: R,
    /// eta.
    pub(super) shear_factor: R,
}

task! {
    ['a, R: Real] CurveAt<'a, R>(law: &'a Springs<R>, d: R) for R => Curve<R> = law.curve(d)
}

impl<R: Real> Springs<R> {
    /// [`Springs::curve`] in code that is called.
    #[inline(always)]
    pub(super) fn curve_called(&self, d: R) -> Curve<R> {
        R::outlined(CurveAt { law: self, d })
    }

    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        let (kinds, one) = (source.kinds(), R::constant(1.0));
        let mut share = one;
        if kinds.shape(i) == ShapeKind::Arc {
            let radius = source.number(|p| p.shapes[i].radius);
            let ratio = radius / source.number(|p| p.tips[i].radius + p.shapes[i].radius);
            share = match kinds.counterface(i) {
                Counterface::Flat => one,
                Counterface::Cylinder => ratio.sqrt(),
                Counterface::Sphere => ratio,
            };
        }
        let given = kinds.law(i) != LawKind::ParallelSprings;
        let shear_factor = if given { source.number(|p| p.laws[i].shear_factor) } else { one };
        let force = Force::new(source, i);
        let (branches, coupling) = (Branches::new(source, i), source.number(|p| p.tips[i].tilt_coupling));
        Self { force, branches, share, coupling, shear_factor }
    }

    /// The curve at a compression.
    #[inline(always)]
    pub(super) fn curve(&self, d: R) -> Curve<R> {
        let [integral, force, slope, bend] = d.compose(self);
        Curve { integral, force, slope, bend }
    }

    /// The elastic energy P and its gradient in theta_p, d_n and d_t, for sin theta_p, cos theta_p, d_n and d_t.
    #[inline(always)]
    pub(super) fn elastic(&self, [sin_tilt, cos_tilt, d_n, d_t]: [R; 4]) -> (R, ElasticGradient<R>) {
        let secant = R::constant(1.0) / cos_tilt;
        let tangent = sin_tilt * secant;
        let square = secant * secant;
        let Curve { integral, force, slope, bend } =
            if const { R::ORDER > 0 } { self.curve_called(d_n) } else { self.curve(d_n) };
        let half = (R::constant(0.5) * self.shear_factor) * d_t;
        let lean = self.coupling * tangent;
        let energy = integral.dot2(square, d_t, force.dot2(lean, slope, half));
        let gradient = ElasticGradient {
            tilt: self.share
                * (square * (R::constant(2.0) * integral).dot2(tangent, self.coupling * force, d_t)),
            normal: self.share * force.mul_add(square, d_t * slope.dot2(lean, bend, half)),
            tangential: self.share * force.dot2(lean, slope, self.shear_factor * d_t),
        };
        (self.share * energy, gradient)
    }
}

/// The integral, the force and its derivatives at a compression. Where this is negative the curve goes on as F''(0) d^2 / 2, as
/// (5) does.
impl<R: Real> Functions<R, 4> for Springs<R> {
    #[inline(always)]
    fn at<T: Lift<R>>(&self, d: T) -> [T; 4] {
        let compressed = d.positive_part();
        let mut found = self.force.curve(compressed);
        // Unless all lanes are compressed: at zero a number with derivatives has them from here alone.
        if T::zero().less(d) != T::zero().less(T::constant(1.0)) {
            let open = d - compressed;
            let slope = found.bend * open;
            let force = T::constant(0.5) * slope * open;
            found.integral = found.integral + force * open * T::constant(1.0 / 3.0);
            (found.force, found.slope) = (found.force + force, found.slope + slope);
        }
        [found.integral, found.force, found.slope, found.bend]
    }
}
