//! The constraint stabilisation method (19, 20, 24). Its states are nine coordinates, nine velocities and two
//! controller memories; with driven fingers they are seven coordinates and seven velocities.
//!
//! (24) is solved for the accelerations, with gamma in place of Phi-dot p (`constrained.rs`).

use crate::formulation::Equations;
use crate::model::{Geometry, Papers, Parts, Plant, Stabilization};
use crate::number::{Real, inlined};

#[derive(Debug, Clone, Copy)]
pub struct Csm<R> {
    pub(crate) plant: Plant<R>,
    two_alpha: R,
    alpha_squared: R,
    beta: R,
}

impl<R: Real> Csm<R> {
    /// The formulation of a scene with the gains of (19) and (20).
    #[inline(always)]
    pub fn new(plant: Plant<R>, stabilization: &Stabilization) -> Self {
        let Stabilization { alpha, beta } = *stabilization;
        Self {
            plant,
            two_alpha: R::constant(2.0 * alpha),
            alpha_squared: R::constant(alpha * alpha),
            beta: R::constant(beta),
        }
    }

    /// gamma of (22) and (23).
    #[inline(always)]
    pub(super) fn gamma(&self, geometry: &Geometry<R, impl Parts>) -> [R; 4] {
        let [c1, c2, c3, c4] = geometry.residuals();
        let [v1, v2, _, _] = geometry.constraint_velocity();
        let [b1, b2, b3, b4] = geometry.bias();
        [
            self.alpha_squared.mul_add(c1, self.two_alpha.mul_add(v1, b1)),
            self.alpha_squared.mul_add(c2, self.two_alpha.mul_add(v2, b2)),
            self.beta.mul_add(c3, b3),
            self.beta.mul_add(c4, b4),
        ]
    }
}

impl<R: Real> Equations<R> for Csm<R> {
    type Parts = Papers;

    inlined! {
        plant(&self) -> &Plant<R> = &self.plant;
        bias(&self, geometry: &Geometry<R, Papers>) -> [R; 4] = self.gamma(geometry);
    }
}
