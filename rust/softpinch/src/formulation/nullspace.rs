//! Independent velocities (docs/integrators.md, "How the constraints are kept"): Maggi's equations on the null space of Phi.
//!
//! The last four columns of Phi are the identity, so the velocity v of the pose (x, y, theta, theta_1, theta_2) gives the
//! deformations' rates, -Phi_5 v, and C^H = 0 gives d_n itself. What remains is
//! (M_5 + Phi_5^T M_d Phi_5) v-dot = f_5 - Phi_5^T (f_d + M_d b): fourteen states, no gain to choose, no drift.
//!
//! In the object's own frame the 5 x 5 matrix is an arrow. Eliminating a finger leaves what its tip's masses weigh at the
//! contact once the finger gives way,
//! N_i = [m_n (I_i + m_t F^2), -m_n m_t B F; ., m_t (I_i + m_n B^2)] / (I_i + m_n B^2 + m_t F^2),
//! a form without a difference in it; then 3 x 3 for the object remains. Fingers that the schedule has give way to nothing, so
//! N_i = [m_n 0; . m_t], and their accelerations join b: three velocities and eight states.

use crate::control::Controller;
use crate::dynamics::{Forces, Plant};
use crate::energy::{Energies, WORKS};
use crate::formulation::{Equations, Evaluation, Motion, ROOM, States};
use crate::geometry::index::{D_N, D_T, FINGER, THETA, X, Y};
use crate::geometry::{Contact, Geometry};
use crate::inputs::Input;
use crate::linear::solve3;
use crate::real::{Real, dot};

/// Degrees of freedom: the pose (x, y, theta, theta_1, theta_2).
pub const DEGREES: usize = 5;
/// States without the ledger: pose, its velocity, two shears, two memories.
pub const STATES: usize = 14;
/// The same of driven fingers: (x, y, theta).
pub const DRIVEN_DEGREES: usize = 3;
/// Pose, its velocity, two shears.
pub const DRIVEN_STATES: usize = 8;

/// The system that the integrators step.
#[derive(Debug, Clone, Copy)]
pub struct Nullspace<R, K> {
    plant: Plant<R, K>,
}

/// One finger, eliminated: the contact's share of the object's 3 x 3 system.
struct Eliminated<R> {
    /// 1 / (I_i + m_n B^2 + m_t F^2).
    inverse: R,
    /// The finger's column of the arrow: along the face's normal (without s_i), across it, and about the object.
    column: [R; 3],
    /// N_i.
    normal: R,
    mixed: R,
    tangential: R,
}

impl<R: Real> Eliminated<R> {
    #[inline(always)]
    fn new(contact: &Contact<R>, inertia: R, m_n: R, m_t: R) -> Self {
        let (h, k) = (m_n * contact.b, m_t * contact.f);
        let (normal_part, tangential_part) = (h.mul_add(contact.b, inertia), k.mul_add(contact.f, inertia));
        let inverse = R::constant(1.0) / k.mul_add(contact.f, normal_part);
        Self {
            inverse,
            column: [h, k, h.dot2(contact.a, k, contact.e)],
            normal: m_n * tangential_part * inverse,
            mixed: -(h * k * inverse),
            tangential: m_t * normal_part * inverse,
        }
    }
}

impl<R: Real> Eliminated<R> {
    /// N_i times the object's turning column (A_i, E_i).
    #[inline(always)]
    fn turned(&self, contact: &Contact<R>) -> (R, R) {
        (
            self.normal.dot2(contact.a, self.mixed, contact.e),
            self.mixed.dot2(contact.a, self.tangential, contact.e),
        )
    }

    /// The finger's own acceleration once the object's is known, along s_i times the normal, across, and about it.
    #[inline(always)]
    fn finger(&self, give: R, [along, across, turn]: [R; 3]) -> R {
        let [h, k, c] = self.column;
        self.inverse.neg_mul_add(h.mul_add(along, k.dot2(across, c, turn)), give)
    }
}

/// Everything at one state.
struct Terms<R> {
    geometry: Geometry<R>,
    motion: Motion<R>,
    forces: Forces<R>,
    change: [R; 5],
    multipliers: [R; 4],
}

