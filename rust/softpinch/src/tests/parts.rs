//! The parts of a contact: the geometry of every kind of side beside differences and rigid bodies, and the solves of (24)
//! beside dense matrices.

use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

use crate::formulation::constrained::constrained;
use crate::formulation::contact_solve::{Load, Response, response};
use crate::formulation::equations::Carried;
use crate::formulation::scene_equations::Choice;
use crate::formulation::system::System;
use crate::formulation::table::Formulation;
use crate::formulation::tangent::{Linear, Runs};
use crate::model::contact::law::{self, ElasticGradient, LawKind, Tip, WEIGHTS};
use crate::model::contact::mechanism::{Mechanism as Base, MechanismKind};
use crate::model::contact::shape::{Counterface, ShapeKind};
use crate::model::contact::{Any, Side};
use crate::model::contact_modes::{ContactModel, Contacts, Mode, Slip};
use crate::model::control::Fingers;
use crate::model::coordinates::{Coordinates, each_coordinate};
use crate::model::energy::work::CONSTRAINT;
use crate::model::forces::Plant;
use crate::model::geometry::Geometry;
use crate::model::inputs::Inputs;
use crate::model::motion::Motion;
use crate::model::parameters::{
    Finger, Fingertip, GraspedObject, Law, Mechanism, Parameters, Side as Shape, Stabilization,
};
use crate::model::start::consistent;
use crate::number::lanes::MOST;
use crate::number::real::signed;

fn gradient(tip: Tip<f64>, at: [f64; 4]) -> ElasticGradient<f64> {
    law::gradients(&[tip; 2], [at; 2])[0]
}

/// A hand without any symmetry.
pub(super) fn uneven() -> Parameters {
    let other =
        Finger { length: 0.0755, root_offset: 0.0485, half_thickness: 0.005, mass: 0.12, inertia: 6.1e-4 };
    let soft = Fingertip {
        radius: 0.0195,
        youngs_modulus: 0.25e6,
        tilt_coupling: -0.7,
        normal_mass: 0.03,
        tangential_mass: 0.02,
        ..Fingertip::default()
    };
    Parameters {
        fingers: [Finger::default(), other],
        tips: [Fingertip::default(), soft],
        grasped: GraspedObject { com_offset: 0.003, ..GraspedObject::default() },
        ..Parameters::default()
    }
}

pub(super) fn face(tilt: f64) -> Shape {
    Shape { kind: ShapeKind::Face.number(), tilt, ..Shape::default() }
}

pub(super) fn arc(radius: f64, [center_x, center_y]: [f64; 2]) -> Shape {
    Shape { kind: ShapeKind::Arc.number(), radius, center_x, center_y, ..Shape::default() }
}

pub(super) fn jaw(direction: f64, angle: f64) -> Mechanism {
    Mechanism { kind: MechanismKind::Jaw.number(), height: 0.075, direction, angle, ..Mechanism::default() }
}

pub(super) fn parallelogram(angle: f64) -> Mechanism {
    Mechanism { kind: MechanismKind::Parallelogram.number(), angle, ..Mechanism::default() }
}

/// Objects' sides of every kind.
fn shapes() -> impl Strategy<Value = [Shape; 2]> {
    let side = prop_oneof![
        Just(Shape::default()),
        (-0.4..0.4_f64).prop_map(face),
        (0.02..0.2_f64, -0.004..0.004_f64, -0.01..0.01_f64).prop_map(|(radius, x, y)| arc(radius, [x, y])),
    ];
    [side.clone(), side]
}

/// Mechanisms of every kind.
fn mechanisms() -> impl Strategy<Value = [Mechanism; 2]> {
    let one = prop_oneof![
        Just(Mechanism::default()),
        (-0.4..0.4_f64, -0.2..0.2_f64).prop_map(|(direction, angle)| jaw(direction, angle)),
        (-0.2..0.2_f64).prop_map(parallelogram),
    ];
    [one.clone(), one]
}

/// [`uneven`] with any mechanisms and sides.
fn hands() -> impl Strategy<Value = Parameters> {
    (shapes(), mechanisms()).prop_map(|(shapes, mechanisms)| Parameters { shapes, mechanisms, ..uneven() })
}

