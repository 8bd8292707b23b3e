//! The cost of a scene, in operations: those of one evaluation of its equations and of one step, on any
//! processor. `make operations` writes them into a table of the benchmarks.
//!
//! The scenes of the table have angles below 45 degrees, whose sines need no reduction. No two of their
//! numbers are equal by chance: equal operations on equal numbers count once, but the equations, which do not
//! know that two polynomials are equal, compute both.

use std::fmt::Write;

use super::counted::{Count, Counted, OPERATIONS, Operation, count};
use crate::formulation::equations::Carried;
use crate::formulation::equations::{Evaluation, Size, States};
use crate::formulation::scene_equations::{Choice, SceneEquations};
use crate::formulation::system::System;
use crate::formulation::table::{FORMULATIONS, Formulation};
use crate::method::dop853::Dop853;
use crate::method::rk4::Rk4;
use crate::method::traits::{Integrator, Stats, Step};
use crate::model::contact_modes::ContactModel;
use crate::model::control::{FINGERS, Fingers};
use crate::model::drive::{MAX_DEGREE, SegmentDrive};
use crate::model::energy::{Energies, closure};
use crate::model::inputs::{Inputs, Sinusoid};
use crate::model::motion::Motion;
use crate::model::parameters::{
    Finger, Fingertip, Friction, GraspedObject, Parameters, PidGains, Stabilization, Surroundings,
};
use crate::model::piecewise::PiecewisePolynomial;
use crate::model::start::contact;
use crate::number::real::Real;
use crate::stepping::instant::all_finite;
use crate::stepping::monitor::Limits;

/// The path of the table.
const TABLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../benchmarks/operations.py");

/// The equations and inputs of a scene, as far as its operations depend on them.
#[derive(Clone, Copy)]
struct Case {
    choice: Choice,
    /// The degree of the inputs' polynomials.
    degree: usize,
    /// The number of sines that act.
    sines: usize,
    /// Whether friction is limited, so that a monitor watches it.
    friction: bool,
}

/// The cost of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Cost {
    size: Size,
    /// One evaluation of the equations, with multipliers and residuals.
    evaluation: Count,
    /// One step of RK4 and one of DOP853: the evaluation at its start with the monitors, and the operations
    /// of the method.
    steps: [Count; 2],
}

/// The equations and inputs of a scene, and the instant at which it starts.
struct Start {
    parameters: Parameters,
    system: SceneEquations<Counted>,
    drive: SegmentDrive<Counted>,
    tau: Counted,
    y: States<Counted>,
}

/// Two different fingers, tips and controllers.
fn parameters(friction: f64) -> Parameters {
    let Finger { inertia, .. } = Finger::default();
    let left = Finger { length: 0.0761, root_offset: 0.0491, half_thickness: 0.0046, mass: 0.11, inertia };
    let soft = Fingertip {
        radius: 0.0201,
        youngs_modulus: 2e5,
        normal_viscosity: 90.0,
        tangential_viscosity: 80.0,
        tilt_coupling: 0.9,
        normal_mass: 0.2,
        tangential_mass: 0.3,
    };
    let parameters = Parameters {
        fingers: [Finger::default(), left],
        tips: [Fingertip::default(), soft],
        grasped: GraspedObject { mass: 0.08, ..GraspedObject::default() },
        control: [PidGains::default(), PidGains { kp: 90.0, kd: 0.9, ki: 900.0 }],
        surroundings: Surroundings::default(),
        friction: Friction { right: friction, left: friction },
        ..Parameters::default()
    };
    parameters.checked().expect("valid")
}

/// Polynomials of a given degree. No two of them have a coefficient in common.
fn polynomials<const C: usize>(degree: usize, first: f64) -> PiecewisePolynomial<C> {
    let coefficient = |channel: usize, k: usize| {
        if k > degree { 0.0 } else { first + 0.01 * channel as f64 + 0.001 * k as f64 }
    };
    let row = std::array::from_fn(|channel| std::array::from_fn(|k| coefficient(channel, k)));
    PiecewisePolynomial::new("inputs", vec![0.0], vec![row; 2]).expect("valid")
}

