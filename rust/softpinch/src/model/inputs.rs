//! The inputs of a scene: finger targets and external forces as piecewise polynomials and sinusoids on
//! breakpoints, held noise, ideal impulses, and torques from a discrete controller or from outside.
//! Integration goes segment by segment between breakpoints ([`SegmentDrive`]).

use std::sync::Arc;

use crate::error::Result;
use crate::model::drive::{CHANNELS, COEFFICIENTS, Wave};
use crate::model::noise::{require_countable, require_end};
use crate::model::{
    ControllerState, Fingers, FrameMotion, Noise, PiecewisePolynomial, Rule, SampledController, SegmentDrive,
    SegmentFrame,
};
use crate::number::{MOST, Real};

/// amplitude * sin(omega (t - start) + phase) from `start` until `end`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sinusoid {
    /// First instant, s.
    pub start: f64,
    /// Last instant, s; may be infinite.
    pub end: f64,
    /// Angular frequency, rad/s.
    pub omega: f64,
    /// Phase at the start, rad.
    pub phase: f64,
    /// Amplitudes of F_x, F_y, N, and moment, N m.
    pub amplitude: [f64; 3],
}

/// An ideal impulse on the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impulse {
    /// Time, s.
    pub time: f64,
    /// J_x, J_y in N s and J_theta in N m s.
    pub impulse: [f64; 3],
}

/// Everything that drives a scene. Runs can share the parts in which they do not differ.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Inputs {
    schedule: Arc<PiecewisePolynomial<2>>,
    forces: Vec<Arc<PiecewisePolynomial<3>>>,
    sines: Vec<Sinusoid>,
    impulses: Vec<Impulse>,
    noises: Vec<Noise>,
    /// How the fingers move.
    pub fingers: Fingers,
    /// Inputs from outside instead of the schedule's, if there are any. They make no breakpoint.
    pub(crate) held: Option<Held>,
    /// The discrete controller of the fingers, if there is one.
    pub(crate) sampled: Option<Sampled>,
    frame: Option<Arc<HandMotion>>,
}

/// The motion of the hand's frame: accelerations of its origin along fixed axes, and its tilt.
#[derive(Debug, Clone, PartialEq)]
pub struct HandMotion {
    /// Accelerations along x and y, m/s^2.
    pub acceleration: PiecewisePolynomial<2>,
    /// The tilt, counter-clockwise, rad.
    pub tilt: PiecewisePolynomial<1>,
    /// Angular frequency, rad/s, and phase at time 0, rad, of a sinusoid at all times, and its amplitudes: of the
    /// accelerations, m/s^2, and of the tilt, rad.
    pub sine: [f64; 5],
}

impl HandMotion {
    /// The motion at all times with the acceleration and the tilt of an instant, without turning.
    pub fn constant(frame: &FrameMotion<f64>) -> Self {
        let [x, y] = frame.in_fixed_axes(frame.acceleration);
        let tilt = PiecewisePolynomial::constant([frame.sin.atan2(frame.cos)]);
        Self { acceleration: PiecewisePolynomial::constant([x, y]), tilt, sine: [0.0; 5] }
    }

    /// The motion at all times with the acceleration and the tilt that the polynomials have at time `t`.
    fn frozen(&self, t: f64) -> Self {
        Self {
            acceleration: PiecewisePolynomial::constant(self.acceleration.value_and_rate(t)[0]),
            tilt: PiecewisePolynomial::constant(self.tilt.value_and_rate(t)[0]),
            sine: [0.0; 5],
        }
    }

    /// The motion in the segment from `anchor` on, with the accelerations that are held, if there are any.
    fn segment(&self, anchor: f64, held: Option<[f64; 2]>) -> SegmentFrame<f64> {
        let [x, y] = held.map_or_else(
            || self.acceleration.shifted(anchor),
            |own| own.map(|value| std::array::from_fn(|k| if k == 0 { value } else { 0.0 })),
        );
        let [tilt] = self.tilt.shifted(anchor);
        let [omega, phase, ref amplitude @ ..] = self.sine;
        let [x_swing, y_swing, swing] = *amplitude;
        let numbers = [omega, omega.mul_add(anchor, phase), x_swing, y_swing, swing];
        // Adding zero turns -0.0 into 0.0, as in the other channels.
        let channels = [x, y, tilt].map(|channel| channel.map(|coefficient| coefficient + 0.0));
        let turns = swing != 0.0 || tilt[1..].iter().any(|&coefficient| coefficient != 0.0);
        let degree = (0..COEFFICIENTS).rev().find(|&k| x[k] != 0.0 || y[k] != 0.0).unwrap_or(0);
        let (sin, cos) = Real::sin_cos(channels[2][0]);
        SegmentFrame {
            channels,
            wave: Wave { numbers, active: 1 },
            degree,
            direction: [sin, cos],
            swings: *amplitude != [0.0; 3],
            turns,
        }
    }
}

