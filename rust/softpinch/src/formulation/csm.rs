//! The constraint stabilisation method (19, 20, 24): nine coordinates, nine velocities, two controller memories; seven and
//! seven where the schedule has the fingers.
//!
//! (24) is block-solved. With the diagonal mass matrix its Schur complement is the symmetric positive definite
//! 4 x 4 system (Phi M^-1 Phi^T) lambda = -gamma - Phi M^-1 f, and the accelerations follow.

use crate::control::Controller;
use crate::dynamics::{Forces, Plant};
use crate::energy::{Energies, WORKS};
use crate::formulation::{Equations, Evaluation, Motion, ROOM, States};
use crate::geometry::Geometry;
use crate::geometry::index::{D_N, D_T, FINGER, THETA, X};
use crate::inputs::Input;
use crate::linear::{Lower4, solve4};
use crate::parameters::Stabilization;
use crate::real::{Real, dot};

/// Degrees of freedom: the coordinates that the equations move.
pub const DEGREES: usize = 9;
/// States without the ledger: q, p, two memories.
pub const STATES: usize = 20;
/// The same of driven fingers.
pub const DRIVEN_DEGREES: usize = 7;
/// q and p but for the fingers.
pub const DRIVEN_STATES: usize = 14;

/// The system that the integrators step.
#[derive(Debug, Clone, Copy)]
pub struct Csm<R, K> {
    pub(crate) plant: Plant<R, K>,
    two_alpha: R,
    alpha_squared: R,
    beta: R,
}

/// The multipliers and accelerations that fulfil M a = f + Phi^T lambda and Phi a = -gamma.
#[inline(always)]
pub fn constrained_acceleration<R: Real>(
    geometry: &Geometry<R>,
    inverse_masses: &[R; 9],
    force: &[R; 9],
    gamma: &[R; 4],
) -> ([R; 4], [R; 9]) {
    let mut free = *force;
    for k in 0..9 {
        free[k] = force[k] * inverse_masses[k];
    }
    let drive = geometry.phi_times(&free);
    let mut load = *gamma;
    for k in 0..4 {
        load[k] = -(gamma[k] + drive[k]);
    }
    // Finger by finger: (H_1, N_1, H_2, N_2).
    let [h1, h2, n1, n2] = load;
    let [l0, l1, l2, l3] = solve4(&schur_complement(geometry, inverse_masses), &[h1, n1, h2, n2]);
    let multipliers = [l0, l2, l1, l3];
    let mut acceleration = geometry.phi_transposed_times(&multipliers);
    for k in 0..9 {
        acceleration[k] = acceleration[k].mul_add(inverse_masses[k], free[k]);
    }
    (multipliers, acceleration)
}

/// The lower triangle of Phi M^-1 Phi^T, rows and columns in the order (H_1, N_1, H_2, N_2). The object's frame
/// turns the x and y columns into (s_i, 0) and (0, 1).
#[inline(always)]
fn schur_complement<R: Real>(geometry: &Geometry<R>, inverse_masses: &[R; 9]) -> Lower4<R> {
    let [r, l] = &geometry.contacts;
    let object = inverse_masses[X];
    let turn = inverse_masses[THETA];
    let (right, left) = (inverse_masses[FINGER], inverse_masses[FINGER + 1]);
    let (ra, re, la, le) = (r.a * turn, r.e * turn, l.a * turn, l.e * turn);
    let (rb, rf, lb, lf) = (r.b * right, r.f * right, l.b * left, l.f * left);
    [
        rb.mul_add(r.b, ra.mul_add(r.a, object + inverse_masses[D_N])),
        rf.mul_add(r.b, re * r.a),
        rf.mul_add(r.f, re.mul_add(r.e, object + inverse_masses[D_T])),
        la.mul_add(r.a, -object),
        la * r.e,
        lb.mul_add(l.b, la.mul_add(l.a, object + inverse_masses[D_N + 1])),
        le * r.a,
        le.mul_add(r.e, object),
        lf.mul_add(l.b, le * l.a),
        lf.mul_add(l.f, le.mul_add(l.e, object + inverse_masses[D_T + 1])),
    ]
}

