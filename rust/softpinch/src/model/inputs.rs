//! The inputs of a scene: finger targets and external forces as piecewise polynomials and sinusoids on
//! breakpoints, held noise, and ideal impulses.
//!
//! Integration goes segment by segment between breakpoints. Inside a segment every channel is one polynomial
//! in the time since the segment's start, so an evaluation takes a few multiply-adds, or none if all channels
//! are constant.

use std::sync::Arc;

use crate::error::Error;
use crate::model::control::Fingers;
use crate::model::drive::{CHANNELS, COEFFICIENTS, MAX_DEGREE, SegmentDrive, Wave};
use crate::model::noise::{Noise, require_countable};
use crate::model::rule::Rule;
use crate::model::sampled::SampledController;
use crate::number::lanes::MOST;

/// Jumps below this share of a polynomial's terms count as round-off.
const SMOOTH: f64 = 1e-9;
/// `C` channels, each a polynomial of degree five or less on every piece. Row 0 holds before the first break
/// and has only a constant. Row k + 1 holds from break k on, in ascending powers of the time since that
/// break.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PiecewisePolynomial<const C: usize> {
    breaks: Vec<f64>,
    rows: Vec<[[f64; COEFFICIENTS]; C]>,
}

impl<const C: usize> PiecewisePolynomial<C> {
    /// Checks breaks and rows. Errors use `name` for the polynomial.
    pub fn new(name: &str, breaks: Vec<f64>, rows: Vec<[[f64; COEFFICIENTS]; C]>) -> Result<Self, Error> {
        for (k, &time) in breaks.iter().enumerate() {
            Rule::Finite.check_named(|| format!("{name}.times[{k}]"), time)?;
            if k > 0 && time <= breaks[k - 1] {
                return Err(Error::Field {
                    field: format!("{name}.times[{k}]"),
                    value: time,
                    rule: "must be greater than the time before it",
                });
            }
        }
        if rows.len() != breaks.len() + 1 {
            return Err(Error::Shape {
                field: format!("{name}.coefficients"),
                found: format!("{} rows for {} breaks", rows.len(), breaks.len()),
                rule: "there must be one row more than breaks",
            });
        }
        for (k, value) in rows.iter().flatten().flatten().enumerate() {
            Rule::Finite
                .check_named(|| format!("{name}.coefficients[{}]", k / (C * COEFFICIENTS)), *value)?;
        }
        Ok(Self { breaks, rows })
    }

    /// Values that are constant at all times.
    #[must_use]
    pub fn constant(values: [f64; C]) -> Self {
        let row = values.map(|value| {
            let mut coefficients = [0.0; COEFFICIENTS];
            coefficients[0] = value;
            coefficients
        });
        Self { breaks: Vec::new(), rows: vec![row] }
    }

    /// Steps to `values[k]` at `times[k]`, with the value `before` until the first step.
    pub fn steps(name: &str, before: [f64; C], times: &[f64], values: &[[f64; C]]) -> Result<Self, Error> {
        let rows = std::iter::once(&before).chain(values).map(|row| Self::constant(*row).rows[0]).collect();
        Self::new(name, times.to_vec(), rows)
    }

    /// Refuses a jump or a kink between `from` and `until`: a finger that follows the polynomials exactly
    /// cannot make one. Round-off of the terms of the pieces is allowed.
    fn require_smooth(&self, name: &'static str, from: f64, until: f64) -> Result<(), Error> {
        let mut origin = None;
        for (k, &time) in self.breaks.iter().enumerate() {
            let length = origin.map_or(0.0, |origin: f64| time - origin);
            if from < time && time < until {
                for (before, after) in self.rows[k].iter().zip(&self.rows[k + 1]) {
                    let (mut place, mut pace, mut power) = ([0.0; 2], [0.0; 2], 1.0);
                    for (n, &c) in before.iter().enumerate() {
                        place = [c.mul_add(power, place[0]), (c * power).abs() + place[1]];
                        if let Some(&next) = before.get(n + 1) {
                            #[allow(clippy::cast_precision_loss)] // up to five
                            let slope = (n + 1) as f64 * next * power;
                            pace = [pace[0] + slope, pace[1] + slope.abs()];
                        }
                        power *= length;
                    }
                    let jumps = |[value, size]: [f64; 2], other: f64| {
                        (value - other).abs() > SMOOTH * (size + other.abs())
                    };
                    let what = match (jumps(place, after[0]), jumps(pace, after[1])) {
                        (true, _) => "steps",
                        (false, true) => "kinks",
                        _ => continue,
                    };
                    return Err(Error::NotSmooth { name, time, what });
                }
            }
            origin = Some(time);
        }
        Ok(())
    }

