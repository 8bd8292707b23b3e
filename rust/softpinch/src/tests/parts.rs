//! The parts of a contact: the geometry of every kind of side beside differences and rigid bodies, the solves of (24)
//! beside dense matrices, and whole motions beside an independent program and beside a turned object.

use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

use crate::driver::simulate::simulate;
use crate::formulation::constrained::constrained;
use crate::formulation::contact_solve::{Load, response};
use crate::formulation::table::Formulation;
use crate::method::table::Method;
use crate::model::contact::Side;
use crate::model::contact::law::{Tip, TipLaw};
use crate::model::contact::shape::SideShape;
use crate::model::contact_modes::{ContactModel, Contacts, Mode};
use crate::model::control::Fingers;
use crate::model::coordinates::{Coordinates, each_coordinate};
use crate::model::forces::Plant;
use crate::model::geometry::Geometry;
use crate::model::inputs::Inputs;
use crate::model::parameters::{Finger, Fingertip, Friction, GraspedObject, Parameters};
use crate::model::piecewise::PiecewisePolynomial;
use crate::model::scene::Scene;
use crate::model::start::{State, consistent};
use crate::number::real::signed;
use crate::stepping::ending::Status;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::Run;

/// A hand without any symmetry, and an object with these tilts of its sides.
fn uneven(tilts: [f64; 2]) -> Parameters {
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
        shapes: tilts
            .map(|tilt| if tilt == 0.0 { SideShape::ParallelFace } else { SideShape::TiltedFace { tilt } }),
        ..Parameters::default()
    }
}

/// Tilts of both sides: parallel faces among them.
fn tilts() -> impl Strategy<Value = [f64; 2]> {
    prop::array::uniform2(prop_oneof![Just(0.0), -0.4..0.4_f64])
}

/// Coordinates near a grasp, and rates.
fn states() -> impl Strategy<Value = (Coordinates, Coordinates)> {
    (prop::array::uniform9(-1.0..1.0_f64), prop::array::uniform9(-1.0..1.0_f64)).prop_map(|(q, p)| {
        let size = [0.01, 0.01, 0.3, 0.3, 0.3, 0.003, 0.003, 0.002, 0.002];
        let middle = [0.0, 0.075, 0.0, 0.1, 0.1, 0.005, 0.005, 0.0, 0.0];
        (std::array::from_fn(|k| middle[k] + size[k] * q[k]).into(), p.into())
    })
}

/// C^N of a contact from the velocities of two rigid bodies at the foot of the perpendicular from the tip's centre, by
/// (7), (8) and the plane motion of the finger and of the object.
fn relative_velocity(parameters: &Parameters, i: usize, q: &Coordinates, p: &Coordinates) -> f64 {
    let (finger, tip) = (&parameters.fingers[i], &parameters.tips[i]);
    let s = signed(i, 1.0);
    let ([x, y, theta], [u, v, omega], turn) = (q.object, p.object, p.finger[i]);
    let (sin, cos) = q.finger[i].sin_cos();
    let inward = -finger.root_offset + finger.length * sin + finger.half_thickness * cos;
    let centre = [s * inward, finger.length * cos - finger.half_thickness * sin];
    let way = [s * (finger.length * cos - finger.half_thickness * sin), -(inward + finger.root_offset)];
    let angle = theta + s * parameters.shapes[i].tilt();
    let (normal, along) = ([angle.cos(), angle.sin()], [-angle.sin(), angle.cos()]);
    let foot: [f64; 2] = std::array::from_fn(|k| centre[k] + s * (tip.radius - q.compression[i]) * normal[k]);
    // A finger that turns inwards turns by -s_i.
    let turned = |from: [f64; 2], rate: f64| [-rate * (foot[1] - from[1]), rate * (foot[0] - from[0])];
    let by_object = turned([x, y], omega);
    let by_finger = turned(centre, -s * turn);
    let velocity = [u, v];
    (0..2).map(|k| along[k] * (velocity[k] + by_object[k] - way[k] * turn - by_finger[k])).sum::<f64>()
        + p.shear[i]
}

