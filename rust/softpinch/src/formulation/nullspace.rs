//! Independent velocities (docs/integrators.md, "How the constraints are kept"): Maggi's equations on the null space of Phi.
//!
//! The last four columns of Phi are the identity, so the velocity v of the pose (x, y, theta, theta_1, theta_2)
//! determines the rates of the deformations, -Phi_5 v, and C^H = 0 determines d_n itself. There remains
//! (M_5 + Phi_5^T M_d Phi_5) v-dot = f_5 - Phi_5^T (f_d + M_d b), which is solved in `constrained.rs`. The
//! formulation has fourteen states, no gain to choose and no drift. With driven fingers it has three velocities
//! and eight states.

use crate::formulation::equations::{Equations, MAX_COMPONENTS, States};
use crate::model::control::Controller;
use crate::model::drive::Input;
use crate::model::forces::Plant;
use crate::model::geometry::Geometry;
use crate::model::geometry::index::{D_T, FINGER};
use crate::model::motion::Motion;
use crate::number::real::Real;

/// Degrees of freedom: the pose (x, y, theta, theta_1, theta_2).
pub const DEGREES: usize = 5;
/// States without the ledger: pose, its velocity, two shears, two memories.
pub const STATES: usize = 14;
/// Degrees of freedom with driven fingers: (x, y, theta).
pub const DRIVEN_DEGREES: usize = 3;
/// States with driven fingers: pose, its velocity, two shears.
pub const DRIVEN_STATES: usize = 8;

/// The equations on the null space of Phi.
#[derive(Debug, Clone, Copy)]
pub struct Nullspace<R, K> {
    plant: Plant<R, K>,
}

impl<R: Real, K: Controller<R>> Nullspace<R, K> {
    /// The formulation of a scene.
    #[inline(always)]
    pub fn new(plant: Plant<R, K>) -> Self {
        Self { plant }
    }
}

impl<R: Real, K: Controller<R>> Equations<R> for Nullspace<R, K> {
    type Fingers = K;
    const STATES: usize = if K::ANGLE_IS_STATE { STATES } else { DRIVEN_STATES };
    const DEGREES: usize = if K::ANGLE_IS_STATE { DEGREES } else { DRIVEN_DEGREES };
    const DRIFTS: bool = false;

    #[inline(always)]
    fn plant(&self) -> &Plant<R, K> {
        &self.plant
    }

    /// Pose, velocity, shears and memories. Driven fingers are not part of the state, because the schedule
    /// prescribes them.
    #[inline(always)]
    fn begin(&self, motion: &Motion<R>) -> States<R> {
        let Motion { q, p, memory } = motion;
        let mut y = [R::zero(); MAX_COMPONENTS];
        let degrees = if K::ANGLE_IS_STATE { DEGREES } else { DRIVEN_DEGREES };
        y[..degrees].copy_from_slice(&q[..degrees]);
        y[degrees..2 * degrees].copy_from_slice(&p[..degrees]);
        y[2 * degrees..2 * degrees + 2].copy_from_slice(&q[D_T..]);
        if K::ANGLE_IS_STATE {
            y[12..14].copy_from_slice(memory);
        }
        y
    }

    #[inline(always)]
    fn motion(&self, input: &Input<R>, y: &States<R>) -> (Motion<R>, Geometry<R>) {
        let (pose, shear, velocity, memory) = unpack::<R, K>(input, y);
        let (geometry, q, p) = Geometry::constrained(&self.plant.sides, &pose, &shear, &velocity);
        (Motion { q, p, memory }, geometry)
    }

    #[inline(always)]
    fn bias(&self, geometry: &Geometry<R>) -> [R; 4] {
        geometry.bias()
    }
}

/// Unpacks pose, shears, velocity and memories from a state. Driven fingers are taken from the input.
#[inline(always)]
fn unpack<R: Real, K: Controller<R>>(input: &Input<R>, y: &States<R>) -> ([R; 5], [R; 2], [R; 5], [R; 2]) {
    let (mut pose, mut velocity) = ([R::zero(); 5], [R::zero(); 5]);
    if K::ANGLE_IS_STATE {
        pose.copy_from_slice(&y[..5]);
        velocity.copy_from_slice(&y[5..10]);
        return (pose, [y[10], y[11]], velocity, [y[12], y[13]]);
    }
    pose[..FINGER].copy_from_slice(&y[..3]);
    pose[FINGER..].copy_from_slice(&input.target);
    velocity[..FINGER].copy_from_slice(&y[3..6]);
    velocity[FINGER..].copy_from_slice(&input.target_rate);
    (pose, [y[6], y[7]], velocity, [R::zero(); 2])
}