/// v-dot for the forces `f` and the bias `b` (Phi-dot p, and what driven fingers add to it; their own rows are zero).
#[inline(always)]
fn acceleration<R: Real, K: Controller<R>>(
    geometry: &Geometry<R>,
    plant: &Plant<R, K>,
    f: &[R; 9],
    b: &[R; 4],
) -> [R; 5] {
    let [right, left] = &geometry.contacts;
    let masses = &plant.masses;

    // f_5 - Phi_5^T (f_d + M_d b), in the object's frame.
    let mut load = *b;
    for k in 0..4 {
        load[k] = masses[D_N + k].mul_add(b[k], f[D_N + k]);
    }
    let [h1, h2, n1, n2] = load;
    let along = f[X].dot2(geometry.cos, f[Y], geometry.sin) + (h1 - h2);
    let across = f[Y].dot2(geometry.cos, -f[X], geometry.sin) - (n1 + n2);
    let moment = f[THETA] - (right.a.dot2(h1, right.e, n1) + left.a.dot2(h2, left.e, n2));

    // The object's own 3 x 3 system, with G_i = [s_i 0 A_i; 0 1 E_i]: M + sum of G_i^T N_i G_i.
    if !K::TURNS {
        let (rh, rn) = (masses[D_N] * right.a, masses[D_T] * right.e);
        let (lh, ln) = (masses[D_N + 1] * left.a, masses[D_T + 1] * left.e);
        // Along and across the face the masses are constant, and nothing couples them but the rotation.
        let (h, n) = (lh - rh, rn + ln);
        let (h_share, n_share) = (h * plant.inverse_pushed[0], n * plant.inverse_pushed[1]);
        let inertia = masses[THETA] + (rh.dot2(right.a, rn, right.e) + lh.dot2(left.a, ln, left.e));
        let turn = (moment - h_share.dot2(along, n_share, across)) / (inertia - h_share.dot2(h, n_share, n));
        let u = h_share.neg_mul_add(turn, along * plant.inverse_pushed[0]);
        let v = n_share.neg_mul_add(turn, across * plant.inverse_pushed[1]);
        let [x, y] = geometry.outward(u, v);
        return [x, y, turn, R::zero(), R::zero()];
    }
    let r = Eliminated::new(right, masses[FINGER], masses[D_N], masses[D_T]);
    let l = Eliminated::new(left, masses[FINGER + 1], masses[D_N + 1], masses[D_T + 1]);
    let torque1 = f[FINGER] - right.b.dot2(h1, right.f, n1);
    let torque2 = f[FINGER + 1] - left.b.dot2(h2, left.f, n2);
    let ((rh, rn), (lh, ln)) = (r.turned(right), l.turned(left));
    let matrix = [
        masses[X] + (r.normal + l.normal),
        l.mixed - r.mixed,
        masses[Y] + (r.tangential + l.tangential),
        lh - rh,
        rn + ln,
        masses[THETA] + (rh.dot2(right.a, rn, right.e) + lh.dot2(left.a, ln, left.e)),
    ];
    let (give1, give2) = (r.inverse * torque1, l.inverse * torque2);
    let load = [
        r.column[0].dot2(give1, -l.column[0], give2) + along,
        across - r.column[1].dot2(give1, l.column[1], give2),
        moment - r.column[2].dot2(give1, l.column[2], give2),
    ];
    let [u, v, turn] = solve3(&matrix, &load);
    let [x, y] = geometry.outward(u, v);
    [x, y, turn, r.finger(give1, [-u, v, turn]), l.finger(give2, [u, v, turn])]
}

impl<R: Real, K: Controller<R>> Nullspace<R, K> {
    /// The formulation of a scene.
    pub fn new(plant: Plant<R, K>) -> Self {
        Self { plant }
    }

    /// All terms at one state.
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
        let (total, bias) = (forces.total(), geometry.bias());
        let mut driven = bias;
        if !K::TURNS {
            let swing = geometry.swing(input.target_acceleration);
            for k in 0..4 {
                driven[k] = bias[k] + swing[k];
            }
        }
        let mut change = acceleration(&geometry, plant, &total, &driven);
        if !K::TURNS {
            change[FINGER..].copy_from_slice(&input.target_acceleration);
        }
        // lambda = -M_d (Phi_5 v-dot + b) - f_d.
        let mut whole = [R::zero(); 9];
        whole[..5].copy_from_slice(&change);
        let swept = geometry.phi_times(&whole);
        let mut multipliers = swept;
        for k in 0..4 {
            multipliers[k] = -plant.masses[D_N + k].mul_add(swept[k] + bias[k], total[D_N + k]);
        }
        if !K::TURNS {
            forces.torque =
                plant.driving_torque(&geometry, &forces, &input.target_acceleration, &multipliers);
        }
        Terms { geometry, motion: Motion { q, p, memory }, forces, change, multipliers }
    }
}