/// Any hand near a grasp, with rates. A jaw's travel is in metres.
fn grasps() -> impl Strategy<Value = (Parameters, Coordinates, Coordinates)> {
    (hands(), states()).prop_map(|(hand, (mut q, p))| {
        for i in 0..2 {
            q.finger[i] *= hand.finger_size(i, 0.02);
        }
        (hand, q, p)
    })
}

/// Coordinates near a grasp, and rates.
fn states() -> impl Strategy<Value = (Coordinates, Coordinates)> {
    (prop::array::uniform9(-1.0..1.0_f64), prop::array::uniform9(-1.0..1.0_f64)).prop_map(|(q, p)| {
        let size = [0.01, 0.01, 0.3, 0.3, 0.3, 0.003, 0.003, 0.002, 0.002];
        let middle = [0.0, 0.075, 0.0, 0.1, 0.1, 0.005, 0.005, 0.0, 0.0];
        (std::array::from_fn(|k| middle[k] + size[k] * q[k]).into(), p.into())
    })
}

/// C^N of a contact from the velocities of two rigid bodies at the foot of the perpendicular from the tip's centre, by the
/// plane motion of the tip's base and of the object.
fn relative_velocity(parameters: &Parameters, i: usize, q: &Coordinates, p: &Coordinates) -> f64 {
    let (s, shape) = (signed(i, 1.0), &parameters.shapes[i]);
    let ([x, y, theta], [u, v, omega], rate) = (q.object, p.object, p.finger[i]);
    let base = Base::<f64>::new(parameters, i).placed(q.finger[i]);
    let (centre, way) = ([s * base.centre[0], base.centre[1]], [s * base.way[0], base.way[1]]);
    let angle = match parameters.shape(i) {
        ShapeKind::Arc => {
            let (sin, cos) = theta.sin_cos();
            let [kx, ky] = [shape.center_x, shape.center_y];
            let middle = [x + kx * cos - ky * sin, y + kx * sin + ky * cos];
            f64::atan2(-s * (centre[1] - middle[1]), -s * (centre[0] - middle[0]))
        }
        _ => theta + s * shape.tilt,
    };
    let (normal, along) = ([angle.cos(), angle.sin()], [-angle.sin(), angle.cos()]);
    let thickness = parameters.tips[i].radius - q.compression[i];
    let foot: [f64; 2] = std::array::from_fn(|k| centre[k] + s * thickness * normal[k]);
    // A base that turns inwards turns by -s_i.
    let turned = |from: [f64; 2], rate: f64| [-rate * (foot[1] - from[1]), rate * (foot[0] - from[0])];
    let by_object = turned([x, y], omega);
    let by_base = turned(centre, -s * base.turn * rate);
    let velocity = [u, v];
    (0..2).map(|k| along[k] * (velocity[k] + by_object[k] - way[k] * rate - by_base[k])).sum::<f64>()
        + p.shear[i]
}

/// theta_p of both tips moves with the rates that [`Geometry::couples`] has as its rows.
fn tilts(sides: &[Side<f64>; 2], q: &Coordinates) -> [f64; 2] {
    [0, 1].map(|i| sides[i].tilt::<Any>(i, q).0)
}

