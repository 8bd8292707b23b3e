//! The paper's example must end where two independent simulations end, and runs must agree with the example
//! that writes (24) out with matrices.
//!
//! The examples are compiled into this module: a test or an example that is a crate of its own takes another
//! minute to optimise the whole of softpinch.

#[allow(dead_code)] // `main` is not used
#[path = "../examples/paper.rs"]
mod example;

#[allow(dead_code)] // `main` is not used
#[path = "../examples/csm_by_nalgebra.rs"]
mod specification;

mod counted;
mod derivatives;
mod documents;
mod operations;
mod part_motions;
mod parts;

use crate::driver::simulate::simulate;
use crate::method::table::Method;
use crate::model::coordinates::{Coordinates, each_coordinate};
use crate::model::inputs::Inputs;
use crate::model::motion::Motion;
use crate::model::parameters::{Finger, Fingertip, GraspedObject, Parameters, PidGains};
use crate::model::piecewise::PiecewisePolynomial;
use crate::model::scene::Scene;
use crate::model::start::{State, contact};
use crate::stepping::ending::Status;
use crate::stepping::options::Options;
use crate::stepping::record::{Column, Recordable};

/// The end of each operation, from independent programs with RK4 at 2e-4 s: x, y in mm, theta in degrees,
/// both d_n in mm.
const ENDS: [[f64; 5]; 8] = [
    [0.000, 74.020, 0.000, 7.936, 7.936],
    [-19.770, 71.893, -9.427, 6.242, 6.340],
    [9.960, 73.896, 5.879, 7.245, 7.194],
    [19.737, 72.182, 10.547, 6.414, 6.316],
    [15.855, 73.089, 8.586, 6.499, 6.427],
    [-15.806, 73.367, -7.766, 6.381, 6.455],
    [25.892, 71.029, 13.657, 6.222, 6.068],
    [-0.001, 75.692, 0.271, 6.624, 6.625],
];

#[test]
fn each_operation_ends_where_independent_programs_end() {
    let run = example::run().expect("the scene is valid");
    assert_eq!(run.status, Status::Completed, "{}", run.message);
    assert_eq!(run.recording.t().len(), 9);
    for (k, (&q, end)) in run.recording.rows::<9>(Column::Q)[1..].iter().zip(ENDS).enumerate() {
        assert_eq!(run.recording.t()[k + 1], 1.0 + k as f64);
        let Coordinates { object: [x, y, theta], compression: [right, left], .. } = q.into();
        let found = [1e3 * x, 1e3 * y, theta.to_degrees(), 1e3 * right, 1e3 * left];
        for (number, expected) in found.into_iter().zip(end) {
            assert!((number - expected).abs() <= 0.000_51, "operation {}: {found:?}, not {end:?}", k + 1);
        }
    }
}

/// A scene that has every term of (24) and no two equal numbers. It is pushed, it moves from the start, and
/// it starts off the constraints, so that the stabilisation acts.
fn lopsided() -> Scene {
    let (finger, tip) = (Finger::default(), Fingertip::default());
    let other =
        Finger { length: 0.0755, root_offset: 0.0485, half_thickness: 0.005, mass: 0.12, inertia: 6.1e-4 };
    let soft = Fingertip {
        radius: 0.0195,
        youngs_modulus: 0.25e6,
        normal_viscosity: 90.0,
        tangential_viscosity: 70.0,
        tilt_coupling: -0.7,
        normal_mass: 0.09,
        tangential_mass: 0.11,
    };
    let parameters = Parameters {
        fingers: [finger, other],
        tips: [tip, soft],
        grasped: GraspedObject { com_offset: 0.003, ..GraspedObject::default() },
        control: [PidGains::default(), PidGains { kp: 80.0, kd: 0.9, ki: 900.0 }],
        ..Parameters::default()
    };
    let mut initial = State::at_rest(contact(&parameters).expect("the tips reach the object"));
    let offset = Coordinates::from([1e-3, -2e-3, 0.05, 0.02, 0.04, 3e-3, 2.5e-3, 4e-4, -3e-4]);
    let q = initial.motion.q;
    initial.motion = Motion {
        q: each_coordinate!([q, offset] => q + offset),
        p: each_coordinate!([offset] => 10.0 * offset),
        memory: [-1e-3, 2e-3],
        ..initial.motion
    };
    let push = PiecewisePolynomial::constant([0.8, -1.3, 0.02]);
    let schedule = PiecewisePolynomial::constant([0.12, 0.07]);
    let inputs = Inputs::new(schedule.into(), vec![push.into()], vec![], vec![], vec![]).expect("valid");
    Scene { parameters, inputs, initial, check: false, duration: 0.05 }
}

#[test]
fn runs_agree_with_the_specification() {
    let scene = lopsided();
    let record = [Recordable::State, Recordable::Multipliers].into_iter().collect();
    let methods = [
        (Method::Rk4, specification::rk4 as specification::StepOf, 1e-11),
        (Method::ImplicitMidpoint, specification::midpoint, 1e-9),
    ];
    for (method, step, most) in methods {
        let options = Options { record, method, ..Options::default() };
        let (run, _) = simulate(&scene, &options, &|| false).expect("the scene is valid");
        assert_eq!((run.status, run.recording.t().len()), (Status::Completed, 501), "{}", run.message);
        let rows = specification::specified((&scene, &options.stabilization), step, (1e-4, 500));
        let differences = specification::differences(&rows, &run.recording);
        // This comparison fails for NaN as well.
        assert!(differences.iter().all(|&difference| difference <= most), "{method:?}: {differences}");
    }
}