proptest! {
    /// The rows of Phi are those of the residuals, and Phi-dot p is their rate, with any sides.
    #[test]
    fn phi_and_its_rate_are_derivatives(tilts in tilts(), (q, p) in states()) {
        let sides = Side::both(&uneven(tilts));
        let step = 1e-6;
        let at = |time: f64| {
            let moved = each_coordinate!([q, p] => q + time * p);
            Geometry::new(&sides, &moved, &p)
        };
        let (now, before, after) = (at(0.0), at(-step), at(step));
        let rate = |of: fn(&Geometry<f64>) -> [f64; 4], k: usize| (of(&after)[k] - of(&before)[k]) / (2.0 * step);
        for i in 0..2 {
            prop_assert!((rate(Geometry::residuals, i) - now.constraint_velocity()[i]).abs() < 1e-8);
        }
        let own = now.phi_times(&p);
        for (k, (own, velocity)) in own.into_iter().zip(now.constraint_velocity()).enumerate() {
            prop_assert!((own - velocity).abs() < 1e-14);
            prop_assert!((rate(Geometry::constraint_velocity, k) - now.bias()[k]).abs() < 1e-7);
        }
        let phi = now.constraint_matrix();
        prop_assert!((phi * SVector::from(p.row()) - SVector::from(own)).amax() < 1e-14);
        let [lambda @ .., _, _, _, _, _] = p.row();
        let push = SVector::from(now.phi_transposed_times(&lambda).row());
        prop_assert!((phi.transpose() * SVector::from(lambda) - push).amax() < 1e-14);
    }

    /// C^N is the difference of the velocities of two rigid bodies where they touch, plus that of the shear.
    #[test]
    fn the_nonholonomic_constraint_compares_two_rigid_bodies(tilts in tilts(), (q, p) in states()) {
        let parameters = uneven(tilts);
        // The foot is where the tip's surface is only if C^H = 0.
        let [pose @ .., _, _, _, _] = q.row();
        let (q, _) = consistent(&parameters, &pose, &q.shear, &[0.0; 5]);
        let geometry = Geometry::new(&Side::both(&parameters), &q, &p);
        for i in 0..2 {
            let expected = relative_velocity(&parameters, i, &q, &p);
            prop_assert!((geometry.contacts[i].nonholonomic - expected).abs() < 1e-14);
        }
    }

    /// The solve of (24) is that of the dense matrices, for all sides and fingers.
    #[test]
    fn the_solves_are_those_of_dense_matrices(
        tilts in tilts(),
        (q, p) in states(),
        f in prop::array::uniform9(-10.0..10.0_f64),
        turns in prop::array::uniform2(-5.0..5.0_f64),
    ) {
        let f = f.into();
        let parameters = uneven(tilts);
        let geometry = Geometry::new(&Side::both(&parameters), &q, &p);
        solves_agree(&parameters, Fingers::Torque, &geometry, &f, turns)?;
        solves_agree(&parameters, Fingers::Driven, &geometry, &f, turns)?;
    }

    /// The gradient of each law is that of its energy; with the exponent 2 a power law is (5).
    #[test]
    fn gradients_are_those_of_the_energy(
        tilt in -0.8..0.8_f64,
        d_n in 1e-3..0.015_f64,
        d_t in -3e-3..3e-3_f64,
        exponent in 2..6_u32,
    ) {
        let law = TipLaw::Power { coefficient: std::f64::consts::PI * 0.3e6, exponent };
        let plain = Tip::<f64>::new(&Parameters::default(), 0);
        let power = Tip::<f64>::new(&Parameters { laws: [law; 2], ..Parameters::default() }, 0);
        for tip in [plain, power] {
            let at = |tilt: f64, d_n: f64, d_t: f64| tip.energy(tilt.sin(), tilt.cos(), d_n, d_t);
            let found = tip.gradient(tilt.sin(), tilt.cos(), d_n, d_t);
            let size = at(tilt, d_n, d_t).abs() + found.normal.abs() * d_n;
            let (e, h) = (1e-5, 1e-4 * d_n);
            let by_tilt = (at(tilt + e, d_n, d_t) - at(tilt - e, d_n, d_t)) / (2.0 * e);
            let by_normal = (at(tilt, d_n + h, d_t) - at(tilt, d_n - h, d_t)) / (2.0 * h);
            let by_shear = (at(tilt, d_n, d_t + h) - at(tilt, d_n, d_t - h)) / (2.0 * h);
            prop_assert!((found.tilt - by_tilt).abs() < 1e-6 * size);
            prop_assert!((found.normal - by_normal).abs() * d_n < 1e-6 * size);
            prop_assert!((found.tangential - by_shear).abs() * d_n < 1e-6 * size);
            if exponent == 2 {
                let same = plain.gradient(tilt.sin(), tilt.cos(), d_n, d_t);
                prop_assert!((found.tilt - same.tilt).abs() <= 1e-14 * size);
                prop_assert!((found.normal - same.normal).abs() * d_n <= 1e-14 * size);
                prop_assert!((found.tangential - same.tangential).abs() * d_n <= 1e-14 * size);
            }
        }
    }
}