proptest! {
    /// The rows of Phi are those of the residuals, and Phi-dot p is their rate, with any sides.
    #[test]
    fn phi_and_its_rate_are_derivatives((hand, q, p) in grasps()) {
        let sides = Side::both(&hand);
        let step = 1e-6;
        let at = |time: f64| {
            let moved = each_coordinate!([q, p] => q + time * p);
            Geometry::<f64>::of(&sides, &moved, &p)
        };
        let (now, before, after) = (at(0.0), at(-step), at(step));
        let rate = |of: fn(&Geometry<f64>) -> [f64; 4], k: usize| (of(&after)[k] - of(&before)[k]) / (2.0 * step);
        for i in 0..2 {
            prop_assert!((rate(Geometry::residuals, i) - now.constraint_velocity()[i]).abs() < 1e-8);
        }
        // Each entry is the derivative of C^H by its coordinate, or of C^N, which is linear in the rates, by its rate.
        let phi = now.constraint_matrix();
        for k in 0..9 {
            let beside = |by: f64, of_rate: bool| {
                let (mut places, mut rates) = (q.row(), p.row());
                if of_rate { rates[k] += by } else { places[k] += by }
                Geometry::<f64>::of(&sides, &places.into(), &rates.into()).residuals()
            };
            for row in 0..4 {
                let slope = |by: f64| (beside(by, row >= 2)[row] - beside(-by, row >= 2)[row]) / (2.0 * by);
                let by = if row < 2 { 10.0 * step } else { 1.0 };
                let expected = (4.0 * slope(by) - slope(2.0 * by)) / 3.0;
                prop_assert!((phi[(row, k)] - expected).abs() < 1e-8, "row {row} column {k}");
            }
        }
        let own = now.phi_times(&p);
        for (k, (own, velocity)) in own.into_iter().zip(now.constraint_velocity()).enumerate() {
            prop_assert!((own - velocity).abs() < 1e-14);
            let bias = now.bias()[k];
            prop_assert!((rate(Geometry::constraint_velocity, k) - bias).abs() < 1e-7 * (1.0 + bias.abs()));
        }
        prop_assert!((phi * SVector::from(p.row()) - SVector::from(own)).amax() < 1e-14);
        let [lambda @ .., _, _, _, _, _] = p.row();
        let push = SVector::from(now.phi_transposed_times(&lambda).row());
        prop_assert!((phi.transpose() * SVector::from(lambda) - push).amax() < 1e-14);
        for i in 0..2 {
            let [before, after] = [-step, step].map(|time| tilts(&sides, &each_coordinate!([q, p] => q + time * p))[i]);
            let turn = now.contacts[i].tilt_rate;
            prop_assert!(((after - before) / (2.0 * step) - turn).abs() < 1e-7 * (1.0 + turn * turn));
            prop_assert!((sides[i].tilt_rate(i, &q, &p) - turn).abs() < 1e-14);
            // The power of a couple is the couple times the rate of its tilt.
            let mut couples = [0.0; 2];
            couples[i] = -2.0;
            let (object, finger) = now.couples(couples);
            let power: f64 = (0..3).map(|k| object[k] * p.object[k]).sum::<f64>()
                + (0..2).map(|k| finger[k] * p.finger[k]).sum::<f64>();
            prop_assert!((power - 2.0 * turn).abs() < 1e-13);
        }
    }

    /// C^N is the difference of the velocities of two rigid bodies where they touch, plus that of the shear.
    #[test]
    fn the_nonholonomic_constraint_compares_two_rigid_bodies((parameters, q, p) in grasps()) {
        // The foot is where the tip's surface is only if C^H = 0.
        let [pose @ .., _, _, _, _] = q.row();
        let (q, _) = consistent(&parameters, &pose, &q.shear, &[0.0; 5]);
        let geometry = Geometry::<f64>::of(&Side::both(&parameters), &q, &p);
        for i in 0..2 {
            let expected = relative_velocity(&parameters, i, &q, &p);
            prop_assert!((geometry.contacts[i].nonholonomic - expected).abs() < 1e-14);
        }
    }

    /// The solves of (24) are those of the dense matrices, for all sides, fingers and modes. Few hands of the strategy have the
    /// paper's geometry, for which the solves have branches of their own, so each case has one more that does.
    #[test]
    fn the_solves_are_those_of_dense_matrices(
        (parameters, q, p) in grasps(),
        f in prop::array::uniform9(-10.0..10.0_f64),
        finger_acceleration in prop::array::uniform2(-5.0..5.0_f64),
        couple in prop::array::uniform2(prop_oneof![-0.5..-0.01_f64, 0.01..0.5_f64]),
        friction in prop::array::uniform2(0.0..0.8_f64),
        modes in prop::array::uniform2(prop::sample::select(&MODES[..])),
    ) {
        for parameters in [parameters, uneven()] {
            let geometry = Geometry::<f64>::of(&Side::both(&parameters), &q, &p);
            let load = Load { force: f.into(), couple, friction, bias: geometry.bias(), finger_acceleration };
            for fingers in [Fingers::Torque, Fingers::Driven] {
                solves_agree(&parameters, fingers, &geometry, &load, [Mode::Stick; 2])?;
                solves_agree(&parameters, fingers, &geometry, &load, modes)?;
            }
        }
    }

    /// The gradient of each law is that of its energy; with the exponent 2 a power law is (5), and so is a measured law with
    /// equal weights.
    #[test]
    fn gradients_are_those_of_the_energy(
        tilt in -0.8..0.8_f64,
        d_n in -2e-3..0.018_f64,
        d_t in -3e-3..3e-3_f64,
        exponent in prop_oneof![Just(2.0), 1.3..5.0_f64],
        foot in prop_oneof![Just(0.0), 1e-5..1e-3_f64],
        weights in prop::array::uniform::<_, WEIGHTS>(0.0..2e6_f64),
        counterface in prop_oneof![Just(Counterface::Flat), Just(Counterface::Cylinder), Just(Counterface::Sphere)],
    ) {
        let coefficient = std::f64::consts::PI * 0.3e6;
        let power = Law { kind: LawKind::Power.number(), coefficient, exponent, foot, ..Law::default() };
        let measured = Law { kind: LawKind::Measured.number(), range: 0.012, shear_factor: 0.6, ..Law::default() };
        let curved = Shape { counterface: counterface.number(), ..arc(0.03, [0.0; 2]) };
        let tip = |law: Law, shape: Shape, weights: [f64; WEIGHTS]| {
            Tip::<f64>::new(&Parameters { laws: [law; 2], shapes: [shape; 2], weights: [weights; 2], ..Parameters::default() }, 0)
        };
        let plain = tip(Law::default(), Shape::default(), weights);
        let even = [2.0 * coefficient; WEIGHTS];
        let same = tip(Law { shear_factor: 1.0, ..measured }, Shape::default(), even);
        let share = match counterface {
            Counterface::Flat => 1.0,
            Counterface::Cylinder => (1.0 + 0.02 / 0.03_f64).sqrt().recip(),
            Counterface::Sphere => (1.0 + 0.02 / 0.03_f64).recip(),
        };
        let found = gradient(plain, [tilt.sin(), tilt.cos(), d_n, d_t]);
        let [size, sixth] = [found.normal.abs() + found.tangential.abs() + 1e-3, 0.02];
        for (other, factor) in [(same, 1.0), (tip(Law::default(), curved, weights), share)] {
            let other = gradient(other, [tilt.sin(), tilt.cos(), d_n, d_t]);
            prop_assert!((other.tilt - factor * found.tilt).abs() <= 1e-12 * size * sixth);
            prop_assert!((other.normal - factor * found.normal).abs() <= 1e-12 * size);
            prop_assert!((other.tangential - factor * found.tangential).abs() <= 1e-12 * size);
        }
        for tip in [plain, tip(power, Shape::default(), weights), tip(measured, curved, weights)] {
            let at = |tilt: f64, d_n: f64, d_t: f64| law::energies(&[tip; 2], [[tilt.sin(), tilt.cos(), d_n, d_t]; 2])[0];
            let found = gradient(tip, [tilt.sin(), tilt.cos(), d_n, d_t]);
            let size = at(tilt, d_n, d_t).abs() + found.normal.abs() * d_n.abs() + 1e-9;
            let (e, h) = (1e-5, 1e-4 * d_n.abs().max(1e-5));
            let by_tilt = (at(tilt + e, d_n, d_t) - at(tilt - e, d_n, d_t)) / (2.0 * e);
            let by_normal = (at(tilt, d_n + h, d_t) - at(tilt, d_n - h, d_t)) / (2.0 * h);
            let by_shear = (at(tilt, d_n, d_t + h) - at(tilt, d_n, d_t - h)) / (2.0 * h);
            prop_assert!((found.tilt - by_tilt).abs() < 1e-6 * size);
            if (d_n.abs() - 1e-5).is_sign_positive() {
                prop_assert!((found.normal - by_normal).abs() * d_n.abs() < 1e-5 * size, "{} {}", found.normal, by_normal);
            }
            prop_assert!((found.tangential - by_shear).abs() * d_n.abs() < 1e-6 * size);
        }
    }
}