impl Case {
    fn start(&self) -> Start {
        let parameters = parameters(if self.friction { 0.5 } else { f64::INFINITY });
        let stabilization = Stabilization { alpha: 1000.0, beta: 900.0 };
        let system = SceneEquations::new(self.choice, &parameters, &stabilization);
        let sine = |k: usize| Sinusoid {
            start: 0.0,
            end: 1.0,
            omega: 9.0 + k as f64,
            phase: 0.1 + 0.01 * k as f64,
            amplitude: [1.0, 2.0, 3.0].map(|size| size + 0.1 * k as f64),
        };
        let (schedule, force) = (polynomials(self.degree, 0.1), polynomials(self.degree, 0.2));
        let sines = (0..self.sines).map(sine).collect();
        let inputs = Inputs::new(schedule.into(), vec![force.into()], sines, vec![], vec![]).expect("valid");
        let mut drive = SegmentDrive::still();
        drive.set(0, &inputs.segment(0.0));
        let motion = Motion { q: contact(&parameters).expect("within reach"), ..Motion::zero() };
        let mut y = system.begin(&Motion::<Counted>::constant(&motion));
        for number in &mut y[..system.size().all()] {
            *number = Counted::given(number.value());
        }
        Start { parameters, system, drive, tau: Counted::given(0.0), y }
    }

    fn evaluation(&self) -> Count {
        count(|| {
            let Start { system, drive, tau, y, .. } = self.start();
            let Evaluation { rate, multipliers, residuals, .. } = system.evaluate(&drive, tau, &y);
            [&rate[..system.size().all()], &multipliers, &residuals].concat()
        })
    }

    /// One step of a run, with its monitors.
    fn step(&self, mut method: impl Integrator<Counted, SceneEquations<Counted>>) -> Count {
        count(|| {
            let Start { parameters, system, drive, tau, y } = self.start();
            let size = system.size();
            let now = system.evaluate(&drive, tau, &y);
            let open = if size.works > 0 {
                let zero = Counted::zero();
                let initial_energies = Energies { kinetic: zero, elastic: zero, gravity: zero };
                let energies = system.energies(&drive.contacts, &now.motion);
                closure(&initial_energies, &energies, &y[size.states..][..size.works])
            } else {
                Counted::zero()
            };
            all_finite(&now, open);
            Limits::<Counted>::new(&parameters).violated(&now, None);
            let h = Counted::given(1e-4);
            let at = Step { system: &system, drive: &drive, tau, h, y: &y, rate: &now.rate, allowed: None };
            let mut next = y;
            method.step(&at, &mut next, &mut Stats::default()).unwrap();
            system.correct(&drive, tau + h, &mut next);
            next[..size.all()].to_vec()
        })
    }

    fn cost(&self) -> Cost {
        Cost {
            size: self.start().system.size(),
            evaluation: self.evaluation(),
            steps: [self.step(Rk4::default()), self.step(Dop853::default())],
        }
    }
}

/// A scene with constant inputs.
fn still(formulation: Formulation, fingers: Fingers) -> Case {
    Case {
        choice: Choice {
            formulation,
            contact: ContactModel::Bilateral,
            fingers,
            moves: false,
            carried: Carried::default(),
        },
        degree: 0,
        sines: 0,
        friction: false,
    }
}

/// Every choice of equations with its names.
fn choices() -> Vec<(&'static str, &'static str, Choice)> {
    let mut all = Vec::new();
    for (formulation_name, formulation) in FORMULATIONS {
        for (fingers_name, fingers) in FINGERS {
            for ledger in [false, true] {
                let contact = ContactModel::Bilateral;
                all.push((
                    formulation_name,
                    fingers_name,
                    Choice {
                        formulation,
                        contact,
                        fingers,
                        moves: false,
                        carried: Carried { ledger, slips: false },
                    },
                ));
            }
        }
    }
    all
}

/// The latency of the chain that follows the first sine in a step, less [`SINE`] for each sine. It is taken
/// from a step with very many sines, because only there this chain is the longest: sines do not wait for the
/// state.
fn sine_chain(choice: Choice) -> [u64; 2] {
    const MANY: usize = 50;
    let case = Case { choice, degree: 0, sines: MANY, friction: false };
    case.cost().steps.map(|step| step.latency() - SINE * MANY as u64)
}

