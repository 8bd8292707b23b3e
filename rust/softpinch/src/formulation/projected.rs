//! The index-1 equations without stabilisation. After each step the state is put back on the constraints by
//! the smallest correction in the norm of the mass matrix (Lubich, "Extrapolation integrators for constrained
//! multibody systems", 1991; Hairer and Wanner, "Solving Ordinary Differential Equations II", VII.2).
//!
//! The position becomes q - M^-1 Phi_H^T mu, with mu from C^H = 0 by two Newton steps. This number is fixed,
//! so that every run does the same work. The velocity becomes p - M^-1 Phi^T nu with Phi p = 0, which takes
//! one linear solve. The change of energy by the correction counts as work of the constraints in the ledger.

use crate::formulation::contact_solve::Load;
use crate::formulation::{Carried, Equations, States, constrained, response};
use crate::model::{Contacts, Coordinates, Geometry, Input, Motion, Parts, Plant, each_coordinate, work};
use crate::number::{Bits, LaneTask, Real, solve2, task};

/// Newton steps of the correction of the position. RK4 leaves C^H at 1e-6 m even close to its stability
/// limit; the second Newton step then reaches round-off.
const NEWTON_STEPS: usize = 2;

task! {
    ['a, R: Real, E: Equations<R>]
    NewtonStep<'a, R, E>(equations: &'a E, q: &'a Coordinates<R>, free: [Bits; 2])
    for R => Coordinates<R> = newton_step::<R, E::Parts>(equations.plant(), q, free)
}

/// Moves q by one Newton step towards C^H = 0 along M^-1 Phi_H^T, without the constraints of the contacts in `free`.
#[inline(always)]
fn newton_step<R: Real, P: Parts>(plant: &Plant<R>, q: &Coordinates<R>, free: [Bits; 2]) -> Coordinates<R> {
    let zero = R::zero();
    let geometry = Geometry::<R, P>::of(&plant.sides, q, &Coordinates::zero());
    let w = &plant.inverse_masses;
    let ([w_x, _, w_theta], [r, l]) = (w.object, &geometry.contacts);
    let mut facing = -w_x;
    if !geometry.is_the_papers() {
        let (one, other) = (r.push(0, [R::constant(1.0), zero]), l.push(1, [R::constant(1.0), zero]));
        facing = w_x * one[0].dot2(other[0], one[1], other[1]);
    }
    let mut matrix = [
        (r.b * r.b).mul_add(w.finger[0], (r.a * r.a).mul_add(w_theta, w_x + w.compression[0])),
        (r.a * l.a).mul_add(w_theta, facing),
        (l.b * l.b).mul_add(w.finger[1], (l.a * l.a).mul_add(w_theta, w_x + w.compression[1])),
    ];
    let mut residuals = [r.holonomic, l.holonomic];
    if free[0] | free[1] != 0 {
        matrix[1] = R::select(free[0] | free[1], zero, matrix[1]);
        residuals = [R::select(free[0], zero, residuals[0]), R::select(free[1], zero, residuals[1])];
    }
    let [h1, h2] = solve2(&matrix, &residuals);
    let push = geometry.phi_transposed_times(&[h1, h2, zero, zero]);
    each_coordinate!([push, w, q] => push.neg_mul_add(w, q))
}

/// Puts a state back on the constraints that the modes of the contacts hold. It is a state of
/// [`Csm`](super::csm::Csm) or of unilateral contact.
#[inline(always)]
pub fn correct<R: Real, E: Equations<R>>(
    equations: &E,
    (driven, carried): (bool, Carried),
    input: &Input<R>,
    contacts: &Contacts<R>,
    y: &mut States<R>,
) {
    let plant = equations.plant();
    let left = equations.unpack(driven, input, y);
    let Motion { q: left_q, p: left_p, .. } = left;
    let free = if equations.opens() { contacts.free } else { [0; 2] };
    let mut q = left_q;
    for _ in 0..NEWTON_STEPS {
        let step = NewtonStep { equations, q: &q, free };
        q = if const { R::ORDER > 0 } { R::outlined(step) } else { step.run() };
    }
    let geometry = Geometry::<R, E::Parts>::of(&plant.sides, &q, &left_p);
    let (zero, finger_acceleration) = (R::zero(), [R::zero(); 2]);
    // Phi dp = -Phi p and M dp = Phi^T nu: this is the solve of (24) without a force.
    let drift = geometry.constraint_velocity();
    let force = Coordinates::zero();
    let mut change = constrained(driven, &geometry, plant, &force, &drift, &finger_acceleration).acceleration;
    let special = contacts.special();
    if equations.opens() && special != 0 {
        // Contacts that slip or graze keep C^H only, as those that slip without friction do.
        let up = [contacts.slip(0) | contacts.graze[0], contacts.slip(1) | contacts.graze[1]];
        let held = Contacts { up, down: [0; 2], graze: [0; 2], ..*contacts };
        let (couple, friction) = ([zero; 2], [zero; 2]);
        let load = Load { force, couple, friction, bias: drift, finger_acceleration };
        let own = response(driven, &geometry, plant, &held, &load).acceleration;
        change = Coordinates::select(special, &own, &change);
    }
    let p = each_coordinate!([left_p, change] => left_p + change);
    let works = *y;
    let corrected = Motion { q, p, ..left };
    *y = equations.begin(driven, &corrected);
    let states = equations.states(driven);
    if carried.ledger || carried.slips {
        y[states..].copy_from_slice(&works[states..]);
    }
    // Derivatives of unilateral contact are without the ledger.
    if carried.ledger && (R::ORDER == 0 || !equations.opens()) {
        // The energy that the correction adds is work of the constraints.
        let now = equations.energies(contacts, &corrected);
        let before = equations.energies(contacts, &left);
        let gain = (now.kinetic - before.kinetic)
            + ((now.elastic - before.elastic) + (now.gravity - before.gravity));
        let work = &mut y[states + work::CONSTRAINT];
        *work = *work + gain;
    }
}
