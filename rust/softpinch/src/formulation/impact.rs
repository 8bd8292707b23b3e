//! The impact law: Moreau's, without restitution, for all closed contacts at once.
//!
//! ```text
//! M dp = J + Phi^T Lambda,   w = Phi p after,   0 <= Lambda_i^H, g_i-dot >= 0, one of them 0,
//! |Lambda_i^N| <= mu_i Lambda_i^H,   v_i != 0: Lambda_i^N = -sign(v_i) mu_i Lambda_i^H
//! ```
//!
//! A closed contact sticks, slips up or down, or opens: at most 16 combinations, each of which takes one
//! linear solve. There is always a consistent combination; below the critical friction there is only one.
//! J is the impulse of a disturbance, or zero where a tip meets the object.

use crate::formulation::contact_solve::Load;
use crate::formulation::{Response, response};
use crate::model::{Contacts, Coordinates, Geometry, Mode, Plant, Slip, each_coordinate};
use crate::number::dot;

#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Impact {
    pub p: Coordinates,
    /// The impulses Lambda of the contacts, in the order of the multipliers, N s.
    pub impulses: [f64; 4],
    /// What each contact does in it: it sticks, slips or opens.
    pub modes: [Mode; 2],
    /// Kinetic energy that it takes, J: at least zero.
    pub loss: f64,
    /// Work of the impulse J, J.
    pub work: f64,
    /// Work of the torques that hold driven fingers at their speed, J.
    pub driving: f64,
}

/// What a closed contact may do in an impact, in the order of preference where several hold.
const CHOICES: [Mode; 4] = [Mode::Stick, Mode::Slip(Slip::Up), Mode::Slip(Slip::Down), Mode::Free];

/// The velocities after an impact of the contacts that are `closed`, with the impulse J on the object.
pub fn impact(
    geometry: &Geometry<f64>,
    plant: &Plant<f64>,
    p: &Coordinates,
    (closed, friction): ([bool; 2], [f64; 2]),
    impulse: [f64; 3],
) -> Impact {
    let before = geometry.constraint_velocity();
    let force = Coordinates { object: impulse, ..Coordinates::zero() };
    let load = Load { force, couple: [0.0; 2], friction, bias: before, finger_acceleration: [0.0; 2] };
    let choices = |i: usize| if closed[i] { &CHOICES[..] } else { &CHOICES[3..] };
    let mut best: Option<(f64, _, Response<f64>, [f64; 4])> = None;
    'found: for &right in choices(0) {
        for &left in choices(1) {
            let modes = [right, left];
            let mut contacts = Contacts::sticking();
            contacts.set(0, modes, [0.0; 2]);
            let found = response(plant.driven, geometry, plant, &contacts, &load);
            let change = geometry.phi_times(&found.acceleration);
            let after: [f64; 4] = std::array::from_fn(|k| before[k] + change[k]);
            let of = |i: usize| violation(i, modes[i], friction[i], &found, &after);
            let off: f64 = (0..2).filter(|&i| closed[i]).map(of).sum();
            // NaN is never better.
            if off < best.as_ref().map_or(f64::INFINITY, |(least, ..)| *least) {
                best = Some((off, modes, found, after));
            }
            if off == 0.0 {
                break 'found;
            }
        }
    }
    let Some((_, modes, found, after)) = best else {
        return Impact { p: *p, modes: [Mode::Free; 2], ..Impact::default() };
    };
    let change = &found.acceleration;
    let changed = each_coordinate!([p, change] => p + change);
    let impulses = found.multipliers;
    let loss = -(0..4).map(|k| impulses[k] * 0.5 * (before[k] + after[k])).sum::<f64>();
    let mean = std::array::from_fn(|k| 0.5 * (p.object[k] + changed.object[k]));
    let driving = if plant.driven { plant.driving_work(geometry, &impulses, p) } else { 0.0 };
    Impact { p: changed, impulses, modes, loss, work: dot(&impulse, &mean), driving }
}