/// A discrete controller and the instant of its first sample, s. The schedule has its target angles.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    pub controller: Arc<SampledController>,
    /// The instant of its first sample, s.
    pub origin: f64,
}

/// Inputs from outside, which are held until they are set again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held {
    /// Torques on the fingers in N m, or target angles in rad, instead of the schedule's.
    pub target: [f64; 2],
    /// F_x and F_y in N and the moment in N m, beside the disturbances of the scene.
    pub force: [f64; 3],
    /// The acceleration of the hand's frame along fixed axes, m/s^2, instead of that of its motion, if it moves.
    pub acceleration: Option<[f64; 2]>,
}

impl Inputs {
    /// Inputs for PID fingers. Sinusoids, impulses and noises are checked.
    pub fn new(
        schedule: Arc<PiecewisePolynomial<2>>,
        forces: Vec<Arc<PiecewisePolynomial<3>>>,
        sines: Vec<Sinusoid>,
        mut impulses: Vec<Impulse>,
        noises: Vec<Noise>,
    ) -> Result<Self> {
        for (k, sine) in sines.iter().enumerate() {
            Rule::Finite.check(format_args!("sines[{k}].start"), sine.start)?;
            Rule::Finite.check(format_args!("sines[{k}].omega"), sine.omega)?;
            Rule::Finite.check(format_args!("sines[{k}].phase"), sine.phase)?;
            // Only `end` may be infinite.
            require_end(format_args!("sines[{k}].end"), sine.start, sine.end)?;
            Rule::Finite.check_all(format_args!("sines[{k}].amplitude"), &sine.amplitude)?;
        }
        for (k, impulse) in impulses.iter().enumerate() {
            Rule::Finite.check(format_args!("impulses[{k}].time"), impulse.time)?;
            Rule::Finite.check_all(format_args!("impulses[{k}].impulse"), &impulse.impulse)?;
        }
        for (k, noise) in noises.iter().enumerate() {
            noise.check(k)?;
        }
        impulses.sort_by(|a, b| a.time.total_cmp(&b.time));
        Ok(Self { schedule, forces, sines, impulses, noises, ..Self::default() })
    }

    /// PID fingers that hold their targets, without disturbances.
    pub fn constant_targets(target: [f64; 2]) -> Self {
        Self { schedule: PiecewisePolynomial::constant(target).into(), ..Self::default() }
    }

    /// The same inputs for a hand whose frame moves.
    pub fn with_hand_motion(self, motion: Option<Arc<HandMotion>>) -> Self {
        Self { frame: motion, ..self }
    }

    /// Whether the hand's frame moves, or is tilted.
    pub fn moves(&self) -> bool {
        self.frame.is_some()
    }

    /// The motion of the hand's frame in the segment from `anchor` on, if it moves.
    pub(crate) fn frame_from(&self, anchor: f64) -> Option<SegmentFrame<f64>> {
        let acceleration = self.held.and_then(|held| held.acceleration);
        self.frame.as_ref().map(|frame| {
            let mut frame = frame.segment(anchor, acceleration);
            for [x, y] in self.noises.iter().map(|noise| noise.acceleration_at(anchor)) {
                frame.channels[0][0] += x;
                frame.channels[1][0] += y;
            }
            frame
        })
    }

    /// The same inputs, and a force on the object from `time` on for `duration`, s: F_x and F_y, N, and the moment, N m.
    pub fn with_pulse(mut self, time: f64, duration: f64, force: [f64; 3]) -> Result<Self> {
        Rule::Positive.check("pulse.duration", duration)?;
        // An end that overflows is never reached.
        let times = [time, (time + duration).min(f64::MAX)];
        let pulse = PiecewisePolynomial::steps("pulse", [0.0; 3], &times, &[force, [0.0; 3]])?;
        self.forces.push(pulse.into());
        Ok(self)
    }