/// All modes of a contact.
const MODES: [Mode; 5] = [Mode::Stick, Mode::Slip(Slip::Up), Mode::Slip(Slip::Down), Mode::Graze, Mode::Free];

/// Compares the solve of contacts in these modes with that of [M -K; R S] (a, u) = (f, -b), whose blocks are written out by
/// the table of `formulation/contact_solve.rs`: S has the rows that hold for the multipliers. While both tips stick, the solve of contacts
/// that stick is compared, too.
fn solves_agree(
    parameters: &Parameters,
    fingers: Fingers,
    geometry: &Geometry<f64>,
    load: &Load<f64>,
    modes: [Mode; 2],
) -> Result<(), TestCaseError> {
    let plant = Plant::<f64>::new(parameters, fingers, false);
    let (driven, phi, bias) = (plant.driven, geometry.constraint_matrix(), SVector::from(load.bias));
    let (mut columns, mut rows) = (phi.transpose(), phi);
    let (mut of_multipliers, mut right) = (SMatrix::<f64, 4, 4>::zeros(), -bias);
    let mut holds = |row: usize, factors: [(usize, f64); 2]| {
        rows.row_mut(row).fill(0.0);
        right[row] = 0.0;
        for (column, factor) in factors {
            of_multipliers[(row, column)] += factor;
        }
    };
    for (i, mode) in modes.into_iter().enumerate() {
        let (along, across) = (i, 2 + i);
        match mode {
            Mode::Stick => {}
            Mode::Slip(slip) => holds(across, [(across, 1.0), (along, slip.sign() * load.friction[i])]),
            Mode::Graze => {
                let mut couples = [0.0; 2];
                couples[i] = load.couple[i];
                let (object, finger) = geometry.couples(couples);
                let couple = Coordinates { object, finger, ..Coordinates::zero() };
                columns.set_column(along, &SVector::from(couple.row()));
                holds(across, [(across, 1.0), (along, 0.0)]);
            }
            Mode::Free => {
                holds(along, [(along, 1.0), (across, 0.0)]);
                holds(across, [(along, 0.0), (across, 1.0)]);
            }
        }
    }
    let (mut masses, mut force) = (parameters.mass_matrix(), SVector::from(load.force.row()));
    if driven {
        // The schedule says how the fingers accelerate.
        for i in 0..2 {
            columns.row_mut(3 + i).fill(0.0);
            masses[(3 + i, 3 + i)] = 1.0;
            force[3 + i] = load.finger_acceleration[i];
        }
    }
    let inverse_masses = SMatrix::from_diagonal(&masses.diagonal().map(f64::recip));
    let determinant = (rows * inverse_masses * columns + of_multipliers).determinant();
    if determinant.abs() < 1e-9 {
        // Of two tips that graze, whose fingers do not tilt them, only the sum of the couples is known.
        prop_assert!(modes == [Mode::Graze; 2], "{determinant} {modes:?}");
        return Ok(());
    }
    let mut dense = SMatrix::<f64, 13, 13>::zeros();
    dense.fixed_view_mut::<9, 9>(0, 0).copy_from(&masses);
    dense.fixed_view_mut::<9, 4>(0, 9).copy_from(&-columns);
    dense.fixed_view_mut::<4, 9>(9, 0).copy_from(&rows);
    dense.fixed_view_mut::<4, 4>(9, 9).copy_from(&of_multipliers);
    let mut sides = SVector::<f64, 13>::zeros();
    sides.fixed_rows_mut::<9>(0).copy_from(&force);
    sides.fixed_rows_mut::<4>(9).copy_from(&right);
    let expected = dense.lu().solve(&sides).expect("regular");
    let (accelerations, unknowns) = (expected.fixed_rows::<9>(0), expected.fixed_rows::<4>(9));
    // A tip that grazes has the share of its couple among the unknowns, in place of a multiplier.
    let (mut multipliers, mut share) = (unknowns.into_owned(), [1.0; 2]);
    for i in 0..2 {
        match modes[i] {
            Mode::Graze => share[i] = std::mem::take(&mut multipliers[i]),
            Mode::Free => share[i] = 0.0,
            _ => {}
        }
    }
    let mut contacts = Contacts::sticking();
    contacts.set(0, modes, [0.0; 2]);
    let own = response(driven, geometry, &plant, &contacts, load);
    let mut solves = vec![own];
    if modes == [Mode::Stick; 2] {
        solves.push(constrained(
            driven,
            geometry,
            &plant,
            &load.force,
            &load.bias,
            &load.finger_acceleration,
        ));
    }
    let pivots = SVector::from(own.pivots);
    prop_assert!((pivots.product() - determinant).abs() <= 1e-10 * pivots.amax().powi(3));
    // A couple that hardly moves its tip's gap makes the system almost singular, and round-off of its share large.
    let allowed = 1e-10 * (1.0 + pivots.amin().recip());
    for Response { acceleration, multipliers: solved, share: parts, .. } in solves {
        let off = (SVector::from(acceleration.row()) - accelerations).amax();
        prop_assert!(off < allowed * (1.0 + accelerations.amax()), "{off} {modes:?}");
        let off = (SVector::from(solved) - multipliers).amax();
        prop_assert!(off < allowed * (1.0 + multipliers.amax()), "{off} {modes:?}");
        for i in 0..2 {
            prop_assert!((parts[i] - share[i]).abs() < allowed * (1.0 + share[i].abs()), "{modes:?}");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    /// The Jacobians of any hand are those of differences, in every formulation.
    #[test]
    fn jacobians_are_those_of_differences((hand, q, _) in grasps(), power in 1.5..3.0_f64) {
        let law = Law { kind: LawKind::Power.number(), coefficient: 2e5, exponent: power, foot: 1e-4, ..Law::default() };
        let laws = [law, Law::default()];
        let hand = Parameters { laws, ..hand };
        let [pose @ .., _, _, _, _] = q.row();
        let (q, p) = consistent(&hand, &pose, &[4e-4, -3e-4], &[0.02, -0.01, 0.3, 0.01, -0.01]);
        prop_assume!(q.compression.iter().all(|d_n| *d_n > 1e-3));
        let inputs = Inputs::constant([0.1, 0.08], [1.0, 2.0, 0.01], Fingers::Pid);
        let drive = inputs.segment(0.0);
        for formulation in [Formulation::Csm, Formulation::Nullspace] {
            let gains = Stabilization { alpha: 300.0, beta: 200.0 };
            let choice = Choice { formulation, contact: ContactModel::Bilateral, fingers: Fingers::Pid, moves: false, carried: Carried::default() };
            let runs = Runs { choice, parameters: [&hand; MOST], gains: &gains };
            let (system, tangent) = (runs.system::<f64>(), runs.tangent::<f64>());
            let y = system.begin(&Motion { q, p, memory: [1e-3, -1e-3], ..Motion::zero() });
            let found = tangent.jacobian(&drive, 0.0, &y).rows;
            let states = system.size().states;
            for column in 0..states {
                let step = 1e-6 * (1e-3 + y[column].abs());
                let beside = |by: f64| {
                    let mut moved = y;
                    moved[column] += by;
                    system.evaluate(&drive, 0.0, &moved).rate
                };
                let (before, after) = (beside(-step), beside(step));
                for row in 0..states {
                    let expected = (after[row] - before[row]) / (2.0 * step);
                    let size = after[row].abs() / step * 1e-12 + 1e-4 * expected.abs() + 1e-5;
                    prop_assert!((found[row][column] - expected).abs() < size, "{formulation:?} {row} {column}: {} {expected}", found[row][column]);
                }
            }
        }
    }
}

proptest! {
    /// `projected` puts a state that has drifted back on the constraints which the modes hold, by the smallest change in the
    /// norm of the masses: what it changes is in the span of M^-1 Phi^T, with the held rows. Rates, in which the constraints
    /// are linear, are those of the dense projection; coordinates, which are 1e-6 m beside the constraints, change so to first
    /// order. The ledger books the energy that this adds, and nothing else of the state changes.
    #[test]
    fn a_corrected_state_is_the_nearest_one_on_the_constraints(
        (hand, q, p) in grasps(),
        drift in prop::array::uniform9(-1e-6..1e-6_f64),
        modes in prop::option::of(prop::array::uniform2(prop::sample::select(&MODES[..]))),
        fingers in prop::sample::select(vec![Fingers::Pid, Fingers::Driven]),
        carried in any::<[bool; 2]>().prop_map(|[ledger, slips]| Carried { ledger, slips }),
        works in prop::array::uniform8(-1.0..1.0_f64),
    ) {
        // Few hands of the strategy have the paper's geometry, which has code of its own.
        for hand in [hand, uneven()] {
            let contact = if modes.is_some() { ContactModel::Unilateral } else { ContactModel::Bilateral };
            let choice = Choice { formulation: Formulation::Projected, contact, fingers, moves: false, carried };
            let runs = Runs { choice, parameters: [&hand; MOST], gains: &Stabilization::default() };
            let system = runs.system::<f64>();
            let [pose @ .., _, _, _, _] = q.row();
            let (on, _) = consistent(&hand, &pose, &q.shear, &[0.0; 5]);
            let (mut off, mut rates): (Coordinates, _) = (std::array::from_fn(|k| on.row()[k] + drift[k]).into(), p);
            if fingers == Fingers::Driven {
                (off.finger, rates.finger) = (on.finger, [0.0; 2]);
            }
            let mut drive = Inputs::constant(on.finger, [0.0; 3], fingers).segment(0.0);
            let modes = modes.unwrap_or_default();
            drive.contacts.set(0, modes, [0.1, -0.2]);
            let left = Motion { q: off, p: rates, memory: [1e-3, -1e-3], ..Motion::zero() };
            let (size, mut y) = (system.size(), system.begin(&left));
            y[size.states..size.all()].copy_from_slice(&works[..size.all() - size.states]);
            let before = y;
            system.correct(&drive, 0.0, &mut y);
            let now = system.evaluate(&drive, 0.0, &y).motion;

            let geometry = Geometry::<f64>::of(&Side::both(&hand), &now.q, &now.p);
            let mut inverse_masses = SMatrix::from_diagonal(&hand.masses().row().map(f64::recip).into());
            if fingers == Fingers::Driven {
                inverse_masses.fixed_view_mut::<2, 2>(3, 3).fill(0.0);
            }
            // The part of a change in the span of M^-1 Phi^T, without the rows that are not held.
            let part = |held: [bool; 4], change: SVector<f64, 9>| {
                let (mut rows, mut gram) = (geometry.constraint_matrix(), SMatrix::<f64, 4, 4>::zeros());
                for row in (0..4).filter(|&row| !held[row]) {
                    rows.row_mut(row).fill(0.0);
                    gram[(row, row)] = 1.0;
                }
                gram += rows * inverse_masses * rows.transpose();
                inverse_masses * rows.transpose() * gram.lu().solve(&(rows * change)).expect("regular")
            };
            let [closed, sticks] = [modes.map(Mode::is_closed), modes.map(|mode| mode == Mode::Stick)];
            let held = [closed[0], closed[1], sticks[0], sticks[1]];
            for row in (0..4).filter(|&row| held[row]) {
                prop_assert!(row >= 2 || geometry.residuals()[row].abs() < 1e-15);
                prop_assert!(geometry.constraint_velocity()[row].abs() < 1e-14);
            }
            let of = |coordinates: Coordinates| SVector::from(coordinates.row());
            let size_of = |change: SVector<f64, 9>| change.dot(&(hand.mass_matrix() * change)).sqrt();
            let moved = of(now.q) - of(off);
            let beside = moved - part([closed[0], closed[1], false, false], moved);
            prop_assert!(size_of(beside) <= 1e-3 * size_of(moved), "{beside} {moved}");
            let sped = of(now.p) - of(rates);
            prop_assert!(size_of(sped + part(held, of(rates))) < 1e-13, "{sped}");

            let energy = |motion: &Motion<f64>| {
                let energies = system.energies(&drive.contacts, motion);
                0.5 * size_of(of(motion.p)).powi(2) + energies.elastic + energies.gravity
            };
            let (mut expected, booked) = (before, size.states + CONSTRAINT);
            expected[..2 * size.degrees].copy_from_slice(&y[..2 * size.degrees]);
            if carried.ledger {
                expected[booked] += energy(&now) - energy(&left);
                prop_assert!((y[booked] - expected[booked]).abs() <= 1e-14 * (1.0 + energy(&now).abs()));
                expected[booked] = y[booked];
            }
            prop_assert_eq!(y, expected);
        }
    }
}

#[test]
fn numbers_of_parts_are_checked() {
    let message =
        Parameters { shapes: [face(0.0), face(1.6)], ..Parameters::default() }.checked().unwrap_err();
    assert_eq!(message.to_string(), "grasped.left.tilt = 1.6: must be between -pi/2 and pi/2");
    let law = Law { kind: LawKind::Power.number(), exponent: 1.0, ..Law::default() };
    let laws = [law, Law::default()];
    let message = Parameters { laws, ..Parameters::default() }.checked().unwrap_err().to_string();
    assert_eq!(message, "hand.tip.right.law.exponent = 1.0: must be finite and > 1");
}
