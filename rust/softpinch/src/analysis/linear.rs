//! The motion linearised about one state: a small deviation x of the states, under small changes u of the
//! inputs, obeys x' = A x + B u, and the outputs change by y = C x + D u. The derivatives are those of dual
//! numbers, exact to round-off. The eigenvalues of A say how fast the motion is and which steps it allows.

use nalgebra::{ComplexField, DMatrix, DVector, Schur};

use crate::error::{Error, Result};
use crate::formulation::{
    Carried, Choice, Contact, Formulation, Linear, SceneEquations, Seeded, States, System,
};
use crate::method::Runs;
use crate::model::contact::Side;
use crate::model::{
    Constants, ContactModel, ContactRow, Coordinates, Fingers, FrameMotion, Geometry, Input, Inputs, Mode,
    Motion, Parameters, Rule, SegmentDrive, Stabilization,
};
use crate::number::{Dual, LaneKernel, LaneTask, Lanes, MOST, Real, call_four_lanes, task};

/// Number of outputs: the coordinates q (9), the multipliers (4), the torques on the fingers (2), and the rates
/// of x, y, theta, theta_1 and theta_2 (5).
pub const OUTPUTS: usize = 20;

const MOST_ITERATIONS: usize = 10_000;

/// How the motion is linearised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// The formulation whose states are used.
    pub formulation: Formulation,
    /// The gains of (19) and (20), for `csm`.
    pub gains: Stabilization,
    /// Whether torques turn the fingers, whatever turns them in the scene. The torques are those of the scene at
    /// the state, so the accelerations there are the scene's.
    pub open_loop: bool,
    /// Whether the inputs keep the values of the instant at all times ([`Inputs::frozen`]).
    pub frozen: bool,
}

/// The motion linearised about one state, with the operating point.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearModel {
    /// A and B: the derivatives of the states' rates with respect to the states, and to the inputs. C and D: those of
    /// the outputs.
    pub matrices: [DMatrix<f64>; 4],
    /// Of the operating point: the states, which are coordinates (with d_n of free tips), their rates, the rates of d_t of
    /// tips that do not stick, d_t1 and d_t2, branches of tips, and the memories of PID controllers; their rates, zero at an equilibrium; the inputs, which are target angles or torques
    /// (2), for driven fingers their rates (2) and accelerations (2) too, F_x, F_y and the moment, and the acceleration
    /// of the hand's frame along its own axes (2); and the outputs, `OUTPUTS`.
    pub vectors: [DVector<f64>; 4],
}

/// The equations that are linearised, and the point about which they are.
pub struct Problem<'a> {
    runs: Runs<'a>,
    drive: SegmentDrive,
    motion: Motion<f64>,
    /// The modes of the contacts, if these are unilateral.
    modes: Option<[Mode; 2]>,
}

task! {
    /// Puts a state of `csm` on the constraints that the modes hold. Driven fingers are given.
    ['a, D: Lanes]
    Constrain<'a, D>(sides: &'a [Side<D>; 2], modes: [Mode; 2], driven: Option<&'a [[D; 2]; 2]>, y: &'a mut States<D>)
    for D => () = {
        let pose = if driven.is_some() { 3 } else { 5 };
        let (mut q, mut p) = (Coordinates::zero(), Coordinates::zero());
        for (own, first) in [(&mut q, 0), (&mut p, pose + 4)] {
            own.object.copy_from_slice(&y[first..first + 3]);
            own.finger.copy_from_slice(&y[first + 3..first + 5]);
        }
        if let Some(&[turn, rate]) = driven {
            (q.finger, p.finger) = (turn, rate);
        }
        Geometry::<D>::constrained(sides, &mut q, &mut p);
        for i in 0..2 {
            if modes[i].is_closed() {
                (y[pose + i], y[2 * pose + 4 + i]) = (q.compression[i], p.compression[i]);
            }
            if modes[i] == Mode::Stick {
                y[2 * pose + 6 + i] = p.shear[i];
            }
        }
    }
}

