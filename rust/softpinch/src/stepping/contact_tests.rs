//! Pushes against a grasp with unilateral contact.

use crate::driver::simulate::simulate;
use crate::formulation::equations::States;
use crate::formulation::mode_selection::Contact;
use crate::formulation::unilateral::Unilateral;
use crate::model::contact_modes::Contacts;
use crate::model::drive::{Drive, SegmentDrive};
use crate::model::geometry::Geometry;
use crate::model::inputs::Inputs;
use crate::model::motion::Motion;
use crate::model::parameters::{Parameters, PidGains, Stabilization};
use crate::model::scene::Scene;
use crate::model::start::{State, contact};
use crate::stepping::contact_events::{Cause, ContactEnd, ContactRun};
use crate::stepping::event_stepper::EventStepper;
use crate::stepping::options::{Options, Steps};

type Equations = Unilateral<f64, PidGains>;

/// A step of the classical Runge-Kutta method.
fn rk4(equations: &Equations, drive: &SegmentDrive, tau: f64, h: f64, y: &States<f64>) -> States<f64> {
    let at = |by: f64, along: &States<f64>, t: f64| {
        let stage = std::array::from_fn(|n| by.mul_add(along[n], y[n]));
        equations.rate(&drive.at(t), &drive.contacts, &stage)
    };
    let k1 = equations.rate(&drive.at(tau), &drive.contacts, y);
    let k2 = at(0.5 * h, &k1, tau + 0.5 * h);
    let k3 = at(0.5 * h, &k2, tau + 0.5 * h);
    let k4 = at(h, &k3, tau + h);
    std::array::from_fn(|n| y[n] + h / 6.0 * (k1[n] + 2.0 * (k2[n] + k3[n]) + k4[n]))
}

/// A grasp that has come to rest with the fingers at 6 degrees.
fn at_rest() -> (Parameters, State) {
    let parameters = Parameters::default();
    let scene = Scene {
        initial: State::at_rest(contact(&parameters).unwrap()),
        parameters: parameters.clone(),
        inputs: Inputs::constant_targets([6_f64.to_radians(); 2]),
        check: true,
        duration: 2.0,
    };
    let options = Options { steps: Steps::Fixed(1e-4), every: 100_000, ..Options::default() };
    let (run, _) = simulate(&scene, &options, &|| false).unwrap();
    let last = run.last;
    (parameters, State { time: 0.0, memory: last.memory, p: last.p, ..State::at_rest(last.q) })
}

/// Goes on from a state with the inputs of each segment for its duration.
fn go(
    (parameters, state): &(Parameters, State),
    friction: f64,
    segments: &[(SegmentDrive, f64)],
    dt: f64,
) -> Result<(Motion<f64>, ContactRun), ContactEnd> {
    let mut parameters = parameters.clone();
    parameters.surroundings.friction = friction;
    let equations = Equations::new(&parameters, &Stabilization { alpha: 1000.0, beta: 1000.0 });
    let step =
        |drive: &SegmentDrive, tau: f64, h: f64, y: &States<f64>| Some(rk4(&equations, drive, tau, h, y));
    let mut stepper = EventStepper { equations: &equations, step };
    let mut run = ContactRun::new([Contact::touching(); 2]);
    let mut y = equations.begin(&Motion { q: state.q, p: state.p, memory: state.memory });
    let mut contacts = Contacts::sticking();
    for (drive, duration) in segments {
        let mut drive = drive.with_contacts(contacts);
        stepper.begin(&mut run, &mut drive, (0.0, dt), &mut y)?;
        for step in 0..(duration / dt).round() as u32 {
            y = stepper.advance(&mut run, &mut drive, (f64::from(step) * dt, dt), &y)?;
            // A contact that leaves the face is lost.
            let motion = equations.motion(&drive.at(0.0), &y);
            let geometry = Geometry::new(&equations.plant().sides, &motion.q, &motion.p);
            if geometry.contacts.iter().any(|contact| contact.a.abs() > 0.0245) {
                return Err(ContactEnd::NotSolved);
            }
        }
        contacts = drive.contacts;
    }
    let (drive, _) = &segments[0];
    Ok((equations.motion(&drive.at(0.0), &y), run))
}