    /// The same inputs, for fingers that move in the given way.
    pub fn with_fingers(self, fingers: Fingers) -> Self {
        Self { fingers, ..self }
    }

    /// The same inputs, with the torques of a discrete controller whose targets are the schedule.
    pub fn with_controller(self, controller: Arc<SampledController>, origin: f64) -> Self {
        Self { fingers: Fingers::Torque, sampled: Some(Sampled { controller, origin }), ..self }
    }

    /// Lets the discrete controller, if there is one, start at `origin`, s.
    pub fn start_controller(&mut self, origin: f64) {
        if let Some(sampled) = &mut self.sampled {
            sampled.origin = origin;
        }
    }

    /// The state of the discrete controller at its start, as numbers; none without a controller.
    pub fn controller_row(&self) -> Vec<f64> {
        let Some(Sampled { controller, origin }) = &self.sampled else { return Vec::new() };
        let mut row = Vec::new();
        controller.blocks().for_each(|block| ControllerState::new(block, *origin).put_row(&mut row));
        row
    }

    /// The schedule's values at time `t`, or those from outside, and their rates.
    pub fn target(&self, t: f64) -> [[f64; 2]; 2] {
        self.held.map_or_else(|| self.schedule.value_and_rate(t), |held| [held.target, [0.0; 2]])
    }

    /// The same inputs with the values of time `t` at all times, for a balance of forces. Sinusoids and noises,
    /// whose mean is zero, and impulses are left out.
    pub fn frozen(&self, t: f64) -> Self {
        let (target, mut force) = match self.held {
            Some(Held { target, force, .. }) => (target, force),
            None => (self.schedule.value_and_rate(t)[0], [0.0; 3]),
        };
        for own in &self.forces {
            for (sum, value) in force.iter_mut().zip(own.value_and_rate(t)[0]) {
                *sum += value;
            }
        }
        let motion = self.frame.as_ref().map(|frame| Arc::new(frame.frozen(t)));
        Self::constant(target, force, self.fingers).with_hand_motion(motion)
    }

    /// Targets, and forces on the object, that never change.
    pub fn constant(target: [f64; 2], force: [f64; 3], fingers: Fingers) -> Self {
        let forces = vec![PiecewisePolynomial::constant(force).into()];
        Self { forces, ..Self::constant_targets(target).with_fingers(fingers) }
    }

    /// Refuses a schedule that driven fingers cannot follow between `from` and `until`.
    pub fn require_smooth(&self, from: f64, until: f64) -> Result {
        self.schedule.require_smooth("schedule", from, until)
    }

    /// Refuses more samples of noise than a run can be divided into.
    pub fn require_countable(&self, from: f64, until: f64) -> Result {
        if let Some(Sampled { controller, .. }) = &self.sampled {
            controller.require_countable(from, until)?;
        }
        require_countable(&self.noises, from, until)
    }

    /// The first instant after `t` at which an input may jump or kink, or infinity if there is none. With it
    /// a run finds its segments one by one and needs no list of them.
    pub fn next_breakpoint(&self, t: f64) -> f64 {
        self.blocks().map(|(origin, block)| block.next_break(origin, t)).fold(self.next_other(t), f64::min)
    }

    /// The same. `ahead` is empty, or has the next breakpoints after an instant before `t` of the blocks of a discrete
    /// controller and of all else, which are looked for again only once they have passed.
    pub fn next_after(&self, t: f64, ahead: &mut Vec<f64>) -> f64 {
        if self.sampled.is_none() {
            return self.next_other(t);
        }
        let mut first = f64::INFINITY;
        for (k, block) in std::iter::once(None).chain(self.blocks().map(Some)).enumerate() {
            if ahead.len() <= k {
                ahead.push(f64::NEG_INFINITY);
            }
            if ahead[k] <= t {
                ahead[k] =
                    block.map_or_else(|| self.next_other(t), |(origin, block)| block.next_break(origin, t));
            }
            first = first.min(ahead[k]);
        }
        first
    }

    /// The blocks of the discrete controller, with the instant from which their samples count.
    fn blocks(&self) -> impl Iterator<Item = (f64, &SampledController)> {
        self.sampled.iter().flat_map(|own| own.controller.blocks().map(move |one| (own.origin, one)))
    }

