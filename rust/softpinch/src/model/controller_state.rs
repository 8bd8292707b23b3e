//! The state of a discrete controller: measuring with noise and finite resolution, taking samples, and putting their torques
//! in force.

use crate::error::{Error, Result, require};
use crate::model::noise::normals;
use crate::model::{FrameMotion, Measure, Motion, SampledController};
use crate::number::inlined;

const FIELD: &str = "State.controller";

/// The state of one block of a controller: its clock, the torques in force, those under way, and xi.
#[derive(Debug, Clone, PartialEq)]
pub struct ControllerState {
    /// The instant of sample 0, s.
    origin: f64,
    /// Numbers of samples that have been taken, whose measurements have been used, and that have acted.
    taken: u64,
    used: u64,
    acted: u64,
    /// The torques in force, N m.
    pub torque: [f64; 2],
    xi: Vec<f64>,
    /// The outputs under way; that of sample k is entry k modulo its length.
    under_way: Vec<[f64; 2]>,
    /// The measurements that are kept, in the same order; empty where each is used at once and none is lost.
    seen: Vec<f64>,
    /// Whether the last output is by the second set of gains, if there is one.
    second: Option<bool>,
}

impl ControllerState {
    /// The state of a controller that starts at `origin`.
    pub fn new(controller: &SampledController, origin: f64) -> Self {
        Self {
            origin,
            taken: 0,
            used: 0,
            acted: 0,
            torque: controller.initial_torque,
            xi: controller.initial_state.clone(),
            under_way: vec![[0.0; 2]; controller.under_way(controller.delay)],
            seen: vec![0.0; controller.kept() * controller.inputs()],
            second: controller.switch.as_ref().map(|_| false),
        }
    }

    /// Adds the state as numbers to a row: origin, the numbers of samples that have been taken and that have acted, the torques in
    /// force, xi, and the outputs under way; then, if measurements are kept, the number of those used, and them; and 1 if
    /// the last output is by a second set of gains, else 0.
    pub fn put_row(&self, row: &mut Vec<f64>) {
        let [right, left] = self.torque;
        row.extend([self.origin, self.taken as f64, self.acted as f64, right, left]);
        row.extend(&self.xi);
        row.extend(self.under_way.as_flattened());
        row.extend((!self.seen.is_empty()).then_some(self.used as f64));
        row.extend(&self.seen);
        row.extend(self.second.map(f64::from));
    }

    pub fn is_finite(&self) -> bool {
        let numbers = [&self.torque, &self.xi[..], self.under_way.as_flattened(), &self.seen];
        numbers.into_iter().flatten().all(|number| number.is_finite())
    }

    /// The state from the numbers of [`put_row`](Self::put_row).
    pub fn from_row(controller: &SampledController, row: &[f64]) -> Result<Self> {
        let refused = |rule| Error::shape(FIELD, format_args!("{} numbers", row.len()), rule);
        require_length(row, controller.own_width())?;
        let (row, flag) = row.split_at(row.len() - usize::from(controller.switch.is_some()));
        let second = flag.first().map(|&flag| flag != 0.0);
        let (head, rest) = row.split_at(5);
        let (xi, rest) = rest.split_at(controller.states());
        let (under_way, kept) = rest.split_at(2 * controller.under_way(controller.delay));
        let (used, seen) = kept.split_first().unwrap_or((&head[1], &[]));
        let whole = |number: f64| (0.0..9e15).contains(&number) && number.fract() == 0.0;
        let ordered = head[2] <= *used && *used <= head[1];
        if !(whole(head[1]) && whole(head[2]) && whole(*used) && ordered && head[0].is_finite()) {
            return Err(refused("must begin with the origin, s, and the numbers of samples"));
        }
        let (taken, used, acted) = (head[1] as u64, *used as u64, head[2] as u64);
        let (pairs, _) = under_way.as_chunks::<2>();
        if used - acted > pairs.len() as u64 || taken - used > controller.kept() as u64 {
            return Err(refused("has more samples under way than the delay allows"));
        }
        let outputs = (acted..used).map(|number| pairs[place(number, pairs.len())]);
        for torques in outputs.chain([[head[3], head[4]]]) {
            for (torque, [low, high]) in torques.into_iter().zip(controller.limits) {
                let within = !(torque < low || torque > high);
                require(within, FIELD, torque, "its torques must be within the controller's limits")?;
            }
        }
        Ok(Self {
            origin: head[0],
            taken,
            used,
            acted,
            torque: [head[3], head[4]],
            xi: xi.to_vec(),
            under_way: pairs.to_vec(),
            seen: seen.to_vec(),
            second,
        })
    }

