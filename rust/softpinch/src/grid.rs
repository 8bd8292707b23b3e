//! The times of a run: segments between breakpoints, each cut into equal steps, counted, never added up.

use crate::error::Error;
use crate::inputs::Inputs;
use crate::parameters::Rule;
use crate::start::State;

/// Most steps of one run. At a few million steps a second these are hours.
const MOST_STEPS: f64 = 1e11;

/// One stretch without a breakpoint inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Its first instant: a breakpoint, or where the run (or the one that it goes on from) began.
    pub anchor: f64,
    /// Its last instant.
    pub end: f64,
    /// Length of a step.
    pub h: f64,
    /// Steps that an earlier run has taken in it.
    pub first: u64,
    /// Steps in all.
    pub count: u64,
}

impl Segment {
    /// From `anchor` to `end` in the fewest equal steps that are not longer than `dt`.
    fn new(anchor: f64, end: f64, dt: f64) -> Result<Self, Error> {
        let length = end - anchor;
        // A dt that divides the segment but for round-off must not cost one step more.
        let whole = (length / dt * (1.0 - 1e-12)).ceil().max(1.0);
        if whole.is_nan() || whole > MOST_STEPS {
            return Err(too_many(length / dt));
        }
        // And its steps are dt itself, to the bit, however the run is cut.
        let round_off = 4.0 * f64::EPSILON * anchor.abs().max(end.abs());
        let h = if whole.mul_add(dt, -length).abs() <= round_off { dt } else { length / whole };
        if whole > 1.0 && h <= round_off {
            return Err(Error::Field {
                field: "dt".to_owned(),
                value: dt,
                rule: "must be more than round-off of the times that it steps between",
            });
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a whole number from 1 to 1e11
        let count = whole as u64;
        Ok(Self { anchor, end, h, first: 0, count })
    }

    /// The time since the anchor after `step` steps.
    #[inline(always)]
    #[must_use]
    pub fn tau(&self, step: u64) -> f64 {
        #[allow(clippy::cast_precision_loss)] // at most 1e11
        let steps = step as f64;
        steps * self.h
    }

    /// The time after `step` steps.
    #[inline(always)]
    #[must_use]
    pub fn time(&self, step: u64) -> f64 {
        if step == self.count { self.end } else { self.anchor + self.tau(step) }
    }

    /// With each step cut into `refine` equal ones.
    fn refined(self, refine: u32) -> Self {
        Self { h: self.h / f64::from(refine), count: self.count * u64::from(refine), ..self }
    }

    /// The segment as a run that `grid` describes would go on in it, where that leads to `time`.
    fn resumed(mut self, step: u64, time: f64) -> Option<Self> {
        let close = 4.0 * f64::EPSILON * self.anchor.abs().max(time.abs());
        self.first = step;
        (step < self.count && (self.anchor + self.tau(step) - time).abs() <= close).then_some(self)
    }
}

fn too_many(needed: f64) -> Error {
    Error::TooLarge {
        what: "the run's steps (duration / dt)",
        needed,
        limit: MOST_STEPS,
        advice: "raise dt or shorten duration",
    }
}

/// The ends of the stretches between breakpoints of a run from `state` over `duration`, its start first.
pub fn stretches(inputs: &Inputs, state: &State, duration: f64) -> Result<Vec<f64>, Error> {
    Rule::Positive.check("duration", duration)?;
    Rule::Finite.check("initial.time", state.time)?;
    let start = state.time;
    let end = start + duration;
    if !end.is_finite() || end <= start {
        return Err(Error::Field {
            field: "duration".to_owned(),
            value: duration,
            rule: "must reach a later, finite instant from initial.time",
        });
    }
    inputs.require_countable(start, end)?;
    let mut points = vec![start];
    points.extend(inputs.breakpoints(start, end));
    points.push(end);
    Ok(points)
}

/// The segments of a run from `state` over `duration` with steps of at most `dt`, each then cut into `refine` equal ones: so
/// that the coarse grid's instants are instants of the fine one, whatever the segments' lengths.
pub fn segments(
    inputs: &Inputs,
    state: &State,
    duration: f64,
    dt: f64,
    refine: u32,
) -> Result<Vec<Segment>, Error> {
    Rule::Positive.check("dt", dt)?;
    let refine = refine.max(1);
    let points = stretches(inputs, state, duration)?;
    let start = state.time;
    let mut segments = Vec::with_capacity(points.len());
    let mut total = 0.0;
    for pair in points.windows(2) {
        let &[from, to] = pair else { continue };
        let mut segment = Segment::new(from, to, dt)?.refined(refine);
        if let (true, Some((anchor, step))) = (from == start, state.grid) {
            // No breakpoint since the anchor, so the earlier run's segment goes on.
            let unbroken = anchor < start && inputs.breakpoints(anchor, start.next_up()).is_empty();
            let whole = if unbroken { Segment::new(anchor, to, dt).ok() } else { None };
            let earlier = whole.and_then(|whole| {
                whole.refined(refine).resumed(step.saturating_mul(u64::from(refine)), start)
            });
            segment = earlier.unwrap_or(segment);
        }
        #[allow(clippy::cast_precision_loss)] // compared with a limit, no more
        let steps = (segment.count - segment.first) as f64;
        total += steps;
        segments.push(segment);
    }
    if total > MOST_STEPS { Err(too_many(total)) } else { Ok(segments) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_that_divides_the_segment_is_kept_to_the_bit() {
        for (from, to) in [(0.0, 1.0), (0.3, 0.7), (1.0, 3.0), (0.1 + 0.2, 8.0)] {
            let segment = Segment::new(from, to, 1e-4).unwrap();
            assert_eq!(segment.h, 1e-4, "{from} {to}");
            assert_eq!(segment.time(segment.count), to);
        }
        let uneven = Segment::new(0.0, 1.0, 3e-4).unwrap();
        assert_eq!(uneven.count, 3334);
        assert_eq!(uneven.h, 1.0 / 3334.0);
        let fine = uneven.refined(4);
        assert_eq!((fine.count, fine.h), (4 * 3334, 0.25 / 3334.0));
        assert!((0..=3334).all(|k| fine.time(4 * k) == uneven.time(k)));
    }

    #[test]
    fn what_would_never_end_is_refused() {
        let inputs = Inputs::hold([0.0; 2]);
        let state = State::at_rest([0.0; 9]);
        for (duration, dt) in
            [(1.0, 1e-300), (1e300, 1e-4), (f64::INFINITY, 1.0), (1.0, 0.0), (1.0, f64::NAN)]
        {
            assert!(segments(&inputs, &state, duration, dt, 1).is_err(), "{duration} {dt}");
        }
    }
}