    /// The first breakpoint after `t` of all but a discrete controller.
    pub(crate) fn next_other(&self, t: f64) -> f64 {
        let waves = self.sines.iter().flat_map(|sine| [sine.start, sine.end]).filter(|&time| time > t);
        let impulse = self.impulses.partition_point(|impulse| impulse.time <= t);
        let scheduled = self.held.is_none() && self.sampled.is_none();
        std::iter::once(if scheduled { self.schedule.next_break(t) } else { f64::INFINITY })
            .chain(self.forces.iter().map(|force| force.next_break(t)))
            .chain(waves)
            .chain(self.impulses.get(impulse).map(|impulse| impulse.time))
            .chain(self.noises.iter().map(|noise| noise.next_break(t)))
            .chain(self.frame.iter().map(|own| own.acceleration.next_break(t).min(own.tilt.next_break(t))))
            .min_by(f64::total_cmp)
            .unwrap_or(f64::INFINITY)
    }

    /// The impulses at exactly `time`, along the hand's axes.
    pub fn impulses_at(&self, time: f64) -> impl Iterator<Item = [f64; 3]> {
        self.fixed_impulses_at(time).map(move |impulse| {
            let Some(frame) = self.frame_from(time) else { return impulse };
            let [x, y, moment] = impulse;
            let [x, y] = frame.at(0.0).in_hand_axes([x, y]);
            [x, y, moment]
        })
    }

    /// The same along fixed axes.
    pub fn fixed_impulses_at(&self, time: f64) -> impl Iterator<Item = [f64; 3]> {
        let here = self.impulses[self.impulses_before(time)..].iter();
        here.take_while(move |impulse| impulse.time == time).map(|impulse| impulse.impulse)
    }

    /// The number of impulses before `time`.
    pub fn impulses_before(&self, time: f64) -> usize {
        self.impulses.partition_point(|impulse| impulse.time < time)
    }