    /// The first instant at which it will sample, use measurements, or let torques act.
    pub fn next(&self, controller: &SampledController) -> f64 {
        let used = (self.used < self.taken).then(|| controller.used(self.origin, self.used));
        let acted = (self.acted < self.used).then(|| controller.applied(self.origin, self.acted));
        used.into_iter().chain(acted).fold(controller.sampled(self.origin, self.taken), f64::min)
    }

    /// Whether the instant `t` is between the last sample, or the start, and the next sample.
    pub fn holds_at(&self, controller: &SampledController, t: f64) -> bool {
        let last = self.taken.checked_sub(1).map_or(self.origin, |k| controller.sampled(self.origin, k));
        last <= t && t <= controller.sampled(self.origin, self.taken)
    }

    inlined! {
        /// Whether a sample is to be taken at the instant `t`.
        pub is_due(&self, controller: &SampledController, t: f64) -> bool =
            controller.sampled(self.origin, self.taken) <= t;
        /// Whether torques under way act from `t` or earlier.
        pub acts(&self, controller: &SampledController, t: f64) -> bool =
            self.acted < self.used && controller.applied(self.origin, self.acted) <= t;
        /// Whether measurements are to be used at `t`.
        pub uses(&self, controller: &SampledController, t: f64) -> bool =
            self.used < self.taken && controller.used(self.origin, self.used) <= t;
    }

    /// Puts these torques in force.
    pub fn act(&mut self, controller: &SampledController, t: f64) {
        while self.acts(controller, t) {
            self.torque = self.under_way[place(self.acted, self.under_way.len())];
            self.acted += 1;
        }
    }

    /// Takes a sample. Its measurements are used at once, or kept until [`use_kept`](Self::use_kept).
    pub fn sample(
        &mut self,
        controller: &SampledController,
        (seen, known): (&Measured<'_>, &Known),
        scratch: &mut Scratch,
    ) {
        let (number, y) = (self.taken, &mut scratch.measured);
        measure(controller, number, seen, y);
        self.taken += 1;
        if self.seen.is_empty() {
            return self.compute(controller, known, scratch);
        }
        let own = |number: u64| y.len() * place(number, controller.kept());
        if controller.is_lost(number) {
            let before = own(number - 1);
            self.seen.copy_within(before..before + y.len(), own(number));
        } else {
            self.seen[own(number)..][..y.len()].copy_from_slice(y);
        }
    }

    /// Uses the measurements that are kept and due at `t`.
    pub fn use_kept(&mut self, controller: &SampledController, t: f64, known: &Known, scratch: &mut Scratch) {
        while self.uses(controller, t) {
            let m = controller.inputs();
            scratch.measured.clear();
            scratch.measured.extend(&self.seen[m * place(self.used, controller.kept())..][..m]);
            self.compute(controller, known, scratch);
        }
    }

    /// Computes the next output from the measurements in `scratch`, which is overwritten.
    fn compute(&mut self, controller: &SampledController, known: &Known, scratch: &mut Scratch) {
        let SampledController { limits, anti_windup, .. } = controller;
        let Scratch { measured: y, next } = scratch;
        complete(controller, known, y);
        let [a, b, c, d] = controller.gains(self.origin, self.used, y, &mut self.second);
        let (n, m, xi) = (self.xi.len(), y.len(), &self.xi);
        // Not fused: outside of vector code a fused multiply-add is a call of a function.
        let row = |matrix: &[f64], row: usize, vector: &[f64]| -> f64 {
            let entries = &matrix[row * vector.len()..(row + 1) * vector.len()];
            entries.iter().zip(vector).fold(0.0, |sum, (entry, value)| entry * value + sum)
        };
        debug_assert_eq!((n, m), (controller.states(), controller.inputs()));
        let wanted: [f64; 2] = std::array::from_fn(|i| row(c, i, xi) + row(d, i, y));
        // NaN stays, so that the run ends.
        let mut limited: [f64; 2] = std::array::from_fn(|i| wanted[i].clamp(limits[i][0], limits[i][1]));
        let length = self.under_way.len();
        if controller.rate_limit < f64::INFINITY {
            let most = controller.rate_limit * controller.period;
            let last = self.used.checked_sub(1).map(|number| self.under_way[place(number, length)]);
            for (own, last) in limited.iter_mut().zip(last.unwrap_or(controller.initial_torque)) {
                *own = own.clamp(last - most, last + most);
            }
        }
        if controller.no_load_rate < f64::INFINITY {
            let before = controller.measures.iter().take_while(|&&measure| measure != Measure::AngleRate);
            let rates = y.iter().skip(before.map(|measure| measure.width()).sum());
            for ((own, rate), [low, high]) in limited.iter_mut().zip(rates).zip(limits) {
                let share = rate / controller.no_load_rate;
                let [down, up] =
                    [1.0 + share, 1.0 - share].map(|left| if left > 0.0 { left.min(1.0) } else { 0.0 });
                *own = own.clamp(low * down, high * up);
            }
        }
        next.clear();
        next.extend((0..n).map(|k| row(a, k, xi) + row(b, k, y)));
        if *anti_windup {
            for k in 0..n {
                let winds = |i: usize| c[i * n + k] * (next[k] - xi[k]) * (wanted[i] - limited[i]) > 0.0;
                if winds(0) || winds(1) {
                    next[k] = xi[k];
                }
            }
        }
        self.xi.copy_from_slice(next);
        self.under_way[place(self.used, length)] = limited;
        self.used += 1;
    }
}

/// Room for the numbers of one sample.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    measured: Vec<f64>,
    next: Vec<f64>,
}

