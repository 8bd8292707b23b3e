//! The constraint stabilisation method (19, 20, 24): nine coordinates, nine velocities, two controller memories.
//!
//! (24) is block-solved. With the diagonal mass matrix its Schur complement is the symmetric positive definite
//! 4 x 4 system (Phi M^-1 Phi^T) lambda = -gamma - Phi M^-1 f, and the accelerations follow.

use crate::control::Controller;
use crate::dynamics::{Forces, Plant};
use crate::energy::{Energies, WORKS};
use crate::formulation::{Build, Evaluation, Motion, System};
use crate::geometry::Geometry;
use crate::geometry::index::{D_N, D_T, FINGER, THETA, X};
use crate::inputs::Input;
use crate::linear::{Lower4, solve4};
use crate::parameters::{PidGains, Source, Stabilization};
use crate::real::{Real, dot};

/// Degrees of freedom: the coordinates.
pub const DEGREES: usize = 9;
/// States without the ledger: q, p, two memories.
pub const STATES: usize = 20;
/// States with the ledger's works behind them.
pub const STATES_WITH_LEDGER: usize = STATES + WORKS;

/// The system that the integrators step.
#[derive(Debug, Clone, Copy)]
pub struct Csm<R, K> {
    plant: Plant<R, K>,
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

    /// Geometry, forces, multipliers and accelerations at one state.
    #[inline(always)]
    pub fn terms(&self, input: &Input<R>, motion: &Motion<R>) -> (Geometry<R>, Forces<R>, [R; 4], [R; 9]) {
        let plant = &self.plant;
        let Motion { q, p, memory } = motion;
        let geometry = Geometry::new(&plant.sides, q, p);
        let forces = plant.forces(&geometry, q, p, memory, input);
        let (multipliers, acceleration) = constrained_acceleration(
            &geometry,
            &plant.inverse_masses,
            &forces.total(),
            &self.gamma(&geometry),
        );
        (geometry, forces, multipliers, acceleration)
    }
}

/// Builds [`Csm`].
pub struct ByCsm;

impl<const N: usize> Build<N> for ByCsm {
    type Built<R: Real> = Csm<R, PidGains<R>>;

    #[inline(always)]
    fn build<R: Real>(source: &impl Source<R>, gains: &Stabilization) -> Self::Built<R> {
        Csm::new(Plant::pid(source), gains)
    }
}

impl<R: Real, K: Controller<R>, const N: usize> System<R, N> for Csm<R, K> {
    const STATES: usize = STATES;
    const DEGREES: usize = DEGREES;

    #[inline(always)]
    fn begin(&self, motion: &Motion<R>) -> [R; N] {
        let mut y = [R::zero(); N];
        y[..9].copy_from_slice(&motion.q);
        y[9..18].copy_from_slice(&motion.p);
        y[18..20].copy_from_slice(&motion.memory);
        y
    }

    #[inline(always)]
    fn motion(&self, y: &[R; N]) -> Motion<R> {
        unpack(y)
    }

    #[inline(always)]
    fn evaluate(&self, input: &Input<R>, y: &[R; N]) -> Evaluation<R, N> {
        let motion = unpack(y);
        let (geometry, forces, multipliers, acceleration) = self.terms(input, &motion);
        let mut rate = [R::zero(); N];
        rate[..9].copy_from_slice(&motion.p);
        rate[9..18].copy_from_slice(&acceleration);
        rate[18..20].copy_from_slice(&self.plant.memory_rates(&motion.q, input));
        if <Self as System<R, N>>::LEDGER {
            rate[STATES..].copy_from_slice(&forces.powers(&geometry, &motion.p, &multipliers));
        }
        Evaluation {
            rate,
            motion,
            multipliers,
            residuals: geometry.residuals(),
            sin_tilt: geometry.sin_tilt(),
        }
    }

    #[inline(always)]
    fn energies(&self, motion: &Motion<R>) -> Energies<R> {
        self.plant.energies(&motion.q, &motion.p)
    }

    #[inline(always)]
    fn jump(&self, y: &mut [R; N], impulse: &[R; 3]) {
        let Motion { q, p, .. } = unpack(y);
        let geometry = Geometry::new(&self.plant.sides, &q, &p);
        let mut force = [R::zero(); 9];
        force[..3].copy_from_slice(impulse);
        let still = [R::zero(); 4];
        let (answer, change) =
            constrained_acceleration(&geometry, &self.plant.inverse_masses, &force, &still);
        for k in 0..9 {
            y[9 + k] = y[9 + k] + change[k];
        }
        if <Self as System<R, N>>::LEDGER {
            let half = R::constant(0.5);
            let mut mean = p;
            for k in 0..9 {
                mean[k] = half.mul_add(change[k], p[k]);
            }
            let drift = geometry.phi_times(&mean);
            y[21] = y[21] + dot(impulse, &[mean[0], mean[1], mean[2]]);
            y[23] = y[23]
                + (answer[0].dot2(drift[0], answer[1], drift[1])
                    + answer[2].dot2(drift[2], answer[3], drift[3]));
        }
    }
}

/// q, p and the controllers' memories out of a state.
#[inline(always)]
pub fn unpack<R: Real, const N: usize>(y: &[R; N]) -> Motion<R> {
    let (mut q, mut p) = ([R::zero(); 9], [R::zero(); 9]);
    q.copy_from_slice(&y[..9]);
    p.copy_from_slice(&y[9..18]);
    Motion { q, p, memory: [y[18], y[19]] }
}
