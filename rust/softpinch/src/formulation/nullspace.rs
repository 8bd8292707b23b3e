//! Independent velocities (docs/integrators.md, "How the constraints are kept"): Maggi's equations on the null space of Phi.
//!
//! The last four columns of Phi are the identity, so the velocity v of the pose (x, y, theta, theta_1, theta_2)
//! determines the rates of the deformations, -Phi_5 v, and C^H = 0 determines d_n itself. There remains
//! (M_5 + Phi_5^T M_d Phi_5) v-dot = f_5 - Phi_5^T (f_d + M_d b), which is solved in `constrained.rs`. The
//! formulation has fourteen states, no gain to choose and no drift. With driven fingers it has three velocities
//! and eight states.

use crate::formulation::constrained::{Constrained, constrained};
use crate::formulation::equations::{Equations, Evaluation, MAX_COMPONENTS, States};
use crate::model::contact_modes::Contacts;
use crate::model::control::Controller;
use crate::model::drive::Input;
use crate::model::energy::{BILATERAL_WORKS, Energies, work};
use crate::model::forces::{Forces, Plant};
use crate::model::geometry::Geometry;
use crate::model::geometry::index::{D_T, FINGER};
use crate::model::motion::Motion;
use crate::number::real::{Real, dot};

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

/// All terms at one state.
struct Terms<R> {
    geometry: Geometry<R>,
    motion: Motion<R>,
    forces: Forces<R>,
    solution: Constrained<R>,
}

impl<R: Real, K: Controller<R>> Nullspace<R, K> {
    /// The formulation of a scene.
    pub fn new(plant: Plant<R, K>) -> Self {
        Self { plant }
    }

    /// Computes all terms at one state.
    #[inline(always)]
    fn terms(
        &self,
        input: &Input<R>,
        pose: &[R; 5],
        shear: &[R; 2],
        velocity: &[R; 5],
        memory: [R; 2],
    ) -> Terms<R> {
        let plant = &self.plant;
        let (geometry, q, p) = Geometry::constrained(&plant.sides, pose, shear, velocity);
        let mut forces = plant.forces(&geometry, &q, &p, &memory, input);
        let finger_acceleration = &input.target_acceleration;
        let solution = constrained(&geometry, plant, &forces.total(), &geometry.bias(), finger_acceleration);
        if !K::ANGLE_IS_STATE {
            forces.torque =
                plant.driving_torque(&geometry, &forces, finger_acceleration, &solution.multipliers);
        }
        Terms { geometry, motion: Motion { q, p, memory }, forces, solution }
    }
}

/// Packs pose and velocity (or their rates), shears and memories into a state. Driven fingers are not part of
/// the state, because the schedule prescribes them.
#[inline(always)]
fn pack<R: Real, K: Controller<R>>(pose: &[R], velocity: &[R], shear: &[R], memory: &[R; 2]) -> States<R> {
    let mut y = [R::zero(); MAX_COMPONENTS];
    let degrees = if K::ANGLE_IS_STATE { DEGREES } else { DRIVEN_DEGREES };
    y[..degrees].copy_from_slice(&pose[..degrees]);
    y[degrees..2 * degrees].copy_from_slice(&velocity[..degrees]);
    y[2 * degrees..2 * degrees + 2].copy_from_slice(shear);
    if K::MEMORY {
        y[12..14].copy_from_slice(memory);
    }
    y
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

impl<R: Real, K: Controller<R>> Equations<R> for Nullspace<R, K> {
    const STATES: usize = if K::ANGLE_IS_STATE { STATES } else { DRIVEN_STATES };
    const DEGREES: usize = if K::ANGLE_IS_STATE { DEGREES } else { DRIVEN_DEGREES };

    #[inline(always)]
    fn begin(&self, motion: &Motion<R>) -> States<R> {
        pack::<R, K>(&motion.q[..5], &motion.p[..5], &motion.q[D_T..], &motion.memory)
    }

    #[inline(always)]
    fn evaluate(&self, input: &Input<R>, _: &Contacts<R>, y: &States<R>, ledger: bool) -> Evaluation<R> {
        let (pose, shear, velocity, memory) = unpack::<R, K>(input, y);
        let Terms { geometry, motion, forces, solution: Constrained { multipliers, acceleration } } =
            self.terms(input, &pose, &shear, &velocity, memory);
        let memory = if K::MEMORY { self.plant.memory_rates(&motion.q, input) } else { [R::zero(); 2] };
        let mut rate = pack::<R, K>(&velocity, &acceleration[..DEGREES], &motion.p[D_T..], &memory);
        if ledger {
            let drags = self.plant.drags(&motion.p);
            let powers = forces.powers(&geometry, &drags, &motion.p, &multipliers);
            rate[Self::STATES..Self::STATES + BILATERAL_WORKS].copy_from_slice(&powers);
        }
        Evaluation {
            rate,
            motion,
            multipliers,
            residuals: geometry.residuals(),
            sin_tilt: geometry.sin_tilt(),
            places: geometry.places(),
            torque: forces.torque,
            share: [R::constant(1.0); 2],
        }
    }

    #[inline(always)]
    fn energies(&self, _: &Contacts<R>, motion: &Motion<R>) -> Energies<R> {
        self.plant.energies(&motion.q, &motion.p)
    }

    #[inline(always)]
    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3], ledger: bool) {
        let (pose, shear, velocity, _) = unpack::<R, K>(input, y);
        let (geometry, _, p) = Geometry::constrained(&self.plant.sides, &pose, &shear, &velocity);
        let mut force = [R::zero(); 9];
        force[..3].copy_from_slice(impulse);
        let (still, finger_acceleration) = ([R::zero(); 4], [R::zero(); 2]);
        let Constrained { multipliers: constraint_impulse, acceleration: change } =
            constrained(&geometry, &self.plant, &force, &still, &finger_acceleration);
        for k in 0..Self::DEGREES {
            y[Self::DEGREES + k] = y[Self::DEGREES + k] + change[k];
        }
        if ledger {
            let half = R::constant(0.5);
            let [u, v, turn, ..] = change;
            let mean =
                [half.mul_add(u, velocity[0]), half.mul_add(v, velocity[1]), half.mul_add(turn, velocity[2])];
            let first = Self::STATES;
            y[first + work::EXTERNAL] = y[first + work::EXTERNAL] + dot(impulse, &mean);
            if !K::ANGLE_IS_STATE {
                y[first + work::CONTROL] =
                    y[first + work::CONTROL] + self.plant.driving_work(&geometry, &constraint_impulse, &p);
            }
        }
    }
}