/// Refuses the numbers of another controller's state.
pub fn require_length(row: &[f64], needed: usize) -> Result {
    let found = format_args!("{} numbers instead of {needed}", row.len());
    let rule = "must be a state of this controller, with its states and its samples under way";
    if row.len() == needed { Ok(()) } else { Err(Error::shape(FIELD, found, rule)) }
}

/// The entry of a sample among `length` outputs under way.
fn place(number: u64, length: usize) -> usize {
    (number % length as u64) as usize
}

/// The measured system at the instant of a sample.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a> {
    pub motion: &'a Motion<f64>,
    pub multipliers: &'a [f64; 4],
    /// The motion of the hand's frame, and g in m/s^2.
    pub frame: (FrameMotion<f64>, f64),
}

/// What a block knows without sensors when it computes an output.
#[derive(Debug, Clone, Copy)]
pub struct Known {
    /// The targets, rad, and their rates, rad/s.
    pub target: [[f64; 2]; 2],
    /// The schedule's values, rad.
    pub schedule: [f64; 2],
}

/// Measures what sensors do of y: each number with noise, and rounded to its resolution.
fn measure(controller: &SampledController, number: u64, seen: &Measured<'_>, y: &mut Vec<f64>) {
    let Measured { motion: Motion { q, p, .. }, multipliers, frame } = seen;
    y.clear();
    for measure in &controller.measures {
        match measure {
            Measure::Angle | Measure::AngleError => y.extend(&q.finger),
            Measure::AngleRate => y.extend(&p.finger),
            Measure::Target | Measure::TargetRate | Measure::Schedule => y.extend([0.0; 2]),
            Measure::Position => y.extend(&q.object[..2]),
            Measure::Rotation => y.push(q.object[2]),
            Measure::Velocity => y.extend(&p.object[..2]),
            Measure::RotationRate => y.push(p.object[2]),
            Measure::Compression => y.extend(&q.compression),
            Measure::Shear => y.extend(&q.shear),
            Measure::Multipliers => y.extend(multipliers.iter()),
            Measure::Accelerometer => y.extend(frame.0.felt(frame.1)),
            Measure::Gyroscope => y.push(frame.0.turning.map_or(0.0, |[rate, _]| rate)),
        }
    }
    let mut first = 0;
    for measure in &controller.measures {
        for k in first..first + measure.width() {
            if measure.is_known() {
                continue;
            }
            if controller.noise[k] > 0.0 {
                let random = normals([number, controller.stream(), (k / 4) as u64, 0], controller.key)[k % 4];
                y[k] += controller.noise[k] * random;
            }
            if controller.resolution[k] > 0.0 {
                y[k] = (y[k] / controller.resolution[k]).round() * controller.resolution[k];
            }
        }
        first += measure.width();
    }
}

