//! The chain of derivatives, from the parameters of a scene through its start and the steps of every method to the last
//! state, beside central differences of whole runs.

use proptest::prelude::*;

use crate::driver::request::{COMPONENTS, Direction, Request};
use crate::driver::sensitivities::sensitivities;
use crate::driver::simulate::simulate;
use crate::formulation::table::FORMULATIONS;
use crate::method::table::METHODS;
use crate::model::contact_modes::ContactModel;
use crate::model::control::Fingers;
use crate::model::inputs::Inputs;
use crate::model::motion::Motion;
use crate::model::parameters::{PAPERS, PARAMETER_COUNT, Parameters, Stabilization};
use crate::model::scene::Scene;
use crate::model::start::{Start, State, contact, driven};
use crate::stepping::options::{Options, Steps};

const STEPS: f64 = 4.0;
const DT: f64 = 5e-4;
/// The change of the direction's variable in the differences.
const CHANGE: f64 = 1e-5;

/// A line in the space of the scenes: the parameters, the targets of the fingers and the force on the object.
struct Line {
    fingers: Fingers,
    parameters: [[f64; PARAMETER_COUNT]; 2],
    target: [[f64; 2]; 2],
    force: [[f64; 3]; 2],
}

impl Line {
    /// The scene at a place of the line.
    fn scene(&self, at: f64) -> Scene {
        fn moved<const N: usize>([from, along]: &[[f64; N]; 2], at: f64) -> [f64; N] {
            std::array::from_fn(|k| from[k] + at * along[k])
        }
        let parameters = Parameters::from_array(&moved(&self.parameters, at)).unwrap();
        let inputs = Inputs::constant(moved(&self.target, at), moved(&self.force, at), self.fingers);
        let initial = if self.fingers == Fingers::Driven {
            driven(&parameters, &inputs, 0.0, ContactModel::Bilateral).unwrap()
        } else {
            State::at_rest(contact(&parameters).unwrap())
        };
        Scene { parameters, inputs, initial, check: true, duration: STEPS * DT }
    }

    /// The direction of the line.
    fn direction(&self) -> Direction {
        Direction {
            parameters: self.parameters[1],
            inputs: Inputs::constant(self.target[1], self.force[1], self.fingers),
            initial: Motion::zero(),
            shifts: Vec::new(),
            impulse_times: Vec::new(),
        }
    }
}

proptest! {
    // Every case has four steps of all methods, formulations and kinds of fingers.
    #![proptest_config(ProptestConfig::with_cases(3))]

    #[test]
    fn derivatives_of_runs_agree_with_differences(
        shares in prop::collection::vec(-1.0..1.0_f64, PARAMETER_COUNT),
        target in prop::array::uniform2(0.02..0.1_f64),
        target_slope in prop::array::uniform2(-1.0..1.0_f64),
        force in prop::array::uniform3(-1.0..1.0_f64),
        force_slope in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        let mut parameters = Parameters::default();
        // The object is wider than the space between the tips, and nothing is symmetric.
        (parameters.grasped.width, parameters.grasped.com_offset) = (0.055, 0.003);
        (parameters.fingers[1].length, parameters.tips[1].youngs_modulus) = (0.074, 2.5e5);
        let values = parameters.to_array();
        // The numbers after the paper's are those of other parts.
        let along = std::array::from_fn(|k| {
            if k < PAPERS && values[k].is_finite() { 0.1 * shares[k] * values[k] } else { 0.0 }
        });
        for (fingers, start) in [(Fingers::Pid, Start::Contact), (Fingers::Driven, Start::Driven)] {
            let line = Line {
                fingers,
                parameters: [values, along],
                target: [target, target_slope.map(|slope| 0.1 * slope)],
                force: [[force[0], force[1], 0.01 * force[2]], [force_slope[0], force_slope[1], 0.01 * force_slope[2]]],
            };
            for (name, method) in METHODS {
                for (formulation_name, formulation) in FORMULATIONS {
                    let gains = Stabilization { alpha: 300.0, beta: 200.0 };
                    let steps = Steps::Fixed(DT);
                    let options = Options { method, formulation, steps, stabilization: gains, ..Options::default() };
                    let scene = line.scene(0.0);
                    let end = [scene.duration];
                    let directions = [line.direction()];
                    let request = Request {
                        scene: &scene,
                        options: &options,
                        start: Some(start),
                        directions: &directions,
                        rows: &end,
                        summaries: &[],
                        interrupted: &|| false,
                    };
                    let found = sensitivities(request);
                    let found = found.unwrap().unwrap();
                    prop_assert_eq!((found.numbers.len(), &found.ends), (COMPONENTS, &vec![(None, Vec::new())]));
                    let end = |at: f64| simulate(&line.scene(at), &options, &|| false).unwrap().0.last.motion;
                    let (before, after) = (end(-CHANGE), end(CHANGE));
                    for (first, before, after) in [(0, before.q, after.q), (9, before.p, after.p)] {
                        let (before, after) = (before.row(), after.row());
                        let expected: [f64; 9] = std::array::from_fn(|k| (after[k] - before[k]) / (2.0 * CHANGE));
                        let size = expected.iter().fold(0.0_f64, |most, slope| most.max(slope.abs()));
                        for (k, (expected, slope)) in expected.iter().zip(&found.numbers[first..]).enumerate() {
                            prop_assert!(
                                (slope - expected).abs() <= 1e-6 * size,
                                "{name} {formulation_name} {fingers:?}, number {}: {slope} {expected}", first + k
                            );
                        }
                    }
                }
            }
        }
    }
}
