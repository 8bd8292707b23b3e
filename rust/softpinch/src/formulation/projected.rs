//! The index-1 equations without stabilisation. After each step the state is put back on the constraints by
//! the smallest correction in the norm of the mass matrix (Lubich, "Extrapolation integrators for constrained
//! multibody systems", 1991; Hairer and Wanner, "Solving Ordinary Differential Equations II", VII.2).
//!
//! The position becomes q - M^-1 Phi_H^T mu, with mu from C^H = 0 by two Newton steps. This number is fixed,
//! so that every run does the same work. The velocity becomes p - M^-1 Phi^T nu with Phi p = 0, which takes
//! one linear solve. The change of energy by the correction counts as work of the constraints in the ledger.

use crate::formulation::constrained::constrained;
use crate::formulation::csm::{Csm, pack, unpack};
use crate::formulation::equations::{Equations, States};
use crate::model::control::Controller;
use crate::model::drive::Input;
use crate::model::energy::WORKS;
use crate::model::forces::Plant;
use crate::model::geometry::Geometry;
use crate::model::geometry::index::{D_N, FINGER, THETA, X};
use crate::model::motion::Motion;
use crate::number::linear::solve2;
use crate::number::real::Real;

/// Newton steps of the correction of the position. RK4 leaves C^H at 1e-6 m even close to its stability
/// limit; the second Newton step then reaches round-off.
const NEWTON_STEPS: usize = 2;

/// Moves q by one Newton step towards C^H = 0 along M^-1 Phi_H^T.
#[inline(always)]
fn nearer<R: Real, K: Controller<R>>(plant: &Plant<R, K>, q: &[R; 9]) -> [R; 9] {
    let geometry = Geometry::new(&plant.sides, q, &[R::zero(); 9]);
    let w = &plant.inverse_masses;
    let [r, l] = &geometry.contacts;
    let own =
        |i: usize, a: R, b: R| (b * b).mul_add(w[FINGER + i], (a * a).mul_add(w[THETA], w[X] + w[D_N + i]));
    let matrix = [own(0, r.a, r.b), (r.a * l.a).mul_add(w[THETA], -w[X]), own(1, l.a, l.b)];
    let [h1, h2] = solve2(&matrix, &[r.holonomic, l.holonomic]);
    let push = geometry.phi_transposed_times(&[h1, h2, R::zero(), R::zero()]);
    let mut moved = *q;
    for k in 0..9 {
        moved[k] = push[k].neg_mul_add(w[k], q[k]);
    }
    moved
}

/// Puts a state of [`Csm`] back on the constraints.
#[inline(always)]
pub fn correct<R: Real, K: Controller<R>>(
    plant: &Plant<R, K>,
    input: &Input<R>,
    y: &mut States<R>,
    ledger: bool,
) {
    let Motion { q: left_q, p: left_p, memory } = unpack::<R, K>(input, y);
    let mut q = left_q;
    for _ in 0..NEWTON_STEPS {
        q = nearer(plant, &q);
    }
    let geometry = Geometry::new(&plant.sides, &q, &left_p);
    // Phi dp = -Phi p and M dp = Phi^T nu: this is the solve of (24) without a force.
    let (force, swing) = ([R::zero(); 9], [R::zero(); 2]);
    let change = constrained(&geometry, plant, &force, &geometry.constraint_velocity(), &swing).acceleration;
    let mut p = left_p;
    for k in 0..9 {
        p[k] = left_p[k] + change[k];
    }
    let works = *y;
    *y = pack::<R, K>(&q, &p, &memory);
    if ledger {
        let (now, before) = (plant.energies(&q, &p), plant.energies(&left_q, &left_p));
        let gain = (now.kinetic - before.kinetic)
            + ((now.elastic - before.elastic) + (now.gravity - before.gravity));
        let first = <Csm<R, K> as Equations<R>>::STATES;
        y[first..first + WORKS].copy_from_slice(&works[first..first + WORKS]);
        y[first + 3] = y[first + 3] + gain;
    }
}