/// A state out of pose, velocity (or their rates), shears and memories; the schedule has driven fingers, not the state.
#[inline(always)]
fn pack<R: Real, K: Controller<R>>(pose: &[R], velocity: &[R], shear: &[R], memory: &[R; 2]) -> States<R> {
    let mut y = [R::zero(); ROOM];
    let degrees = if K::TURNS { DEGREES } else { DRIVEN_DEGREES };
    y[..degrees].copy_from_slice(&pose[..degrees]);
    y[degrees..2 * degrees].copy_from_slice(&velocity[..degrees]);
    y[2 * degrees..2 * degrees + 2].copy_from_slice(shear);
    if K::MEMORY {
        y[12..14].copy_from_slice(memory);
    }
    y
}

/// Pose, shear, velocity and memories out of a state.
#[inline(always)]
fn unpack<R: Real, K: Controller<R>>(input: &Input<R>, y: &States<R>) -> ([R; 5], [R; 2], [R; 5], [R; 2]) {
    let (mut pose, mut velocity) = ([R::zero(); 5], [R::zero(); 5]);
    if K::TURNS {
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
    const STATES: usize = if K::TURNS { STATES } else { DRIVEN_STATES };
    const DEGREES: usize = if K::TURNS { DEGREES } else { DRIVEN_DEGREES };

    #[inline(always)]
    fn begin(&self, motion: &Motion<R>) -> States<R> {
        pack::<R, K>(&motion.q[..5], &motion.p[..5], &motion.q[D_T..], &motion.memory)
    }

    #[inline(always)]
    fn evaluate(&self, input: &Input<R>, y: &States<R>, ledger: bool) -> Evaluation<R> {
        let (pose, shear, velocity, memory) = unpack::<R, K>(input, y);
        let Terms { geometry, motion, forces, change, multipliers } =
            self.terms(input, &pose, &shear, &velocity, memory);
        let memory = if K::MEMORY { self.plant.memory_rates(&motion.q, input) } else { [R::zero(); 2] };
        let mut rate = pack::<R, K>(&velocity, &change, &motion.p[D_T..], &memory);
        if ledger {
            let powers = forces.powers(&geometry, &motion.p, &multipliers);
            rate[Self::STATES..Self::STATES + WORKS].copy_from_slice(&powers);
        }
        Evaluation {
            rate,
            motion,
            multipliers,
            residuals: geometry.residuals(),
            sin_tilt: geometry.sin_tilt(),
            torque: forces.torque,
        }
    }

    #[inline(always)]
    fn energies(&self, motion: &Motion<R>) -> Energies<R> {
        self.plant.energies(&motion.q, &motion.p)
    }

    #[inline(always)]
    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3], ledger: bool) {
        let (pose, shear, velocity, _) = unpack::<R, K>(input, y);
        let (geometry, _, p) = Geometry::constrained(&self.plant.sides, &pose, &shear, &velocity);
        let mut force = [R::zero(); 9];
        force[..3].copy_from_slice(impulse);
        let change = acceleration(&geometry, &self.plant, &force, &[R::zero(); 4]);
        for k in 0..Self::DEGREES {
            y[Self::DEGREES + k] = y[Self::DEGREES + k] + change[k];
        }
        if ledger {
            let half = R::constant(0.5);
            let [u, v, turn, ..] = change;
            let mean =
                [half.mul_add(u, velocity[0]), half.mul_add(v, velocity[1]), half.mul_add(turn, velocity[2])];
            let first = Self::STATES;
            y[first + 1] = y[first + 1] + dot(impulse, &mean);
            if !K::TURNS {
                let mut whole = [R::zero(); 9];
                whole[..5].copy_from_slice(&change);
                let swept = geometry.phi_times(&whole);
                let mut answer = swept;
                for k in 0..4 {
                    answer[k] = -(self.plant.masses[D_N + k] * swept[k]);
                }
                y[first] = y[first] + self.plant.driving_work(&geometry, &answer, &p);
            }
        }
    }
}
