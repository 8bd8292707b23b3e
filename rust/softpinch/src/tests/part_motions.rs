//! Whole motions of hands and objects of every kind: beside an independent program, and beside a turned object.

use crate::driver::simulate::simulate;
use crate::formulation::table::Formulation;
use crate::method::table::Method;
use crate::model::contact::law::LawKind;
use crate::model::contact_modes::ContactModel;
use crate::model::coordinates::Coordinates;
use crate::model::inputs::Inputs;
use crate::model::parameters::{
    Friction, GraspedObject, Law, Mechanism, Parameters, PidGains, Side as Shape,
};
use crate::model::piecewise::PiecewisePolynomial;
use crate::model::scene::Scene;
use crate::model::start::{State, consistent};
use crate::stepping::ending::Status;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::Run;
use crate::tests::parts::{arc, face, jaw, parallelogram, uneven};

/// 7 and 5 degrees.
const TARGETS: [f64; 2] = [0.122_173_047_639_603_07, 0.087_266_462_599_716_47];

/// A run from a state with constant targets and a push.
fn run(parameters: &Parameters, q: Coordinates, force: [f64; 3], duration: f64, options: &Options) -> Run {
    run_to(parameters, TARGETS, q, force, duration, options)
}

/// The same with other targets.
fn run_to(
    parameters: &Parameters,
    target: [f64; 2],
    q: Coordinates,
    force: [f64; 3],
    duration: f64,
    options: &Options,
) -> Run {
    let push =
        PiecewisePolynomial::steps("push", [0.0; 3], &[0.05, 0.06], &[force, [0.0; 3]]).expect("valid");
    let schedule = PiecewisePolynomial::constant(target);
    let scene = Scene {
        parameters: parameters.checked().expect("valid"),
        inputs: Inputs::new(schedule.into(), vec![push.into()], vec![], vec![], vec![]).expect("valid"),
        initial: State::at_rest(q),
        check: true,
        duration,
    };
    simulate(&scene, options, &|| false).expect("the scene is valid").0
}

/// A scene of an independent program: Lagrange's multipliers with SymPy's derivatives, DOP853, a relative tolerance of
/// 1e-12. From rest, after 0.3 s.
struct Fact {
    name: &'static str,
    mechanisms: [Mechanism; 2],
    shapes: [Shape; 2],
    laws: [Law; 2],
    fingers: [f64; 2],
    compression: f64,
    target: [f64; 2],
    end: [f64; 9],
    multipliers: [f64; 4],
}

fn facts() -> [Fact; 7] {
    let power = Law {
        kind: LawKind::Power.number(),
        coefficient: 164033.00040192774,
        exponent: 1.67,
        ..Law::default()
    };
    let jaw = |direction, angle| Mechanism { height: 0.0762, ..jaw(direction, angle) };
    [
        Fact {
            name: "rotary_box",
            mechanisms: [Mechanism::default(); 2],
            shapes: [Shape::default(); 2],
            laws: [Law::default(); 2],
            fingers: [5.534780681120572e-20, 5.534780681120572e-20],
            compression: 0.0,
            target: [0.12217304763960307, 0.08726646259971647],
            end: [
                -0.001346838055026, 0.07406548820708, -0.01650797969207, 0.1187319636363, 0.08363528870847,
                0.007670215106133, 0.00767707245719, -0.0005463949904073, -0.0001633785582583,
            ],
            multipliers: [55.834128808, 55.817847553, -0.37484582475, 1.3559060491],
        },
        Fact {
            name: "jaw_box",
            mechanisms: [jaw(0.0, 0.0); 2],
            shapes: [Shape::default(); 2],
            laws: [Law::default(); 2],
            fingers: [-5e-18, -5e-18],
            compression: 0.0,
            target: [0.006, 0.0045],
            end: [
                -0.0007536733305154, 0.07614983181258, 1.544067322445e-07, 0.005945228394464,
                0.004437876363975, 0.005191555056203, 0.005191549702237, 5.016908593635e-05,
                5.01671664505e-05,
            ],
            multipliers: [25.446286848, 25.446240457, 0.49050410811, 0.49049258429],
        },
        Fact {
            name: "jaw_cylinder",
            mechanisms: [jaw(0.0, 0.0); 2],
            shapes: [arc(0.0245, [0.0; 2]); 2],
            laws: [Law::default(); 2],
            fingers: [-5e-18, -5e-18],
            compression: 0.0,
            target: [0.006, 0.0045],
            end: [
                -0.0007536733285709, 0.07614324135044, -9.334720402059e-07, 0.005945224998559,
                0.004437872968072, 0.005191510692249, 0.00519150531891, 6.139517398286e-05,
                6.139523652454e-05,
            ],
            multipliers: [25.446221968, 25.446175425, 0.56368588557, 0.56368588526],
        },
        Fact {
            name: "rotary_cylinder",
            mechanisms: [Mechanism::default(); 2],
            shapes: [arc(0.0245, [0.0; 2]); 2],
            laws: [Law::default(); 2],
            fingers: [5.671663003882787e-20, 5.671663003882787e-20],
            compression: 0.0,
            target: [0.10471975511965978, 0.08726646259971647],
            end: [
                -0.0006679592823091, 0.0740565044461, -0.009095270743779, 0.1020424694472, 0.08449203141684,
                0.007048602174677, 0.00705281078282, -4.515974414034e-05, 3.579848869986e-05,
            ],
            multipliers: [47.123935513, 47.119937185, 2.5672659451, 2.567271203],
        },
        Fact {
            name: "rotary_wedge",
            mechanisms: [Mechanism::default(); 2],
            shapes: [face(5f64.to_radians()); 2],
            laws: [Law::default(); 2],
            fingers: [-0.0010077143058204684, -0.0010077143058204684],
            compression: 0.0,
            target: [0.12217304763960307, 0.08726646259971647],
            end: [
                -0.001385247982412, 0.07408072911657, -0.0161556028925, 0.1184527263256, 0.0833535499128,
                0.007800987863424, 0.007818712239524, -0.001246784095719, -0.0008579974243627,
            ],
            multipliers: [57.765929844, 57.901014825, -5.4308143516, -3.7039132616],
        },
        Fact {
            name: "rotary_box_power",
            mechanisms: [Mechanism::default(); 2],
            shapes: [Shape::default(); 2],
            laws: [power; 2],
            fingers: [0.026270116999566676, 0.026270116999566676],
            compression: 0.002,
            target: [0.12217304763960307, 0.08726646259971647],
            end: [
                -0.001333186414205, 0.07476131812673, -0.01430115476183, 0.1194619327653, 0.08436227999607,
                0.007725004354097, 0.007730449094876, -0.0006296980712722, -0.0002208782099267,
            ],
            multipliers: [49.033370772, 49.019252541, -0.097808164563, 1.0788896417],
        },
        Fact {
            name: "parallelogram_box",
            mechanisms: [parallelogram(0.0); 2],
            shapes: [Shape::default(); 2],
            laws: [Law::default(); 2],
            fingers: [4.841728453465924e-17, 4.841728453465924e-17],
            compression: 0.0,
            target: [0.12217304763960307, 0.08726646259971647],
            end: [
                -0.001330475138333, 0.07576516145694, -0.005071150102188, 0.1186836898173, 0.08358319506429,
                0.007691965742235, 0.007691718519186, 6.521215083634e-06, 6.124323866946e-05,
            ],
            multipliers: [55.920618099, 55.915555453, 0.37573895844, 0.60533190765],
        },
    ]
}