    /// The first break after `t`, or infinity if there is none.
    fn next_break(&self, t: f64) -> f64 {
        let next = self.breaks.partition_point(|&time| time <= t);
        self.breaks.get(next).copied().unwrap_or(f64::INFINITY)
    }

    /// The values at time `t`, and their rates.
    fn value_and_rate(&self, t: f64) -> [[f64; C]; 2] {
        let piece = self.breaks.partition_point(|&time| time <= t);
        let tau = piece.checked_sub(1).and_then(|k| self.breaks.get(k)).map_or(0.0, |start| t - start);
        let (mut values, mut rates) = ([0.0; C], [0.0; C]);
        for (channel, row) in self.rows.get(piece).into_iter().flatten().enumerate() {
            for coefficient in row.iter().rev() {
                rates[channel] = rates[channel].mul_add(tau, values[channel]);
                values[channel] = values[channel].mul_add(tau, *coefficient);
            }
        }
        [values, rates]
    }

    /// The polynomials that hold from `anchor` on, in powers of the time since `anchor`.
    fn shifted(&self, anchor: f64) -> [[f64; COEFFICIENTS]; C] {
        let piece = self.breaks.partition_point(|&time| time <= anchor);
        let row = self.rows.get(piece).copied().unwrap_or([[0.0; COEFFICIENTS]; C]);
        match piece.checked_sub(1).and_then(|k| self.breaks.get(k)) {
            Some(&origin) if origin != anchor => row.map(|c| taylor_shift(c, anchor - origin)),
            _ => row,
        }
    }
}

/// The coefficients of the same polynomial about an origin that is later by `by` (repeated synthetic
/// division).
fn taylor_shift(mut c: [f64; COEFFICIENTS], by: f64) -> [f64; COEFFICIENTS] {
    for low in 0..MAX_DEGREE {
        for k in (low..MAX_DEGREE).rev() {
            if c[k + 1] != 0.0 {
                c[k] = c[k + 1].mul_add(by, c[k]);
            }
        }
    }
    c
}

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
#[derive(Debug, Clone, PartialEq)]
pub struct Inputs {
    schedule: Arc<PiecewisePolynomial<2>>,
    forces: Vec<Arc<PiecewisePolynomial<3>>>,
    sines: Vec<Sinusoid>,
    impulses: Vec<Impulse>,
    noises: Vec<Noise>,
    fingers: Fingers,
    held: Option<Held>,
    sampled: Option<Sampled>,
}

/// A discrete controller and the instant of its first sample, s. The schedule has its target angles.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    /// The controller.
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
}

impl Inputs {
    /// Inputs for PID fingers. Sinusoids, impulses and noises are checked.
    pub fn new(
        schedule: Arc<PiecewisePolynomial<2>>,
        forces: Vec<Arc<PiecewisePolynomial<3>>>,
        sines: Vec<Sinusoid>,
        mut impulses: Vec<Impulse>,
        noises: Vec<Noise>,
    ) -> Result<Self, Error> {
        for (k, sine) in sines.iter().enumerate() {
            let name = |field: &str| format!("sines[{k}].{field}");
            Rule::Finite.check_named(|| name("start"), sine.start)?;
            Rule::Finite.check_named(|| name("omega"), sine.omega)?;
            Rule::Finite.check_named(|| name("phase"), sine.phase)?;
            // Only `end` may be infinite.
            if sine.end.is_nan() || sine.end < sine.start {
                return Err(Error::Field {
                    field: name("end"),
                    value: sine.end,
                    rule: "must not be before the start",
                });
            }
            for amplitude in sine.amplitude {
                Rule::Finite.check_named(|| name("amplitude"), amplitude)?;
            }
        }
        for (k, impulse) in impulses.iter().enumerate() {
            Rule::Finite.check_named(|| format!("impulses[{k}].time"), impulse.time)?;
            for component in impulse.impulse {
                Rule::Finite.check_named(|| format!("impulses[{k}].impulse"), component)?;
            }
        }
        for (k, noise) in noises.iter().enumerate() {
            noise.check(k)?;
        }
        impulses.sort_by(|a, b| a.time.total_cmp(&b.time));
        Ok(Self {
            schedule,
            forces,
            sines,
            impulses,
            noises,
            fingers: Fingers::Pid,
            held: None,
            sampled: None,
        })
    }

    /// PID fingers that hold their targets, without disturbances.
    #[must_use]
    pub fn constant_targets(target: [f64; 2]) -> Self {
        Self {
            schedule: PiecewisePolynomial::constant(target).into(),
            forces: Vec::new(),
            sines: Vec::new(),
            impulses: Vec::new(),
            noises: Vec::new(),
            fingers: Fingers::Pid,
            held: None,
            sampled: None,
        }
    }

    /// The same inputs, for fingers that move in the given way.
    #[must_use]
    pub fn with_fingers(self, fingers: Fingers) -> Self {
        Self { fingers, ..self }
    }