/// Completes y: what is known, the targets of angles, which an encoder measures, and dead zones.
fn complete(controller: &SampledController, known: &Known, y: &mut [f64]) {
    let Known { target: [target, target_rate], schedule } = known;
    let mut first = 0;
    for measure in &controller.measures {
        let own = &mut y[first..first + measure.width()];
        match measure {
            Measure::AngleError => (0..2).for_each(|i| own[i] -= target[i]),
            Measure::Target => own.copy_from_slice(target),
            Measure::TargetRate => own.copy_from_slice(target_rate),
            Measure::Schedule => own.copy_from_slice(schedule),
            _ => {}
        }
        for (value, &zone) in own.iter_mut().zip(&controller.dead_zone[first..]) {
            if zone > 0.0 {
                *value -= value.clamp(-zone, zone);
            }
        }
        first += measure.width();
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    use super::*;
    use crate::model::sampled::tests::spring;

    const PERIOD: f64 = 0.01;
    /// Numbers of states and of measured numbers.
    const SIZES: [usize; 2] = [3, 4];
    const LIMITS: [[f64; 2]; 2] = [[-0.5, 0.7], [-0.3, f64::INFINITY]];

    /// A controller of the angles and their rates, from the entries of A, B, C and D.
    fn controller(entries: &[f64], delay: f64) -> SampledController {
        let [n, m] = SIZES;
        let mut rest = entries.iter().copied();
        let mut take = |count: usize| rest.by_ref().take(count).collect::<Vec<_>>();
        SampledController {
            a: take(n * n),
            b: take(n * m),
            c: take(2 * n),
            d: take(2 * m),
            measures: vec![Measure::Angle, Measure::AngleRate],
            limits: LIMITS,
            initial_torque: [0.1, -0.1],
            initial_state: vec![0.5, -0.25, 0.125],
            ..spring(PERIOD, delay)
        }
    }

    fn entries() -> impl Strategy<Value = Vec<f64>> {
        let [n, m] = SIZES;
        prop::collection::vec(-0.6..0.6_f64, (n + 2) * (n + m))
    }

    /// Takes the sample that is due at the instant `t`, with these measured angles and rates.
    fn sample(state: &mut ControllerState, controller: &SampledController, y: [f64; 4]) {
        let mut motion = Motion::zero();
        (motion.q.finger, motion.p.finger) = ([y[0], y[1]], [y[2], y[3]]);
        let frame = (FrameMotion::still(), 9.81);
        let seen = Measured { motion: &motion, multipliers: &[0.0; 4], frame };
        let known = Known { target: [[0.0; 2]; 2], schedule: [0.0; 2] };
        state.sample(controller, (&seen, &known), &mut Scratch::default());
    }

    proptest! {
        /// u_k = C xi_k + D y_k within the limits, xi_(k+1) = A xi_k + B y_k, and u_k is in force from the instant of its
        /// sample plus the delay until the next one is.
        #[test]
        fn torques_are_those_of_the_matrices_and_act_after_the_delay(
            entries in entries(),
            delay in prop_oneof![Just(0.0), Just(2.0 * PERIOD), 0.0..3.5 * PERIOD],
            measured in prop::collection::vec(prop::array::uniform4(-1.0..1.0_f64), 12),
        ) {
            let [n, m] = SIZES;
            let controller = controller(&entries, delay);
            let matrix = |rows, columns, of: &[f64]| DMatrix::from_row_slice(rows, columns, of);
            let (a, b) = (matrix(n, n, &controller.a), matrix(n, m, &controller.b));
            let (c, d) = (matrix(2, n, &controller.c), matrix(2, m, &controller.d));
            let mut xi = DVector::from_column_slice(&controller.initial_state);
            let mut outputs = Vec::new();
            let mut state = ControllerState::new(&controller, 0.0);
            for (k, y) in measured.into_iter().enumerate() {
                let t = k as f64 * PERIOD;
                prop_assert!(state.is_due(&controller, t) && !state.is_due(&controller, t - 0.5 * PERIOD));
                sample(&mut state, &controller, y);
                let y = DVector::from_column_slice(&y);
                let u = &c * &xi + &d * &y;
                outputs.push([0, 1].map(|i| u[i].clamp(LIMITS[i][0], LIMITS[i][1])));
                xi = &a * &xi + &b * &y;
                // Three instants of the period, at which no torque begins to act by a hair.
                for share in [0.04, 0.53, 0.97] {
                    let now = t + share * PERIOD;
                    let begun = (0..outputs.len()).rev().find(|&k| k as f64 * PERIOD + delay <= now);
                    prop_assume!((0..=k).all(|k| (k as f64 * PERIOD + delay - now).abs() > 1e-9));
                    state.act(&controller, now);
                    let expected = begun.map_or(controller.initial_torque, |k| outputs[k]);
                    for (torque, expected) in state.torque.into_iter().zip(expected) {
                        prop_assert!((torque - expected).abs() < 1e-13, "{now}: {torque} {expected}");
                    }
                }
            }
        }

        /// A controller that goes on from its row takes the samples of one that was never interrupted.
        #[test]
        fn a_state_goes_on_from_its_row(
            entries in entries(),
            delay in 0.0..3.5 * PERIOD,
            measured in prop::collection::vec(prop::array::uniform4(-1.0..1.0_f64), 9),
            resumed_at in 0..8_usize,
        ) {
            let controller = controller(&entries, delay);
            let mut whole = ControllerState::new(&controller, 0.3);
            let mut resumed = whole.clone();
            for (k, y) in measured.into_iter().enumerate() {
                if k == resumed_at {
                    let mut row = Vec::new();
                    whole.put_row(&mut row);
                    prop_assert_eq!(row.len(), controller.own_width());
                    resumed = ControllerState::from_row(&controller, &row).unwrap();
                    prop_assert_eq!(&resumed, &whole);
                }
                for state in [&mut whole, &mut resumed] {
                    sample(state, &controller, y);
                    state.act(&controller, 0.3 + k as f64 * PERIOD);
                }
                prop_assert!(k < resumed_at || resumed == whole);
            }
        }
    }
}
