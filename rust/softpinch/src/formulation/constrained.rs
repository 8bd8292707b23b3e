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

use crate::formulation::Response;
use crate::model::{Contact, Coordinates, Geometry, Parts, Plant};
use crate::number::{LaneTask, Real, signed, solve3, task};

/// The response of contacts that stick to the forces `f` and the bias `b`. `finger_acceleration` has the accelerations
/// that the schedule prescribes for driven fingers.
#[inline(always)]
pub fn constrained<R: Real, P: Parts>(
    driven: bool,
    geometry: &Geometry<R, P>,
    plant: &Plant<R>,
    f: &Coordinates<R>,
    b: &[R; 4],
    finger_acceleration: &[R; 2],
) -> Response<R> {
    let solve = Solve { driven, geometry, plant, f, b, finger_acceleration };
    // Steps, impulses and corrections of other parts share one piece of code.
    if const { P::OTHERS } { R::outlined(solve) } else { solve.run() }
}

task! {
    ['a, R: Real, P: Parts]
    Solve<'a, R, P>(driven: bool, geometry: &'a Geometry<R, P>, plant: &'a Plant<R>, f: &'a Coordinates<R>,
        b: &'a [R; 4], finger_acceleration: &'a [R; 2])
    for R => Response<R> = {
        let mut whole = *b;
        if driven {
            let share = geometry.driven_bias(*finger_acceleration);
            for k in 0..4 {
                whole[k] = b[k] + share[k];
            }
        }
        let (object, mut finger) = pose_acceleration(driven, geometry, plant, f, &whole);
        if driven {
            finger = *finger_acceleration;
        }
        let mut a = Coordinates { object, finger, ..Coordinates::zero() };
        // lambda = M_d a_d - f_d.
        let swept = geometry.phi_times(&a);
        let (masses, mut multipliers) = (&plant.masses, swept);
        for i in 0..2 {
            (a.compression[i], a.shear[i]) = (-(swept[i] + b[i]), -(swept[2 + i] + b[2 + i]));
            multipliers[i] = masses.compression[i].mul_add(a.compression[i], -f.compression[i]);
            multipliers[2 + i] = masses.shear[i].mul_add(a.shear[i], -f.shear[i]);
        }
        let one = R::constant(1.0);
        Response { multipliers, share: [one; 2], acceleration: a, pivots: [one; 4] }
    }
}

/// An eliminated finger: the contact's share of the object's 3 x 3 system, along the object's own axes.
struct Eliminated<R> {
    /// 1 / (I_i + m_n B^2 + m_t F^2), and the finger's acceleration while the object is at rest. Both are zero for a
    /// driven finger.
    inverse: R,
    free_acceleration: R,
    /// The finger's column of the arrow matrix.
    column: [R; 3],
    /// G_i^T N_i G_i with G_i = [s_i 0 A_i; 0 1 E_i], for the object's two directions: both diagonal entries, and the
    /// one beside them.
    along: R,
    mixed: R,
    across: R,
    /// Its column for the object's turn.
    turn: [R; 2],
    inertia: R,
}

impl<R: Real> Eliminated<R> {
    /// The finger of contact `i` with the inertia I_i, under the generalised force `torque` that the multipliers leave
    /// over. A driven finger does not give way: N_i = [m_n 0; . m_t].
    #[inline(always)]
    fn new(
        driven: bool,
        i: usize,
        contact: &Contact<R, impl Parts>,
        (inertia, torque): (R, R),
        [m_n, m_t]: [R; 2],
    ) -> Self {
        let zero = R::zero();
        let (mut inverse, mut free_acceleration, mut column) = (zero, zero, [zero; 3]);
        // The entries (H, H), (H, N) and (N, N) of the effective mass.
        let [mut normal, mut mixed, mut tangential] = [m_n, zero, m_t];
        if !driven {
            let (h, k) = (m_n * contact.b, m_t * contact.f);
            let (normal_part, tangential_part) =
                (h.mul_add(contact.b, inertia), k.mul_add(contact.f, inertia));
            inverse = R::constant(1.0) / k.mul_add(contact.f, normal_part);
            // Each product contains a mass and a share of the total inertia: products of two masses would
            // overflow or underflow if the masses are extreme.
            normal = m_n * (tangential_part * inverse);
            mixed = -(h * (k * inverse));
            tangential = m_t * (normal_part * inverse);
            let [along, across] = contact.push(i, [h, k]);
            free_acceleration = inverse * torque;
            column = [along, across, h.dot2(contact.a, k, contact.e)];
        }
        // N_i times the object's column for its turn, (A_i, E_i).
        let turn = [normal.dot2(contact.a, mixed, contact.e), mixed.dot2(contact.a, tangential, contact.e)];
        let inertia = turn[0].dot2(contact.a, turn[1], contact.e);
        let (mut along, mut beside, mut across) = (normal, signed(i, mixed), tangential);
        if !contact.is_the_papers() {
            // The columns of N_i along the axes of the side become rows along the object's.
            let [normal, mixed] = contact.in_object_axes([along, beside]);
            let [other, tangential] = contact.in_object_axes([beside, across]);
            [along, beside] = contact.in_object_axes([normal, other]);
            [_, across] = contact.in_object_axes([mixed, tangential]);
        }
        let turn = contact.push(i, turn);
        Self { inverse, free_acceleration, column, along, mixed: beside, across, turn, inertia }
    }