/// Numbers as a Python tuple.
fn tuple(numbers: &[u64]) -> String {
    format!("({})", numbers.iter().map(u64::to_string).collect::<Vec<_>>().join(", "))
}

/// The table in the form that Python reads.
fn table() -> String {
    let mut kinds = String::new();
    for (name, flops, _) in OPERATIONS {
        writeln!(kinds, "    \"{name}\": {flops},").expect("a string takes it");
    }
    let (mut equations, mut costs) = (String::new(), String::new());
    for (formulation, fingers, choice) in choices() {
        let key = format!("\"{formulation}\", \"{fingers}\", {}", u8::from(choice.carried.ledger));
        let size = Case { choice, degree: 0, sines: 0, friction: false }.start().system.size();
        let (degrees, states, chains) = (size.degrees, size.all(), tuple(&sine_chain(choice)));
        writeln!(equations, "    ({key}): ({degrees}, {states}, {chains}),").expect("a string takes it");
        for degree in 0..=MAX_DEGREE {
            for sines in 0..3 {
                let Cost { evaluation, steps, .. } = Case { choice, degree, sines, friction: false }.cost();
                let operations = tuple(&evaluation.operations);
                let steps = tuple(&steps.map(|step| [step.flops(), step.latency()]).concat());
                writeln!(costs, "    ({key}, {degree}, {sines}): ({operations}, {steps}),")
                    .expect("a string takes it");
            }
        }
    }
    format!(
        r#""""Operation counts of evaluations and steps of a scene. `make operations` generates this file.

rust/softpinch/src/tests/operations.rs defines the counts; its tests fail if this file is out of
date. A latency is the length of the longest chain of dependent operations, in cycles.
"""

from typing import Final, TypeAlias

_Counts: TypeAlias = tuple[int, int, int, int, int, int, int, int]
_Steps: TypeAlias = tuple[int, int, int, int]

# Kind of operation -> the number of floating-point operations that it counts as.
KINDS: Final = {{
{kinds}}}

# The floating-point operations that limited friction adds to a step.
FRICTION: Final = {FRICTION}

# If sines act, the latency of a step is at least the latency in EQUATIONS of the chain that follows
# the first sine, plus this latency for each sine.
SINE: Final = {SINE}

# (formulation, fingers, 1 with a ledger or 0) -> (number of velocities, number of states, latency
# of the chain that follows the first sine in a step of RK4 and in a step of DOP853).
EQUATIONS: Final[dict[tuple[str, str, int], tuple[int, int, tuple[int, int]]]] = {{
{equations}}}

# (formulation, fingers, 1 with a ledger or 0, degree of the inputs' polynomials, number of sines up
# to two) -> (operations of an evaluation in the order of KINDS, (floating-point operations and
# latency of a step of RK4, floating-point operations and latency of a step of DOP853)). Each
# further sine adds as many operations as the second one.
COSTS: Final[dict[tuple[str, str, int, int, int], tuple[_Counts, _Steps]]] = {{
{costs}}}
"#
    )
}

/// The floating-point operations that watching friction takes: a product for each tip.
const FRICTION: u64 = 2;
/// The cycles in which the force of a sine is added to the other forces: a fused multiply-add and a choice.
const SINE: u64 = 5;

#[test]
fn the_table_has_the_counted_operations() {
    let written = std::fs::read_to_string(TABLE).expect("the table is there");
    let (written, counted) = (written.lines(), table());
    for (line, (found, expected)) in written.clone().zip(counted.lines()).enumerate() {
        assert_eq!(found, expected, "line {} of {TABLE} is out of date: `make operations`", line + 1);
    }
    assert_eq!(written.count(), counted.lines().count(), "{TABLE} is out of date: `make operations`");
}

#[test]
#[ignore = "it writes the table: `make operations`"]
fn write_the_table() {
    std::fs::write(TABLE, table()).expect("the table can be written");
}

/// The rules by which the reader of the table adds up costs.
#[test]
fn sines_and_friction_add_the_same_everywhere() {
    for (_, _, choice) in choices() {
        let flops = |case: Case| {
            let Cost { evaluation, steps: [rk4, dop853], .. } = case.cost();
            [evaluation.flops(), rk4.flops(), dop853.flops()].map(|number| number as i64)
        };
        let latency = |case: Case| case.cost().steps.map(|step| step.latency());
        let chain = sine_chain(choice);
        for degree in [0, MAX_DEGREE] {
            let of = |sines, friction| Case { choice, degree, sines, friction };
            let [two, three, six] = [2, 3, 6].map(|sines| flops(of(sines, false)));
            for k in 0..3 {
                assert_eq!(six[k] - two[k], 4 * (three[k] - two[k]));
            }
            let quiet = latency(of(0, false));
            for sines in [7, 20] {
                let longest = [0, 1].map(|k| quiet[k].max(chain[k] + SINE * sines as u64));
                assert_eq!(latency(of(sines, false)), longest, "{choice:?} {degree} {sines}");
            }

            let limited = flops(of(1, true));
            let free = flops(of(1, false));
            assert_eq!([0, 1, 2].map(|k| limited[k] - free[k]), [0, FRICTION as i64, FRICTION as i64]);
            assert_eq!(latency(of(1, true)), latency(of(1, false)));
        }
    }
}

#[test]
fn counted_numbers_have_the_values_of_plain_numbers() {
    let case = still(Formulation::Csm, Fingers::Pid);
    let Start { parameters, system, drive, tau, y } = case.start();
    let counted = system.evaluate(&drive, tau, &y);
    let stabilization = Stabilization { alpha: 1000.0, beta: 900.0 };
    let plain = SceneEquations::<f64>::new(case.choice, &parameters, &stabilization);
    let (schedule, force) = (polynomials(0, 0.1), polynomials(0, 0.2));
    let inputs = Inputs::new(schedule.into(), vec![force.into()], vec![], vec![], vec![]).expect("valid");
    let alone = plain.evaluate(&inputs.segment(0.0), 0.0, &y.map(Counted::value));
    assert_eq!(counted.rate.map(|number| number.value().to_bits()), alone.rate.map(f64::to_bits));
}

#[test]
fn a_step_of_rk4_is_four_evaluations_and_their_sum() {
    for formulation in [Formulation::Csm, Formulation::Nullspace] {
        let Cost { evaluation, steps: [step, _], .. } = still(formulation, Fingers::Pid).cost();
        assert_eq!(evaluation.of(Operation::Divide), 7);
        assert_eq!(step.of(Operation::Divide), 4 * 7);
        assert!(step.flops() < 4 * evaluation.flops() + 400, "{} {}", step.flops(), evaluation.flops());
        assert!(step.latency() > 2 * evaluation.latency());
    }
}

/// The operations of both kinds of inputs: five polynomials by Horner's scheme, and a sine with its three
/// amplitudes.
#[test]
fn inputs_take_the_operations_of_their_source() {
    let quiet = still(Formulation::Csm, Fingers::Pid);
    let of = |degree, sines| Case { degree, sines, ..quiet }.evaluation();
    let (fifth, fourth) = (of(5, 0), of(4, 0));
    assert_eq!(fifth.of(Operation::Fused) - fourth.of(Operation::Fused), 5);
    assert_eq!(fifth.flops() - fourth.flops(), 10);
    let sine = count(|| vec![Counted::given(0.3).sin_cos().0]).flops();
    // The angle and three forces are fused multiply-adds.
    assert_eq!(of(5, 1).flops() - fifth.flops(), sine + 4 * 2);
}

/// Driven fingers remove the PID control and the rows of the fingers from `nullspace`. In the remaining
/// system of the object the masses along and across the face do not depend on the pose.
#[test]
fn driven_fingers_take_fewer_operations() {
    let pid = still(Formulation::Nullspace, Fingers::Pid).cost();
    let driven = still(Formulation::Nullspace, Fingers::Driven).cost();
    let sizes = [pid, driven].map(|cost| (cost.size.states, cost.size.degrees));
    assert_eq!(sizes, [(14, 5), (8, 3)]);
    let divisions = [pid, driven].map(|cost| cost.evaluation.of(Operation::Divide));
    assert_eq!(divisions, [7, 3]);
    let flops = |cost: &Cost| (cost.evaluation.flops(), cost.steps[0].flops());
    let (less, more) = (flops(&driven), flops(&pid));
    assert!(less.0 + 40 < more.0 && less.1 + 200 < more.1, "{less:?} {more:?}");
}