impl<'a> Problem<'a> {
    /// At time `t`; if an input jumps there, its value after the jump is used. Unilateral contacts are in the modes of
    /// `contact`. A free tip whose frozen tilt is NaN there has its present tilt.
    pub fn new(
        parameters: &'a Parameters,
        inputs: &Inputs,
        setting: &'a Setting,
        t: f64,
        motion: &Motion<f64>,
        contact: Option<&ContactRow>,
    ) -> Result<Self> {
        Rule::Finite.check("t", t)?;
        let Setting { formulation, ref gains, open_loop, frozen } = *setting;
        let mut drive = if frozen { inputs.frozen(t).segment(t) } else { inputs.segment(t) };
        let (mut model, mut modes, fingers) = (ContactModel::Bilateral, None, inputs.fingers);
        if let Some(&[right, left, ref tilts @ ..]) = contact {
            let now = Geometry::of_scene(parameters, &motion.q, &motion.p).tilt();
            let [r, l] = [0, 1].map(|i| if tilts[i].is_nan() { now[i] } else { tilts[i] });
            let own = Contact::of_row(&[right, left, r, l])?.map(|contact| contact.mode);
            drive.contacts.set(0, own, [r, l]);
            (model, modes) = (ContactModel::Unilateral, Some(own));
        }
        let moves = drive.frame.is_some();
        let choice = Choice { formulation, contact: model, fingers, moves, carried: Carried::default() };
        let runs = Runs { choice, parameters: [parameters; MOST], gains };
        let mut problem = Self { runs, drive, motion: *motion, modes };
        if open_loop {
            let system = runs.system();
            let now = system.evaluate(&problem.drive, 0.0, &system.begin(motion));
            problem.drive.hold(now.torque);
            problem.motion = now.motion;
            problem.runs.choice.fingers = Fingers::Torque;
        }
        Ok(problem)
    }

    /// The states at the point, and their number. Nothing depends on the memories of fingers that torques turn, which are
    /// the last two states, so they are left out.
    fn states(&self) -> (States<f64>, usize) {
        let system = self.runs.system();
        let memories = if self.runs.choice.fingers == Fingers::Torque { 2 } else { 0 };
        (system.begin(&self.motion), system.size().states - memories)
    }

    /// The derivatives of the states' rates with respect to the states alone.
    pub fn jacobian(&self) -> DMatrix<f64> {
        let (y, states) = self.states();
        let rows = self.runs.tangent::<f64>().jacobian(&self.drive, 0.0, &y).rows;
        DMatrix::from_fn(states, states, |row, column| rows[row][column])
    }

    /// The places in the states of the equations of those that are independent in the modes of the contacts.
    fn independent(&self, states: usize) -> Vec<usize> {
        let Some(modes) = self.modes else { return (0..states).collect() };
        let pose = if self.runs.choice.fingers == Fingers::Driven { 3 } else { 5 };
        let free = |i: &usize| !modes[*i].is_closed();
        let coordinates: Vec<_> = (0..pose).chain((0..2).filter(free).map(|i| pose + i)).collect();
        let slides = (0..2).filter(|&i| modes[i] != Mode::Stick).map(|i| 2 * pose + 6 + i);
        let rates = coordinates.iter().map(|place| pose + 4 + place);
        let rest = (pose + 2..pose + 4).chain(2 * pose + 8..states);
        coordinates.iter().copied().chain(rates).chain(slides).chain(rest).collect()
    }

    /// The model with all inputs and outputs. The states are those of `nullspace`; another formulation is an error. In
    /// unilateral contact they are the independent ones, and the others follow them on the constraints.
    pub fn model(&self) -> Result<LinearModel> {
        let formulation = self.runs.choice.formulation;
        if formulation != Formulation::Nullspace {
            let allowed = "\"nullspace\", for a model with inputs and outputs";
            return Err(Error::unknown("formulation", formulation.name(), allowed));
        }
        Ok(call_four_lanes(Linearized(self)))
    }
}

/// Computes a model, with one direction in each lane.
struct Linearized<'a>(&'a Problem<'a>);