impl<R: Real, K: Controller<R>> Csm<R, K> {
    /// The formulation of a scene with the gains of (19) and (20).
    pub fn new(plant: Plant<R, K>, stabilization: &Stabilization) -> Self {
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
    fn gamma(&self, geometry: &Geometry<R>) -> [R; 4] {
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

    /// Geometry, forces, multipliers and accelerations at one state; of driven fingers the input has the accelerations.
    #[inline(always)]
    pub fn terms(&self, input: &Input<R>, motion: &Motion<R>) -> (Geometry<R>, Forces<R>, [R; 4], [R; 9]) {
        let plant = &self.plant;
        let Motion { q, p, memory } = motion;
        let geometry = Geometry::new(&plant.sides, q, p);
        let mut forces = plant.forces(&geometry, q, p, memory, input);
        let mut gamma = self.gamma(&geometry);
        if !K::TURNS {
            let swing = geometry.swing(input.target_acceleration);
            for k in 0..4 {
                gamma[k] = gamma[k] + swing[k];
            }
        }
        let (multipliers, mut acceleration) =
            constrained_acceleration(&geometry, &plant.inverse_masses, &forces.total(), &gamma);
        if !K::TURNS {
            acceleration[FINGER..D_N].copy_from_slice(&input.target_acceleration);
            forces.torque =
                plant.driving_torque(&geometry, &forces, &input.target_acceleration, &multipliers);
        }
        (geometry, forces, multipliers, acceleration)
    }
}

impl<R: Real, K: Controller<R>> Equations<R> for Csm<R, K> {
    const STATES: usize = if K::TURNS { STATES } else { DRIVEN_STATES };
    const DEGREES: usize = if K::TURNS { DEGREES } else { DRIVEN_DEGREES };

    #[inline(always)]
    fn begin(&self, motion: &Motion<R>) -> States<R> {
        pack::<R, K>(&motion.q, &motion.p, &motion.memory)
    }

    #[inline(always)]
    fn evaluate(&self, input: &Input<R>, y: &States<R>, ledger: bool) -> Evaluation<R> {
        let motion = unpack::<R, K>(input, y);
        let (geometry, forces, multipliers, acceleration) = self.terms(input, &motion);
        let memory = if K::MEMORY { self.plant.memory_rates(&motion.q, input) } else { [R::zero(); 2] };
        let mut rate = pack::<R, K>(&motion.p, &acceleration, &memory);
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
        let Motion { q, mut p, memory } = unpack::<R, K>(input, y);
        let geometry = Geometry::new(&self.plant.sides, &q, &p);
        let mut force = [R::zero(); 9];
        force[..3].copy_from_slice(impulse);
        let still = [R::zero(); 4];
        let (answer, change) =
            constrained_acceleration(&geometry, &self.plant.inverse_masses, &force, &still);
        let half = R::constant(0.5);
        let mut mean = p;
        for k in 0..9 {
            mean[k] = half.mul_add(change[k], p[k]);
            p[k] = p[k] + change[k];
        }
        let works = *y;
        *y = pack::<R, K>(&q, &p, &memory);
        if ledger {
            let first = Self::STATES;
            let drift = geometry.phi_times(&mean);
            y[first..first + WORKS].copy_from_slice(&works[first..first + WORKS]);
            if !K::TURNS {
                y[first] = y[first] + self.plant.driving_work(&geometry, &answer, &p);
            }
            y[first + 1] = y[first + 1] + dot(impulse, &[mean[0], mean[1], mean[2]]);
            y[first + 3] = y[first + 3]
                + (answer[0].dot2(drift[0], answer[1], drift[1])
                    + answer[2].dot2(drift[2], answer[3], drift[3]));
        }
    }
}

/// A state out of q and p, or their rates, and the controllers' memories; the schedule has driven fingers, not the state.
#[inline(always)]
pub fn pack<R: Real, K: Controller<R>>(q: &[R; 9], p: &[R; 9], memory: &[R; 2]) -> States<R> {
    let mut y = [R::zero(); ROOM];
    if K::TURNS {
        y[..9].copy_from_slice(q);
        y[9..18].copy_from_slice(p);
        y[18..20].copy_from_slice(memory);
    } else {
        for (nine, first) in [(q, 0), (p, DRIVEN_DEGREES)] {
            y[first..first + 3].copy_from_slice(&nine[..FINGER]);
            y[first + 3..first + 7].copy_from_slice(&nine[D_N..]);
        }
    }
    y
}

/// q, p and the controllers' memories out of a state.
#[inline(always)]
pub fn unpack<R: Real, K: Controller<R>>(input: &Input<R>, y: &States<R>) -> Motion<R> {
    let (mut q, mut p) = ([R::zero(); 9], [R::zero(); 9]);
    if K::TURNS {
        q.copy_from_slice(&y[..9]);
        p.copy_from_slice(&y[9..18]);
        return Motion { q, p, memory: [y[18], y[19]] };
    }
    q[FINGER..D_N].copy_from_slice(&input.target);
    p[FINGER..D_N].copy_from_slice(&input.target_rate);
    for (nine, first) in [(&mut q, 0), (&mut p, DRIVEN_DEGREES)] {
        nine[..FINGER].copy_from_slice(&y[first..first + 3]);
        nine[D_N..].copy_from_slice(&y[first + 3..first + 7]);
    }
    Motion { q, p, memory: [R::zero(); 2] }
}