/// Compares both solves, with both tips sticking, with that of [M -Phi^T; Phi 0].
fn solves_agree(
    parameters: &Parameters,
    fingers: Fingers,
    geometry: &Geometry<f64>,
    f: &Coordinates,
    turns: [f64; 2],
) -> Result<(), TestCaseError> {
    let plant = Plant::<f64>::new(parameters, fingers, false);
    let driven = plant.driven;
    let bias = geometry.bias();
    let phi = geometry.constraint_matrix();
    let mut dense = SMatrix::<f64, 13, 13>::zeros();
    let mut right = SVector::<f64, 13>::zeros();
    dense.fixed_view_mut::<9, 9>(0, 0).copy_from(&parameters.mass_matrix());
    dense.fixed_view_mut::<9, 4>(0, 9).copy_from(&-phi.transpose());
    dense.fixed_view_mut::<4, 9>(9, 0).copy_from(&phi);
    right.fixed_rows_mut::<9>(0).copy_from(&SVector::from(f.row()));
    right.fixed_rows_mut::<4>(9).copy_from(&-SVector::from(bias));
    if fingers == Fingers::Driven {
        // The schedule says how the fingers accelerate.
        for i in 0..2 {
            dense.row_mut(3 + i).fill(0.0);
            dense[(3 + i, 3 + i)] = 1.0;
            right[3 + i] = turns[i];
        }
    }
    let expected = dense.lu().solve(&right).expect("regular");
    let common = constrained(driven, geometry, &plant, f, &bias, &turns);
    let load = Load { force: *f, couple: [0.0; 2], friction: [0.5; 2], bias, finger_acceleration: turns };
    let mut contacts = Contacts::sticking();
    contacts.set(0, [Mode::Stick; 2], [0.0; 2]);
    let own = response(driven, geometry, &plant, &contacts, &load);
    for (acceleration, multipliers) in
        [(common.acceleration, common.multipliers), (own.acceleration, own.multipliers)]
    {
        let acceleration = acceleration.row();
        for k in 0..9 {
            prop_assert!((acceleration[k] - expected[k]).abs() < 1e-10 * (1.0 + expected.rows(0, 9).amax()));
        }
        for k in 0..4 {
            prop_assert!(
                (multipliers[k] - expected[9 + k]).abs() < 1e-10 * (1.0 + expected.rows(9, 4).amax())
            );
        }
    }
    Ok(())
}

/// A run from a state with constant targets and a push.
fn run(parameters: &Parameters, q: Coordinates, force: [f64; 3], duration: f64, options: &Options) -> Run {
    let push =
        PiecewisePolynomial::steps("push", [0.0; 3], &[0.05, 0.06], &[force, [0.0; 3]]).expect("valid");
    let schedule = PiecewisePolynomial::constant(TARGETS);
    let scene = Scene {
        parameters: parameters.clone().checked().expect("valid"),
        inputs: Inputs::new(schedule.into(), vec![push.into()], vec![], vec![], vec![]).expect("valid"),
        initial: State::at_rest(q),
        check: true,
        duration,
    };
    simulate(&scene, options, &|| false).expect("the scene is valid").0
}

/// 7 and 5 degrees.
const TARGETS: [f64; 2] = [0.122_173_047_639_603_07, 0.087_266_462_599_716_47];

/// The end, at t = 0.3 s, of a wedge of 5 degrees between the default fingers, from an independent program: Lagrange's
/// multipliers with SymPy's derivatives, DOP853, a relative tolerance of 1e-12.
const WEDGE: [f64; 9] = [
    -1.385_247_982_412e-3,
    7.408_072_911_657e-2,
    -1.615_560_289_250e-2,
    1.184_527_263_256e-1,
    8.335_354_991_280e-2,
    7.800_987_863_424e-3,
    7.818_712_239_524e-3,
    -1.246_784_095_719e-3,
    -8.579_974_243_627e-4,
];