    /// The acceleration of the finger for an acceleration of the object along its axes and about it.
    #[inline(always)]
    fn finger(&self, [along, across, turn]: [R; 3]) -> R {
        let [h, k, c] = self.column;
        self.inverse.neg_mul_add(h.mul_add(along, k.dot2(across, c, turn)), self.free_acceleration)
    }
}

/// v-dot of the object and of the fingers for the forces `f` and the bias `b`, which includes the share of driven
/// fingers. The rows of driven fingers are zero.
#[inline(always)]
fn pose_acceleration<R: Real>(
    driven: bool,
    geometry: &Geometry<R, impl Parts>,
    plant: &Plant<R>,
    f: &Coordinates<R>,
    b: &[R; 4],
) -> ([R; 3], [R; 2]) {
    let [right, left] = &geometry.contacts;
    let Coordinates { object: [m_x, m_y, m_theta], finger: inertia, compression: m_n, shear: m_t } =
        &plant.masses;

    // f_5 - Phi_5^T (f_d + M_d b), along the object's axes.
    let loads = [
        [m_n[0].mul_add(b[0], f.compression[0]), m_t[0].mul_add(b[2], f.shear[0])],
        [m_n[1].mul_add(b[1], f.compression[1]), m_t[1].mul_add(b[3], f.shear[1])],
    ];
    let pushes = [right.push(0, loads[0]), left.push(1, loads[1])];
    let [x, y, moment] = f.object;
    let [along, across] = geometry.inward([x, y]);
    let along = along + (-pushes[0][0] - pushes[1][0]);
    let across = across - (pushes[0][1] + pushes[1][1]);
    let moment = moment - (right.moment(loads[0]) + left.moment(loads[1]));

    // The object's own 3 x 3 system: M + sum of G_i^T N_i G_i.
    if driven && geometry.is_the_papers() {
        let (rh, rn) = (m_n[0] * right.a, m_t[0] * right.e);
        let (lh, ln) = (m_n[1] * left.a, m_t[1] * left.e);
        // Along the normal and across it the masses are constant, and only the rotation couples the two
        // directions.
        let (h, n) = (lh - rh, rn + ln);
        let (h_share, n_share) = (h * plant.inverse_driven_masses[0], n * plant.inverse_driven_masses[1]);
        let inertia = *m_theta + (rh.dot2(right.a, rn, right.e) + lh.dot2(left.a, ln, left.e));
        let turn = (moment - h_share.dot2(along, n_share, across)) / (inertia - h_share.dot2(h, n_share, n));
        let u = h_share.neg_mul_add(turn, along * plant.inverse_driven_masses[0]);
        let v = n_share.neg_mul_add(turn, across * plant.inverse_driven_masses[1]);
        let [x, y] = geometry.outward(u, v);
        return ([x, y, turn], [R::zero(); 2]);
    }
    let (surface1, surface2) = ([m_n[0], m_t[0]], [m_n[1], m_t[1]]);
    let (mut torque1, mut torque2) = (R::zero(), R::zero());
    if !driven {
        torque1 = f.finger[0] - right.torque(loads[0]);
        torque2 = f.finger[1] - left.torque(loads[1]);
    }
    let r = Eliminated::new(driven, 0, right, (inertia[0], torque1), surface1);
    let l = Eliminated::new(driven, 1, left, (inertia[1], torque2), surface2);
    let matrix = [
        *m_x + (r.along + l.along),
        l.mixed + r.mixed,
        *m_y + (r.across + l.across),
        l.turn[0] + r.turn[0],
        r.turn[1] + l.turn[1],
        *m_theta + (r.inertia + l.inertia),
    ];
    let (free1, free2) = (r.free_acceleration, l.free_acceleration);
    let load = [
        along - r.column[0].dot2(free1, l.column[0], free2),
        across - r.column[1].dot2(free1, l.column[1], free2),
        moment - r.column[2].dot2(free1, l.column[2], free2),
    ];
    let [u, v, turn] = solve3(&matrix, &load, plant.inverse_masses.object[0]);
    let [x, y] = geometry.outward(u, v);
    ([x, y, turn], [r.finger([u, v, turn]), l.finger([u, v, turn])])
}