    /// How the fingers move.
    #[must_use]
    pub fn fingers(&self) -> Fingers {
        self.fingers
    }

    /// Holds inputs from outside; `None` goes back to the schedule. They make no breakpoint.
    pub fn hold(&mut self, held: Option<Held>) {
        self.held = held;
    }

    /// The same inputs, with the torques of a discrete controller whose targets are the schedule.
    #[must_use]
    pub fn with_controller(self, controller: Arc<SampledController>, origin: f64) -> Self {
        Self { fingers: Fingers::Torque, sampled: Some(Sampled { controller, origin }), ..self }
    }

    /// The discrete controller of the fingers, if there is one.
    #[must_use]
    pub fn sampled(&self) -> Option<&Sampled> {
        self.sampled.as_ref()
    }

    /// The schedule's values at time `t`, and their rates.
    #[must_use]
    pub fn target(&self, t: f64) -> [[f64; 2]; 2] {
        self.schedule.value_and_rate(t)
    }

    /// Refuses a schedule that driven fingers cannot follow between `from` and `until`.
    pub fn require_smooth(&self, from: f64, until: f64) -> Result<(), Error> {
        self.schedule.require_smooth("schedule", from, until)
    }

    /// Refuses more samples of noise than a run can be divided into.
    pub fn require_countable(&self, from: f64, until: f64) -> Result<(), Error> {
        if let Some(Sampled { controller, .. }) = &self.sampled {
            controller.require_countable(from, until)?;
        }
        require_countable(&self.noises, from, until)
    }

    /// The first instant after `t` at which an input may jump or kink, or infinity if there is none. With it
    /// a run finds its segments one by one and needs no list of them.
    #[must_use]
    pub fn next_breakpoint(&self, t: f64) -> f64 {
        let waves = self.sines.iter().flat_map(|sine| [sine.start, sine.end]).filter(|&time| time > t);
        let impulse = self.impulses.partition_point(|impulse| impulse.time <= t);
        let scheduled = self.held.is_none() && self.sampled.is_none();
        std::iter::once(if scheduled { self.schedule.next_break(t) } else { f64::INFINITY })
            .chain(self.forces.iter().map(|force| force.next_break(t)))
            .chain(waves)
            .chain(self.impulses.get(impulse).map(|impulse| impulse.time))
            .chain(self.noises.iter().map(|noise| noise.next_break(t)))
            .chain(
                self.sampled.iter().map(|Sampled { controller, origin }| controller.next_break(*origin, t)),
            )
            .min_by(f64::total_cmp)
            .unwrap_or(f64::INFINITY)
    }

    /// The impulses at exactly `time`.
    pub fn impulses_at(&self, time: f64) -> impl Iterator<Item = &Impulse> {
        let first = self.impulses.partition_point(|impulse| impulse.time < time);
        self.impulses[first..].iter().take_while(move |impulse| impulse.time == time)
    }

    /// The inputs from `anchor` until the next breakpoint. The torques of a discrete controller, which depend on the
    /// run, are zero here ([`SegmentDrive::hold`]).
    #[must_use]
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
        if let Some(Held { force, .. }) = self.held {
            for (channel, force) in channels[2..].iter_mut().zip(force) {
                channel[0] += force;
            }
        }
        for noise in &self.noises {
            for (channel, force) in channels[2..].iter_mut().zip(noise.at(anchor)) {
                channel[0] += force;
            }
        }
        let waves = self
            .sines
            .iter()
            .filter(|sine| sine.start <= anchor && anchor < sine.end)
            .map(|sine| Wave {
                omega: sine.omega,
                phase: sine.omega.mul_add(anchor - sine.start, sine.phase),
                amplitude: sine.amplitude,
                active: 1,
            })
            .collect();
        // Adding zero turns -0.0 into 0.0. Evaluated beside a lane of higher degree, -0.0 would become 0.0 as
        // well, and the bits of a run must not depend on the runs beside it.
        for coefficient in channels.iter_mut().flatten() {
            *coefficient += 0.0;
        }
        let degree =
            (0..COEFFICIENTS).rev().find(|&d| channels.iter().any(|channel| channel[d] != 0.0)).unwrap_or(0);
        SegmentDrive { channels, degrees: [degree; MOST], degree, waves, ..SegmentDrive::still() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::drive::Drive;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_shifted_polynomial_has_the_same_values(
            c in prop::array::uniform6(-1.0..1.0_f64), by in -2.0..2.0_f64, t in -2.0..2.0_f64,
        ) {
            let value = |c: &[f64; 6], t: f64| c.iter().rev().fold(0.0, |sum, k| sum * t + k);
            let (a, b) = (value(&taylor_shift(c, by), t), value(&c, t + by));
            prop_assert!((a - b).abs() <= 1e-11, "{a} {b}");
        }
    }

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
}