#[test]
fn a_wedge_moves_as_an_independent_program_says() {
    let wedge = SideShape::TiltedFace { tilt: 5f64.to_radians() };
    let parameters = Parameters { shapes: [wedge; 2], ..Parameters::default() };
    let start = -1.007_714_305_820_468_4e-3;
    let q = Coordinates { object: [0.0, 0.0762, 0.0], finger: [start; 2], ..Coordinates::zero() };
    for (formulation, method, most) in [
        (Formulation::Nullspace, Method::Dop853, 1e-11),
        (Formulation::Csm, Method::Dop853, 1e-9),
        (Formulation::Projected, Method::Dop853, 1e-9),
        (Formulation::Nullspace, Method::Radau5, 1e-9),
    ] {
        let options =
            Options { steps: Steps::Free { tolerance: 1e-12 }, formulation, method, ..Options::default() };
        let run = run(&parameters, q, [0.0; 3], 0.3, &options);
        assert_eq!(run.status, Status::Completed, "{}", run.message);
        for (found, expected) in run.last.motion.q.row().into_iter().zip(WEDGE) {
            assert!((found - expected).abs() < most, "{formulation:?} {method:?}: {:?}", run.last.motion.q);
        }
    }
}

/// An object whose faces are tilted to the same side is a box with parallel faces that is turned, and narrower. Its
/// motions are the same, also where tips slip and open.
#[test]
fn a_slanted_object_moves_as_a_turned_box() {
    let tilt = 0.2_f64;
    let (width, friction) = (0.049, Friction { right: 0.25, left: 0.3 });
    let slanted = Parameters {
        shapes: [SideShape::TiltedFace { tilt: -tilt }, SideShape::TiltedFace { tilt }],
        friction,
        ..uneven([0.0; 2])
    };
    let slanted = Parameters {
        grasped: GraspedObject { com_offset: 0.0, width: width / tilt.cos(), ..slanted.grasped },
        ..slanted
    };
    let straight = Parameters {
        grasped: GraspedObject { width, ..slanted.grasped },
        shapes: Default::default(),
        ..slanted.clone()
    };
    let pose = [0.001, 0.075, 0.03, 0.12, 0.1];
    let (turned, _) = consistent(&straight, &pose, &[0.0; 2], &[0.0; 5]);
    let mut q = turned;
    q.object[2] -= tilt;
    for (contact, formulation, method) in [
        (ContactModel::Bilateral, Formulation::Csm, Method::Rk4),
        (ContactModel::Bilateral, Formulation::Nullspace, Method::Rosenbrock),
        (ContactModel::Bilateral, Formulation::Projected, Method::Rk4),
        (ContactModel::Unilateral, Formulation::Csm, Method::Rk4),
        (ContactModel::Unilateral, Formulation::Projected, Method::Rk4),
    ] {
        let options =
            Options { steps: Steps::Fixed(5e-5), contact, formulation, method, ..Options::default() };
        let force = [120.0, 40.0, 0.8];
        let (one, other) =
            (run(&slanted, q, force, 0.1, &options), run(&straight, turned, force, 0.1, &options));
        assert_eq!((one.status, other.status), (Status::Completed, Status::Completed), "{}", one.message);
        assert_eq!(one.contact_changes.len(), other.contact_changes.len());
        assert!(contact == ContactModel::Bilateral || one.contact_changes.len() > 3);
        let (found, mut expected) = (one.last.motion.q.row(), other.last.motion.q);
        expected.object[2] -= tilt;
        for (k, expected) in expected.row().into_iter().enumerate() {
            assert!((found[k] - expected).abs() < 1e-9, "{contact:?} {formulation:?}: coordinate {k}");
        }
    }
}

#[test]
fn tilts_and_laws_are_checked() {
    let shapes = [SideShape::ParallelFace, SideShape::TiltedFace { tilt: 1.6 }];
    let message = Parameters { shapes, ..Parameters::default() }.checked().unwrap_err().to_string();
    assert_eq!(message, "grasped.left.tilt = 1.6: must be between -pi/2 and pi/2");
    let law = TipLaw::Power { coefficient: 1.0, exponent: 1 };
    let laws = [law, TipLaw::InoueHirai];
    let message = Parameters { laws, ..Parameters::default() }.checked().unwrap_err().to_string();
    assert_eq!(message, "hand.tip.right.law.exponent = 1.0: must be at least 2");
}