impl LaneKernel for Linearized<'_> {
    type Output = LinearModel;

    #[inline(always)]
    fn run<X: Lanes>(self) -> LinearModel {
        let problem = self.0;
        let (mut y, states) = problem.states();
        let independent = problem.independent(states);
        let states = independent.len();
        let Runs { mut choice, parameters, gains } = problem.runs;
        let driven = choice.fingers == Fingers::Driven;
        let input = problem.drive.at(0.0_f64);
        let frame = problem.drive.frame.as_ref().map_or_else(FrameMotion::still, |frame| frame.at(0.0));
        let mut values = Vec::new();
        inputs(&input, &frame, driven, |value, varies| values.extend(varies.then_some(value)));
        // The weights are forces of the motion, which may be that of a hand at rest.
        choice.moves = true;
        let source = &Constants(&parameters);
        let equations = SceneEquations::<Dual<X, 1>>::new(choice, source, gains);
        let (sides, contacts) = (Side::both(source), problem.drive.contacts.spread());

        let all = states + values.len();
        let mut rates = DMatrix::zeros(states, all);
        let mut outputs = DMatrix::zeros(OUTPUTS, all);
        let (mut rate, mut output) = (DVector::zeros(states), DVector::zeros(OUTPUTS));
        for first in (0..all).step_by(X::WIDTH) {
            let along = |k: usize| [X::from_fn(|lane| f64::from(first + lane == k))];
            let mut next = states;
            let (input, acceleration) = inputs(&input, &frame, driven, |value, varies| {
                let slope = if varies { along(next) } else { [X::zero()] };
                next += usize::from(varies);
                Dual { value: X::constant(value), slope }
            });
            let frame = Some(FrameMotion { acceleration, ..frame.map(Dual::constant) });
            let mut duals = y.map(Dual::constant);
            for (k, &place) in independent.iter().enumerate() {
                duals[place].slope = along(k);
            }
            if let Some(modes) = problem.modes {
                let given = [input.target, input.target_rate];
                let driven = driven.then_some(&given);
                Dual::outlined(Constrain { sides: &sides, modes, driven, y: &mut duals });
            }
            y = duals.map(|dual| dual.lane(0));
            let now = equations.seeded(&Seeded { input, frame, contacts, y: duals });
            // The outputs in their order.
            let (q, p) = (now.motion.q.row(), now.motion.p.row());
            let found = [&q[..], &now.multipliers, &now.torque, &p[..5]].concat();
            for column in first..all.min(first + X::WIDTH) {
                for (row, &place) in independent.iter().enumerate() {
                    rates[(row, column)] = now.rate[place].slope[0].lane(column - first);
                }
                for (row, dual) in found.iter().enumerate() {
                    outputs[(row, column)] = dual.slope[0].lane(column - first);
                }
            }
            rate = DVector::from_fn(states, |row, _| now.rate[independent[row]].lane(0));
            output = DVector::from_fn(OUTPUTS, |row, _| found[row].lane(0));
        }
        let inputs = values.len();
        LinearModel {
            matrices: [
                rates.columns(0, states).into(),
                rates.columns(states, inputs).into(),
                outputs.columns(0, states).into(),
                outputs.columns(states, inputs).into(),
            ],
            vectors: [
                DVector::from_fn(states, |row, _| y[independent[row]]),
                rate,
                DVector::from_vec(values),
                output,
            ],
        }
    }
}

/// The largest real part of the eigenvalues of the motion about a state at rest, without the two zeros of the family
/// of equilibria and without branches and memories that drive nothing; and the largest size of an eigenvalue. `None` if the
/// eigenvalues are not found, because a number overflowed.
pub fn growth(parameters: &Parameters, inputs: &Inputs, motion: &Motion<f64>) -> Option<(f64, f64)> {
    let (formulation, gains) = (Formulation::Nullspace, Stabilization { alpha: 0.0, beta: 0.0 });
    let setting = Setting { formulation, gains, open_loop: false, frozen: false };
    let mut a = Problem::new(parameters, inputs, &setting, 0.0, motion, None).ok()?.jacobian();
    let degrees = if inputs.fingers == Fingers::Driven { 3 } else { 5 };
    let shears = 2 * degrees;
    // No motion changes d_t + Phi_N pose, and the rows of d_t are -Phi_N.
    for row in 0..a.nrows() {
        for pose in 0..degrees {
            let slipped: f64 = (0..2).map(|i| a[(row, shears + i)] * a[(shears + i, degrees + pose)]).sum();
            a[(row, pose)] += slipped;
        }
    }
    // In the order of the states, with rates in the place of coordinates.
    let Motion { q, p, memory, relaxation } = Motion::typical_magnitudes(parameters);
    let branches = 4 * parameters.branches();
    let scale = |k: usize| match k {
        _ if k < degrees => q.row()[k],
        _ if k < shears => p.row()[k - degrees],
        _ if k - shears - 2 < branches => relaxation[k - shears - 2],
        _ => memory[k - shears - 2 - branches],
    };
    let kept: Vec<usize> =
        (0..a.nrows()).filter(|&k| k < shears || (k >= shears + 2 && scale(k).is_finite())).collect();
    let matrix = DMatrix::from_fn(kept.len(), kept.len(), |r, c| {
        a[(kept[r], kept[c])] * (scale(kept[c]) / scale(kept[r]))
    });
    if matrix.iter().any(|entry| !entry.is_finite()) {
        return None;
    }
    let rates = Schur::try_new(matrix, f64::EPSILON, MOST_ITERATIONS)?.complex_eigenvalues();
    let largest = rates.iter().map(|rate| rate.modulus()).fold(0.0, f64::max);
    Some((rates.iter().map(|rate| rate.re).fold(f64::NEG_INFINITY, f64::max), largest))
}