#[test]
fn every_kind_moves_as_an_independent_program_says() {
    let stiff = PidGains { kp: 2e4, kd: 200.0, ki: 2e5 };
    for fact in facts() {
        let jaws = fact.name.starts_with("jaw");
        let control = if jaws { [stiff; 2] } else { [PidGains::default(); 2] };
        let Fact { name, mechanisms, shapes, laws, .. } = fact;
        let parameters = Parameters { mechanisms, shapes, laws, control, ..Parameters::default() };
        let mut q = Coordinates { object: [0.0, 0.0762, 0.0], finger: fact.fingers, ..Coordinates::zero() };
        q.compression = [fact.compression; 2];
        for (formulation, method, most) in [
            (Formulation::Nullspace, Method::Dop853, 1e-11),
            (Formulation::Csm, Method::Dop853, 1e-9),
            (Formulation::Projected, Method::Dop853, 1e-9),
            (Formulation::Nullspace, Method::Radau5, 1e-9),
        ] {
            let options = Options {
                steps: Steps::Free { tolerance: 1e-12 },
                formulation,
                method,
                ..Options::default()
            };
            let run = run_to(&parameters, fact.target, q, [0.0; 3], 0.3, &options);
            assert_eq!(run.status, Status::Completed, "{name}: {}", run.message);
            for (k, (found, expected)) in run.last.motion.q.row().into_iter().zip(fact.end).enumerate() {
                assert!(
                    (found - expected).abs() < most,
                    "{name} {formulation:?} {method:?} {k}: {found} {expected}"
                );
            }
            for (found, expected) in run.last.multipliers.into_iter().zip(fact.multipliers) {
                assert!((found - expected).abs() < 1e6 * most.max(1e-11), "{name}: {found} {expected}");
            }
        }
    }
}

/// An object whose faces are tilted to the same side is a box with parallel faces that is turned, and narrower. Its
/// motions are the same, also where tips slip and open.
#[test]
fn a_slanted_object_moves_as_a_turned_box() {
    let tilt = 0.2_f64;
    let (width, friction) = (0.049, Friction { right: 0.25, left: 0.3 });
    let slanted = Parameters { shapes: [face(-tilt), face(tilt)], friction, ..uneven() };
    let slanted = Parameters {
        grasped: GraspedObject { com_offset: 0.0, width: width / tilt.cos(), ..slanted.grasped },
        ..slanted
    };
    let straight = Parameters {
        grasped: GraspedObject { width, ..slanted.grasped },
        shapes: Default::default(),
        ..slanted
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