/// How far the conditions of a mode are from holding, as a share of the sizes that are compared; zero if they hold.
fn violation(i: usize, mode: Mode, friction: f64, found: &Response<f64>, after: &[f64; 4]) -> f64 {
    let (along, across) = (found.multipliers[i], found.multipliers[2 + i]);
    let (gap_rate, slip) = (after[i], after[2 + i]);
    let size = along.abs() + across.abs();
    let speed = gap_rate.abs() + slip.abs();
    let short = |value: f64, of: f64| if value >= 0.0 { 0.0 } else { -value / of };
    match mode {
        Mode::Stick => short(friction * along - across.abs(), size),
        Mode::Slip(direction) => f64::max(short(along, size), short(direction.sign() * slip, speed)),
        Mode::Free | Mode::Graze => short(gap_rate, speed),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::contact::Side;
    use crate::model::control::Fingers;
    use crate::model::parameters::Parameters;
    use crate::model::start::contact;

    fn pressed(q: Coordinates, p: Coordinates) -> (Geometry<f64>, Plant<f64>) {
        let parameters = Parameters::default();
        (Geometry::<f64>::of(&Side::both(&parameters), &q, &p), Plant::new(&parameters, Fingers::Pid, false))
    }

    fn kinetic(plant: &Plant<f64>, p: &Coordinates) -> f64 {
        0.5 * plant.masses.row().iter().zip(&p.row()).map(|(mass, rate)| mass * rate * rate).sum::<f64>()
    }

    /// One tip meets the object without friction: it loses g-dot^2 / (2 S_hh).
    #[test]
    fn one_contact_without_friction_loses_what_the_effective_mass_says() {
        let q = contact(&Parameters::default()).unwrap();
        let p = [0.3, 0.1, 2.0, -1.0, 0.5, -0.2, 0.1, 0.05, -0.1].into();
        let (geometry, plant) = pressed(q, p);
        let approach = geometry.constraint_velocity()[0];
        assert!(approach < 0.0);
        let own = geometry.constraint_matrix().row(0).transpose();
        let inverse = plant.inverse_masses.row();
        let effective: f64 = (0..9).map(|k| own[k] * own[k] * inverse[k]).sum();
        let found = impact(&geometry, &plant, &p, ([true, false], [0.0; 2]), [0.0; 3]);
        assert!(matches!(found.modes[0], Mode::Slip(_)) && found.modes[1] == Mode::Free);
        assert!((found.loss - 0.5 * approach * approach / effective).abs() < 1e-15);
        assert!((kinetic(&plant, &p) - kinetic(&plant, &found.p) - found.loss).abs() < 1e-15);
    }

    /// Fingers that the schedule moves keep their speed.
    #[test]
    fn an_impact_on_a_driven_finger_does_not_change_its_speed() {
        let q = contact(&Parameters::default()).unwrap();
        let p = [0.3, 0.1, 2.0, -1.0, 0.5, -0.2, 0.1, 0.05, -0.1].into();
        let (geometry, _) = pressed(q, p);
        let plant = Plant::<f64>::new(&Parameters::default(), Fingers::Driven, false);
        let found = impact(&geometry, &plant, &p, ([true; 2], [0.5; 2]), [0.0; 3]);
        assert_eq!(found.p.finger, p.finger);
    }

    proptest! {
        /// Everything that the law demands holds, whatever the velocities, and energy is only lost.
        #[test]
        fn the_law_holds(
            tilt in -0.4..0.4_f64,
            p in prop::array::uniform9(-1.0..1.0_f64),
            friction in prop::array::uniform2(0.0..1.2_f64),
            impulse in prop::array::uniform3(-0.1..0.1_f64),
            closed in prop::array::uniform2(any::<bool>()),
        ) {
            let mut q = contact(&Parameters::default()).unwrap();
            (q.object[2], q.finger) = (tilt, [0.1 - tilt, 0.1 + 0.5 * tilt]);
            let p = p.into();
            let (geometry, plant) = pressed(q, p);
            for impulse in [[0.0; 3], impulse] {
                let found = impact(&geometry, &plant, &p, (closed, friction), impulse);
                let after = geometry.phi_times(&found.p);
                let gain = kinetic(&plant, &found.p) - kinetic(&plant, &p);
                prop_assert!((gain - (found.work - found.loss)).abs() < 1e-13);
                prop_assert!(impulse != [0.0; 3] || found.loss >= -1e-15);
                // M dp = J + Phi^T Lambda.
                let (push, after_p) = (geometry.phi_transposed_times(&found.impulses).row(), found.p.row());
                for k in 0..9 {
                    let given = if k < 3 { impulse[k] } else { 0.0 };
                    let change = plant.masses.row()[k] * (after_p[k] - p.row()[k]);
                    prop_assert!((change - given - push[k]).abs() < 1e-12);
                }
                for i in 0..2 {
                    let (along, across) = (found.impulses[i], found.impulses[2 + i]);
                    let (gap_rate, slip) = (after[i], after[2 + i]);
                    if !closed[i] {
                        prop_assert_eq!((along, across), (0.0, 0.0));
                        continue;
                    }
                    prop_assert!(along >= 0.0 && gap_rate >= -1e-12);
                    prop_assert!(along * gap_rate.abs() < 1e-12);
                    prop_assert!(across.abs() <= friction[i] * along + 1e-12);
                    if along > 1e-9 && slip.abs() > 1e-9 {
                        prop_assert!((across + slip.signum() * friction[i] * along).abs() < 1e-12);
                    }
                }
            }
        }
    }
}
