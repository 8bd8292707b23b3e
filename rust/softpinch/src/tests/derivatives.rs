//! The chain of derivatives, from the parameters of a scene through its start, the steps of every method and the events of its
//! contacts to its rows and summaries, beside central differences of whole runs.

use proptest::prelude::*;

use crate::driver::request::{COMPONENTS, Direction, Request};
use crate::driver::sensitivities::sensitivities;
use crate::driver::simulate::simulate;
use crate::formulation::table::{FORMULATIONS, Formulation};
use crate::method::table::{METHODS, Method};
use crate::model::contact_modes::ContactModel;
use crate::model::control::Fingers;
use crate::model::inputs::{Impulse, Inputs};
use crate::model::motion::Motion;
use crate::model::parameters::{Friction, PAPERS, PARAMETER_COUNT, Parameters, Stabilization};
use crate::model::piecewise::PiecewisePolynomial;
use crate::model::scene::Scene;
use crate::model::start::{Start, State, contact, driven};
use crate::stepping::contact_events::Cause;
use crate::stepping::ending::Status;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::{Column, Run};
use crate::stepping::summary::{SUMMARIES, Wanted};

const STEPS: f64 = 4.0;
const DT: f64 = 5e-4;
/// The change of the direction's variable in the differences.
const CHANGE: f64 = 1e-5;

/// A line in the space of the scenes: the parameters, the targets of the fingers, and the force and the impulse on the object.
struct Line {
    fingers: Fingers,
    duration: f64,
    parameters: [[f64; PARAMETER_COUNT]; 2],
    target: [[f64; 2]; 2],
    force: [[f64; 3]; 2],
    /// The time of the impulse, s, if there is one.
    struck: Option<f64>,
    impulse: [[f64; 3]; 2],
}

impl Line {
    fn inputs(&self, target: [f64; 2], force: [f64; 3], impulse: [f64; 3]) -> Inputs {
        let (schedule, force) = (PiecewisePolynomial::constant(target), PiecewisePolynomial::constant(force));
        let impulses = self.struck.map(|time| Impulse { time, impulse }).into_iter().collect();
        let inputs = Inputs::new(schedule.into(), vec![force.into()], Vec::new(), impulses, Vec::new());
        inputs.unwrap().with_fingers(self.fingers)
    }

    /// The scene at a place of the line.
    fn scene(&self, at: f64) -> Scene {
        fn moved<const N: usize>([from, along]: &[[f64; N]; 2], at: f64) -> [f64; N] {
            std::array::from_fn(|k| from[k] + at * along[k])
        }
        let parameters = Parameters::from_array(&moved(&self.parameters, at)).unwrap();
        let inputs = self.inputs(moved(&self.target, at), moved(&self.force, at), moved(&self.impulse, at));
        let initial = if self.fingers == Fingers::Driven {
            driven(&parameters, &inputs, 0.0, ContactModel::Bilateral).unwrap()
        } else {
            State::at_rest(contact(&parameters).unwrap())
        };
        Scene { parameters, inputs, initial, check: true, duration: self.duration }
    }

    /// The direction of the line.
    fn direction(&self) -> Direction {
        Direction {
            parameters: self.parameters[1],
            inputs: self.inputs(self.target[1], self.force[1], self.impulse[1]),
            initial: Motion::zero(),
            shifts: Vec::new(),
            impulse_times: Vec::new(),
        }
    }

