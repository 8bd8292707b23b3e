//! Independent velocities (docs/integrators.md, "How the constraints are kept"): Maggi's equations on the null space of Phi.
//!
//! The last four columns of Phi are the identity, so the velocity v of the pose (x, y, theta, theta_1, theta_2)
//! determines the rates of the deformations, -Phi_5 v, and C^H = 0 determines d_n itself. There remains
//! (M_5 + Phi_5^T M_d Phi_5) v-dot = f_5 - Phi_5^T (f_d + M_d b), which is solved in `constrained.rs`. The
//! formulation has fourteen states, no gain to choose and no drift. With driven fingers it has three velocities
//! and eight states.

use crate::formulation::Equations;
use crate::model::{Geometry, Motion, Papers, Plant};
use crate::number::{Real, inlined};

#[derive(Debug, Clone, Copy)]
pub struct Nullspace<R> {
    pub(crate) plant: Plant<R>,
}

impl<R: Real> Equations<R> for Nullspace<R> {
    type Parts = Papers;

    inlined! {
        drifts(&self) -> bool = false;
        plant(&self) -> &Plant<R> = &self.plant;
        geometry(&self, motion: &mut Motion<R>) -> Geometry<R, Papers> =
            Geometry::constrained(&self.plant.sides, &mut motion.q, &mut motion.p);
    }
}
