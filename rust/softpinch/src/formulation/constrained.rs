//! The solve of (24) that all formulations share: M a = f + Phi^T lambda with Phi a = -b.
//!
//! The last four columns of Phi are the identity, so the accelerations of the deformations are
//! -(Phi_5 v-dot + b), where v is the velocity of the pose. There remains
//! (M_5 + Phi_5^T M_d Phi_5) v-dot = f_5 - Phi_5^T (f_d + M_d b).
//!
//! In the object's own frame the 5 x 5 matrix is an arrow. Eliminating a finger leaves the effective mass of its
//! tip at the contact, with the finger free to give way,
//! N_i = [m_n (I_i + m_t F^2), -m_n m_t B F; ., m_t (I_i + m_n B^2)] / (I_i + m_n B^2 + m_t F^2),
//! a form in which nothing cancels. Then a 3 x 3 system for the object remains. Driven fingers do not give way:
//! for them N_i = [m_n 0; . m_t], and their accelerations are added to b.

use crate::model::control::Controller;
use crate::model::forces::Plant;
use crate::model::geometry::index::{D_N, D_T, FINGER, THETA, X, Y};
use crate::model::geometry::{Contact, Geometry};
use crate::number::linear::solve3;
use crate::number::real::Real;

/// The solution.
#[derive(Debug, Clone, Copy)]
pub struct Constrained<R> {
    /// (lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N).
    pub multipliers: [R; 4],
    /// The accelerations a, in the order of q.
    pub acceleration: [R; 9],
}

/// Multipliers and accelerations for the forces `f` and the bias `b`. `swing` has the accelerations of driven
/// fingers.
#[inline(always)]
pub fn constrained<R: Real, K: Controller<R>>(
    geometry: &Geometry<R>,
    plant: &Plant<R, K>,
    f: &[R; 9],
    b: &[R; 4],
    swing: &[R; 2],
) -> Constrained<R> {
    let mut driven = *b;
    if !K::TURNS {
        let share = geometry.swing(*swing);
        for k in 0..4 {
            driven[k] = b[k] + share[k];
        }
    }
    let mut acceleration = [R::zero(); 9];
    acceleration[..5].copy_from_slice(&pose_acceleration(geometry, plant, f, &driven));
    if !K::TURNS {
        acceleration[FINGER..D_N].copy_from_slice(swing);
    }
    // lambda = M_d a_d - f_d.
    let swept = geometry.phi_times(&acceleration);
    let mut multipliers = swept;
    for k in 0..4 {
        acceleration[D_N + k] = -(swept[k] + b[k]);
        multipliers[k] = plant.masses[D_N + k].mul_add(acceleration[D_N + k], -f[D_N + k]);
    }
    Constrained { multipliers, acceleration }
}

/// An eliminated finger: the contact's share of the object's 3 x 3 system.
struct Eliminated<R> {
    /// 1 / (I_i + m_n B^2 + m_t F^2).
    inverse: R,
    /// The finger's column of the arrow matrix: along the face's normal (without s_i), across it, and about
    /// the object.
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
            // Each product contains a mass and a share of the total inertia: products of two masses would
            // overflow or underflow if the masses are extreme.
            normal: m_n * (tangential_part * inverse),
            mixed: -(h * (k * inverse)),
            tangential: m_t * (normal_part * inverse),
        }
    }
}

impl<R: Real> Eliminated<R> {
    /// N_i times the object's column for its rotation (A_i, E_i).
    #[inline(always)]
    fn turned(&self, contact: &Contact<R>) -> (R, R) {
        (
            self.normal.dot2(contact.a, self.mixed, contact.e),
            self.mixed.dot2(contact.a, self.tangential, contact.e),
        )
    }

    /// The acceleration of the finger for a given acceleration of the object, which has components along s_i
    /// times the normal, across it, and about the object.
    #[inline(always)]
    fn finger(&self, give: R, [along, across, turn]: [R; 3]) -> R {
        let [h, k, c] = self.column;
        self.inverse.neg_mul_add(h.mul_add(along, k.dot2(across, c, turn)), give)
    }
}

/// v-dot for the forces `f` and the bias `b`, which includes the share of driven fingers. The rows of driven
/// fingers are zero.
#[inline(always)]
fn pose_acceleration<R: Real, K: Controller<R>>(
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
        // Along the normal and across it the masses are constant, and only the rotation couples the two
        // directions.
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
    let [u, v, turn] = solve3(&matrix, &load, plant.inverse_masses[X]);
    let [x, y] = geometry.outward(u, v);
    [x, y, turn, r.finger(give1, [-u, v, turn]), l.finger(give2, [u, v, turn])]
}