/// The inputs and the acceleration of the hand with the numbers that `number` makes of theirs, in the order of the model's
/// inputs. It also gets whether a number is one of these.
fn inputs<D>(
    input: &Input<f64>,
    frame: &FrameMotion<f64>,
    driven: bool,
    mut number: impl FnMut(f64, bool) -> D,
) -> (Input<D>, [D; 2]) {
    let input = Input {
        target: input.target.map(|value| number(value, true)),
        target_rate: input.target_rate.map(|value| number(value, driven)),
        target_acceleration: input.target_acceleration.map(|value| number(value, driven)),
        force: input.force.map(|value| number(value, true)),
        tau: number(input.tau, false),
    };
    (input, frame.acceleration.map(|value| number(value, true)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::start::contact;

    const FINGERS: [Fingers; 3] = [Fingers::Pid, Fingers::Torque, Fingers::Driven];

    fn setting(formulation: Formulation) -> Setting {
        let gains = Stabilization { alpha: 1000.0, beta: 1000.0 };
        Setting { formulation, gains, open_loop: false, frozen: false }
    }

    /// A grasp whose fingers stand at their targets, with velocities.
    fn moving(fingers: Fingers) -> (Parameters, Inputs, Motion<f64>) {
        let parameters = Parameters::default().checked().unwrap();
        let mut q = contact(&parameters).unwrap();
        q.finger = [0.1, 0.12];
        let inputs = Inputs::constant_targets(q.finger).with_fingers(fingers);
        let p = [0.02, -0.01, 0.3, 0.2, -0.1, 0.0, 0.0, 0.0, 0.0].into();
        (parameters, inputs, Motion { q, p, memory: [1e-3, 0.0], ..Motion::zero() })
    }

    fn model(
        parameters: &Parameters,
        inputs: &Inputs,
        setting: &Setting,
        t: f64,
        motion: &Motion<f64>,
    ) -> Result<LinearModel> {
        Problem::new(parameters, inputs, setting, t, motion, None)?.model()
    }

    #[test]
    fn the_whole_model_has_the_matrix_of_the_jacobian_to_the_bit() {
        for fingers in FINGERS {
            let (parameters, inputs, motion) = moving(fingers);
            let setting = setting(Formulation::Nullspace);
            let alone = Problem::new(&parameters, &inputs, &setting, 0.5, &motion, None).unwrap().jacobian();
            let whole = model(&parameters, &inputs, &setting, 0.5, &motion).unwrap();
            assert_eq!(whole.matrices[0], alone);
            let inputs = if fingers == Fingers::Driven { 11 } else { 7 };
            assert_eq!(whole.matrices[1].shape(), (alone.nrows(), inputs));
            assert_eq!(whole.matrices[2].shape(), (OUTPUTS, alone.nrows()));
            assert_eq!(whole.matrices[3].shape(), (OUTPUTS, inputs));
        }
    }

    #[test]
    fn the_open_loop_accelerates_as_the_scene_does() {
        for fingers in FINGERS {
            let (parameters, inputs, motion) = moving(fingers);
            let closed = setting(Formulation::Nullspace);
            let open = Setting { open_loop: true, ..closed };
            let own = model(&parameters, &inputs, &closed, 0.5, &motion).unwrap();
            let fed = model(&parameters, &inputs, &open, 0.5, &motion).unwrap();
            assert_eq!(fed.vectors[0].len(), 12);
            let first = if fingers == Fingers::Driven { 3 } else { 5 };
            for (ours, theirs) in fed.vectors[1].rows(5, 3).iter().zip(own.vectors[1].rows(first, 3).iter()) {
                assert!((ours - theirs).abs() <= 1e-10 * theirs.abs(), "{ours} {theirs}");
            }
            for (ours, theirs) in fed.vectors[3].iter().zip(own.vectors[3].iter()) {
                assert!((ours - theirs).abs() <= 1e-10 * (1.0 + theirs.abs()), "{ours} {theirs}");
            }
        }
    }

    #[test]
    fn other_formulations_have_no_inputs_and_outputs() {
        let (parameters, inputs, motion) = moving(Fingers::Pid);
        for formulation in [Formulation::Csm, Formulation::Projected] {
            let error = model(&parameters, &inputs, &setting(formulation), 0.0, &motion).unwrap_err();
            assert!(error.to_string().contains("must be one of \"nullspace\""), "{error}");
        }
    }
}