    /// The inputs from `anchor` until the next breakpoint. The torques of a discrete controller, which depend on the
    /// run, are zero here (`SegmentDrive::hold`).
    pub fn segment(&self, anchor: f64) -> SegmentDrive {
        let mut channels = [[0.0; COEFFICIENTS]; CHANNELS];
        if let Some(Held { target, .. }) = self.held {
            (channels[0][0], channels[1][0]) = (target[0], target[1]);
        } else if self.sampled.is_none() {
            channels[..2].copy_from_slice(&self.schedule.shifted(anchor));
        }
        for force in &self.forces {
            for (sum, piece) in channels[2..].iter_mut().zip(force.shifted(anchor)) {
                for (s, c) in sum.iter_mut().zip(piece) {
                    *s += c;
                }
            }
        }
        let held = self.held.map(|held| held.force);
        for force in held.into_iter().chain(self.noises.iter().map(|noise| noise.at(anchor))) {
            for (channel, force) in channels[2..].iter_mut().zip(force) {
                channel[0] += force;
            }
        }
        let waves = self
            .sines
            .iter()
            .filter(|sine| sine.start <= anchor && anchor < sine.end)
            .map(|&Sinusoid { start, omega, phase, amplitude: [x, y, moment], .. }| {
                let phase = omega.mul_add(anchor - start, phase);
                Wave { numbers: [omega, phase, x, y, moment], active: 1 }
            })
            .collect();
        // Adding zero turns -0.0 into 0.0. Evaluated beside a lane of higher degree, -0.0 would become 0.0 as
        // well, and the bits of a run must not depend on the runs beside it.
        for coefficient in channels.iter_mut().flatten() {
            *coefficient += 0.0;
        }
        let degree =
            (0..COEFFICIENTS).rev().find(|&d| channels.iter().any(|channel| channel[d] != 0.0)).unwrap_or(0);
        let frame = self.frame_from(anchor).map(Box::new);
        SegmentDrive { channels, degrees: [degree; MOST], degree, waves, frame, ..SegmentDrive::still() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_follow_breaks_and_leave_out_inputs_that_have_ended() {
        let force =
            PiecewisePolynomial::steps("pulse", [0.0; 3], &[1.0, 2.0], &[[3.0, 0.0, 0.5], [0.0; 3]]).unwrap();
        let sine = Sinusoid { start: 0.5, end: 1.5, omega: 2.0, phase: 0.25, amplitude: [1.0, 0.0, 0.0] };
        let inputs = Inputs::new(
            PiecewisePolynomial::constant([0.1, 0.2]).into(),
            vec![force.into()],
            vec![sine],
            vec![],
            vec![],
        )
        .unwrap();
        let breakpoints = [0.5, 1.0, 1.5, 2.0, f64::INFINITY];
        for pair in breakpoints.windows(2) {
            assert_eq!(inputs.next_breakpoint(pair[0]), pair[1]);
            assert_eq!(inputs.next_breakpoint(pair[0].next_down()), pair[0]);
        }
        assert_eq!(inputs.segment(0.0).at(0.3).force, [0.0, 0.0, 0.0]);
        let x = inputs.segment(1.0).at(0.25).force[0];
        assert!((x - (3.0 + (2.0_f64 * 0.75 + 0.25).sin())).abs() < 1e-15, "{x}");
        assert_eq!(inputs.segment(1.5).at(0.25).force, [3.0, 0.0, 0.5]);
        assert_eq!(inputs.segment(2.0).at(0.0).force, [0.0; 3]);
        assert_eq!(inputs.segment(2.0).at(9.0).target, [0.1, 0.2]);
    }

    /// A pulse acts from its time on, until its duration has passed.
    #[test]
    fn a_pulse_acts_between_its_breakpoints() {
        let inputs = Inputs::constant_targets([0.1; 2]).with_pulse(1.0, 0.5, [3.0, -4.0, 0.5]).unwrap();
        assert_eq!(inputs.next_breakpoint(0.0), 1.0);
        assert_eq!(inputs.next_breakpoint(1.0), 1.5);
        assert_eq!(inputs.next_breakpoint(1.5), f64::INFINITY);
        let at = [0.0, 1.0, 1.5].map(|t| inputs.segment(t).at(0.0).force);
        assert_eq!(at, [[0.0; 3], [3.0, -4.0, 0.5], [0.0; 3]]);
        let refused = |time, duration, force| {
            Inputs::constant_targets([0.1; 2]).with_pulse(time, duration, force).unwrap_err().to_string()
        };
        assert_eq!(refused(1.0, 0.0, [1.0; 3]), "pulse.duration = 0.0: must be finite and > 0");
        assert_eq!(
            refused(1.0, 1e-17, [1.0; 3]),
            "pulse.times[1] = 1.0: must be greater than the time before it"
        );
        assert!(refused(f64::NAN, 1.0, [1.0; 3]).starts_with("pulse.times[0] = NaN: must be finite"));
        assert!(refused(1.0, 1.0, [f64::INFINITY, 0.0, 0.0]).starts_with("pulse.coefficients[1] = inf"));
    }

    #[test]
    fn frozen_inputs_keep_the_steps_and_leave_out_what_averages_to_zero() {
        let ramp = PiecewisePolynomial::new(
            "schedule",
            vec![0.0],
            vec![[[0.1, 0.0, 0.0, 0.0, 0.0, 0.0]; 2], [[0.1, 0.5, 0.0, 0.0, 0.0, 0.0]; 2]],
        )
        .unwrap();
        let force = |value: f64| {
            PiecewisePolynomial::steps("pulse", [0.0; 3], &[1.0, 2.0], &[[value, 0.0, 0.5], [0.0; 3]])
                .unwrap()
        };
        let sine =
            Sinusoid { start: 0.5, end: f64::INFINITY, omega: 2.0, phase: 0.25, amplitude: [1.0, 0.0, 0.0] };
        let impulse = Impulse { time: 1.5, impulse: [1.0, 0.0, 0.0] };
        let noise = Noise {
            std: [1.0; 3],
            acceleration: [0.0; 2],
            rate: 100.0,
            start: 0.0,
            end: f64::INFINITY,
            key: [0, 0],
            stream: 0,
        };
        let forces = vec![force(3.0).into(), force(4.0).into()];
        let inputs = Inputs::new(ramp.into(), forces, vec![sine], vec![impulse], vec![noise]).unwrap();
        let frozen = inputs.frozen(1.0);
        assert_eq!(frozen.next_breakpoint(f64::NEG_INFINITY), f64::INFINITY);
        let input = frozen.segment(1.0).at(7.0);
        assert_eq!(input.target, [0.6, 0.6]);
        assert_eq!((input.target_rate, input.target_acceleration), ([0.0; 2], [0.0; 2]));
        assert_eq!(input.force, [7.0, 0.0, 1.0]);
        assert_eq!(inputs.frozen(2.0).segment(0.0).at(0.0).force, [0.0; 3]);
    }
}