    /// Compares the derivatives of the scene's run along the line with central differences of whole runs: those of the rows
    /// at the options' times, of the times at which contacts change their modes, and of all summaries of the options. Each
    /// may be off by the share `allowed` of the largest one of its kind. Returns the run.
    fn require_derivatives(
        &self,
        options: &Options,
        change: f64,
        allowed: f64,
    ) -> Result<Run, TestCaseError> {
        let start = if self.fingers == Fingers::Driven { Start::Driven } else { Start::Contact };
        let rows = options.times.as_ref().unwrap();
        let wanted = SUMMARIES.map(|(_, summary)| summary);
        let wanted: Vec<_> = wanted.into_iter().filter(|&own| options.summaries.set.contains(own)).collect();
        let found = sensitivities(Request {
            scene: &self.scene(0.0),
            options,
            start: Some(start),
            directions: &[self.direction()],
            rows,
            summaries: &wanted,
            interrupted: &|| false,
        });
        let found = found.unwrap().unwrap();
        let [before, now, after] =
            [-change, 0.0, change].map(|at| simulate(&self.scene(at), options, &|| false).unwrap().0);
        for run in [&before, &now, &after] {
            prop_assert_eq!((run.status, run.recording.t()), (Status::Completed, &rows[..]));
        }
        let compare = |kind: &str, found: &[f64], of: &dyn Fn(&Run) -> Vec<f64>| {
            let (before, after) = (of(&before), of(&after));
            prop_assert_eq!((before.len(), after.len()), (found.len(), found.len()), "{}", kind);
            let slopes = before.iter().zip(&after).map(|(before, after)| (after - before) / (2.0 * change));
            let size = slopes.clone().fold(0.0_f64, |most, slope| most.max(slope.abs()));
            for (k, (slope, expected)) in found.iter().zip(slopes).enumerate() {
                prop_assert!(
                    (slope - expected).abs() <= allowed * size,
                    "{kind} {k}: {slope} {expected}, {options:?} {:?}",
                    self.fingers
                );
            }
            Ok(())
        };
        prop_assert_eq!(found.numbers.len(), rows.len() * COMPONENTS);
        for (row, numbers) in found.numbers.chunks(COMPONENTS).enumerate() {
            for (name, column, numbers) in
                [("q", Column::Q, &numbers[..9]), ("p", Column::P, &numbers[9..18])]
            {
                compare(name, numbers, &|run| run.recording.rows::<9>(column)[row].to_vec())?;
            }
        }
        let [(None, times)] = &found.ends[..] else { panic!("{:?}", found.ends) };
        compare("times", times, &|run| run.contact_changes.iter().map(|own| own.time).collect())?;
        for (&summary, &slope) in wanted.iter().zip(&found.summaries) {
            compare(summary.name(), &[slope], &|run| vec![run.summaries[summary as usize]])?;
        }
        Ok(now)
    }
}

/// A hand and an object of which nothing is symmetric, and the slopes of the parameters by their own `shares`. The object is
/// wider than the space between the tips.
fn uneven(friction: f64, shares: &[f64]) -> [[f64; PARAMETER_COUNT]; 2] {
    let mut parameters = Parameters::default();
    (parameters.grasped.width, parameters.grasped.com_offset) = (0.055, 0.003);
    (parameters.fingers[1].length, parameters.fingers[1].root_offset) = (0.074, 0.0485);
    parameters.tips[1].youngs_modulus = 2.5e5;
    parameters.friction = Friction { right: friction, left: 1.3 * friction };
    let values = parameters.to_array();
    // The numbers after the paper's are those of other parts.
    let along = std::array::from_fn(|k| {
        if k < PAPERS && values[k].is_finite() { 0.1 * shares[k] * values[k] } else { 0.0 }
    });
    [values, along]
}

proptest! {
    // Every case has four steps of all methods, formulations and kinds of fingers.
    #![proptest_config(ProptestConfig::with_cases(3))]

    /// The differences have an error of 1e-10 by the third derivatives, and round-off over the change, which is as small.
    #[test]
    fn derivatives_of_runs_agree_with_differences(
        shares in prop::collection::vec(-1.0..1.0_f64, PARAMETER_COUNT),
        target in prop::array::uniform2(0.02..0.1_f64),
        target_slope in prop::array::uniform2(-1.0..1.0_f64),
        force in prop::array::uniform3(-1.0..1.0_f64),
        force_slope in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        for fingers in [Fingers::Pid, Fingers::Driven] {
            let line = Line {
                fingers,
                duration: STEPS * DT,
                parameters: uneven(f64::INFINITY, &shares),
                target: [target, target_slope.map(|slope| 0.1 * slope)],
                force: [[force[0], force[1], 0.01 * force[2]], [force_slope[0], force_slope[1], 0.01 * force_slope[2]]],
                struck: None,
                impulse: [[0.0; 3]; 2],
            };
            for (_, method) in METHODS {
                for (_, formulation) in FORMULATIONS {
                    let options = Options {
                        method,
                        formulation,
                        steps: Steps::Fixed(DT),
                        stabilization: Stabilization { alpha: 300.0, beta: 200.0 },
                        times: Some(vec![line.duration]),
                        ..Options::default()
                    };
                    line.require_derivatives(&options, CHANGE, 1e-6)?;
                }
            }
        }
    }
}