/// Pushes a grasp at rest for 10 ms, and lets it go on for half a second.
fn push(
    rest: &(Parameters, State),
    friction: f64,
    force: [f64; 3],
    dt: f64,
) -> Result<(Motion<f64>, ContactRun), ContactEnd> {
    let drive = Inputs::constant_targets([6_f64.to_radians(); 2]).segment(0.0);
    let mut pushed = drive.clone();
    pushed.push_for_tests(force);
    go(rest, friction, &[(pushed, 0.01), (drive, 0.5)], dt)
}

/// The largest pushes that a grasp survives, from an event-driven simulation that shares no code with this one
/// (faces 49 mm high, mu 0.3, 0.5 and 0.8). It gives whole newtons, and tenths of a newton metre.
#[test]
fn pushes_are_survived_up_to_where_another_simulation_has_it() {
    let rest = at_rest();
    let survived = [
        ([0.0, 1.0, 0.0], [64.0, 90.0, 125.0], 1.0),
        ([0.0, -1.0, 0.0], [63.0, 94.0, 143.0], 1.0),
        ([0.0, 0.0, 1.0], [11.4, 16.5, 27.6], 0.1),
    ];
    for (direction, largest, digit) in survived {
        for (friction, largest) in [0.3, 0.5, 0.8].into_iter().zip(largest) {
            let holds = |size: f64| {
                push(&rest, friction, direction.map(|d| d * size), 1e-4)
                    .is_ok_and(|(_, run)| run.contacts.iter().all(|contact| contact.closed))
            };
            assert!(holds(largest - 0.5 * digit), "{direction:?} {friction} {largest}");
            assert!(!holds(largest + 1.5 * digit), "{direction:?} {friction} {largest}");
        }
    }
}

/// Through a slip, a graze, an opening and an impact the error falls with the fourth power of the step.
#[test]
fn the_method_keeps_its_order_across_all_kinds_of_events() {
    let rest = at_rest();
    let end = |steps: f64| push(&rest, 0.5, [150.0, 0.0, 0.0], 0.01 / steps).unwrap();
    let (exact, run) = end(3200.0);
    let causes: Vec<_> = run.changes.iter().map(|change| change.cause).collect();
    for cause in [Cause::Cone, Cause::Release, Cause::Share, Cause::Impact, Cause::Stop] {
        assert!(causes.contains(&cause), "{causes:?}");
    }
    assert!(run.impact_loss > 0.0);
    let error = |steps: f64| {
        let (found, run) = end(steps);
        assert_eq!(run.changes.iter().map(|change| change.cause).collect::<Vec<_>>(), causes);
        (0..9).map(|k| (found.q[k] - exact.q[k]).abs()).fold(0.0, f64::max)
    };
    let errors = [error(100.0), error(200.0), error(400.0)];
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((3.5..4.7).contains(&order), "{errors:?}");
    }
}

/// Where friction is enough and nothing pulls, the run is the bilateral one.
#[test]
fn a_grasp_that_neither_slips_nor_opens_is_the_bilateral_one() {
    let (parameters, initial) = at_rest();
    let scene = Scene {
        initial: initial.clone(),
        parameters: parameters.clone(),
        inputs: Inputs::constant_targets([6.2_f64.to_radians(), 6.0_f64.to_radians()]),
        check: true,
        duration: 0.05,
    };
    let options = Options { steps: Steps::Fixed(1e-4), every: 100_000, ..Options::default() };
    let (bilateral, _) = simulate(&scene, &options, &|| false).unwrap();
    let drive = scene.inputs.segment(0.0);
    let (found, run) = go(&(parameters, initial), 1.0, &[(drive, 0.05)], 1e-4).unwrap();
    assert!(run.changes.is_empty());
    for k in 0..9 {
        assert!((found.q[k] - bilateral.last.q[k]).abs() < 1e-15);
        assert!((found.p[k] - bilateral.last.p[k]).abs() < 1e-12);
    }
    assert!((found.q[3] - scene.initial.q[3]).abs() > 1e-3);
}