/// A line in whose run a tip leaves the cone of friction, an impulse opens the other one, this one meets the object again, and
/// both slip and stop. `shares` are the slopes of the parameters by their values, `slopes` those of the inputs by their sizes.
fn eventful(shares: &[f64], slopes: [f64; 8]) -> Line {
    let [right, left, x, y, turn, along, across, twist] = slopes;
    Line {
        fingers: Fingers::Pid,
        duration: 0.01,
        parameters: uneven(0.2, shares),
        target: [[0.1, 0.08], [0.01 * right, 0.01 * left]],
        force: [[1.0, -20.0, 0.01], [x, y, 0.01 * turn]],
        struck: Some(0.0042),
        impulse: [[0.25, 0.07, 2e-4], [0.1 * along, 0.1 * across, 1e-4 * twist]],
    }
}

/// The options of unilateral contact with these steps. A row is before the impulse, one inside a step, and one at the end.
fn unilateral(method: Method, steps: Steps, line: &Line) -> Options {
    let times = Some(vec![0.003, 0.0067, line.duration]);
    Options { method, steps, times, contact: ContactModel::Unilateral, ..Options::default() }
}

proptest! {
    // A case has some events in the steps of all methods, and takes too long to look for a smaller one that fails.
    #![proptest_config(ProptestConfig { max_shrink_iters: 0, ..ProptestConfig::with_cases(1) })]

    /// The jumps of the derivatives at events, the times of the events, and all summaries that have a derivative. Only the
    /// direction is random: in a random scene two events may happen together, or a summary may have two extremes.
    #[test]
    fn derivatives_through_events_agree_with_differences(
        shares in prop::collection::vec(-1.0..1.0_f64, PARAMETER_COUNT),
        slopes in prop::array::uniform8(-1.0..1.0_f64),
    ) {
        let line = eventful(&shares, slopes);
        let set = SUMMARIES.into_iter().map(|(_, summary)| summary).filter(|own| own.is_differentiable()).collect();
        for (_, method) in METHODS {
            for formulation in [Formulation::Csm, Formulation::Projected] {
                let options = Options {
                    formulation,
                    summaries: Wanted { set, ..Wanted::default() },
                    ..unilateral(method, Steps::Fixed(DT), &line)
                };
                let run = line.require_derivatives(&options, CHANGE, 1e-6)?;
                let causes = run.contact_changes.iter().map(|change| change.cause);
                for cause in [Cause::Input, Cause::Cone, Cause::Stop, Cause::Impact, Cause::Other] {
                    prop_assert!(causes.clone().any(|own| own == cause), "{cause:?}: {:?}", run.contact_changes);
                }
            }
        }
    }
}

/// The derivatives hold the lengths of the steps, the runs beside theirs do not: so both agree as far as the error of the steps
/// allows. The direction is not random, because a step that one run alone refuses would be seen in the differences.
#[test]
fn derivatives_of_free_steps_agree_with_differences() {
    let shares: Vec<_> = (0..PARAMETER_COUNT).map(|k| (k as f64).sin()).collect();
    let line = eventful(&shares, [0.5, -0.3, 0.8, -0.6, 0.4, 0.7, -0.9, 0.2]);
    for (method, tolerance, contact) in [
        (Method::Dop853, 1e-10, ContactModel::Bilateral),
        (Method::Dop853, 1e-10, ContactModel::Unilateral),
        (Method::Rosenbrock, 1e-6, ContactModel::Unilateral),
        (Method::Radau5, 1e-6, ContactModel::Unilateral),
    ] {
        let options = Options { contact, ..unilateral(method, Steps::Free { tolerance }, &line) };
        line.require_derivatives(&options, 10.0 * CHANGE, 1e-4).unwrap();
    }
}
