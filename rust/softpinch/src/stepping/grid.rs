//! The times of a run: segments between breakpoints, each divided into equal steps. The time of a step is
//! computed from its number, not by adding up steps.
//!
//! A run finds its segments one at a time when it reaches them, because held noise may divide it into millions.

use crate::error::{Error, Result, require};
use crate::model::{Inputs, Rule, Scene, State};

/// Largest number of steps of one run. At a few million steps a second they take hours.
pub const MOST_STEPS: f64 = 1e11;

/// Finds the times of the steps of a run, from its number and its scene.
pub type GridOf<'a> = dyn Fn(usize, &Scene) -> Result<Grid> + 'a;

/// A segment of a run: a stretch of time without a breakpoint inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// The start of the segment: a breakpoint, or the start of the run, or that of the run that it resumes.
    pub anchor: f64,
    /// The first instant of this run in the segment: the anchor, unless the run resumes another one.
    pub start: f64,
    pub end: f64,
    pub h: f64,
    /// Steps that the resumed run has already taken in the segment.
    pub first: u64,
    pub count: u64,
}

impl Segment {
    /// Divides the time from `anchor` to `end` into the fewest equal steps that are not longer than `dt`.
    fn new(anchor: f64, end: f64, dt: f64) -> Self {
        let length = end - anchor;
        // A dt that divides the segment except for round-off must not cost one more step.
        let whole = (length / dt * (1.0 - 1e-12)).ceil().max(1.0);
        // The steps are then dt itself, to the bit, however the run is divided.
        let h = if whole.mul_add(dt, -length).abs() <= round_off(anchor, end) { dt } else { length / whole };
        let count = whole as u64; // a whole number, saturating
        Self { anchor, start: anchor + 0.0, end, h, first: 0, count }
    }

    /// Refuses steps that are too many to count, or so short that double precision does not tell their times apart.
    fn require_countable(&self, dt: f64) -> Result {
        let steps = self.count as f64;
        if steps > MOST_STEPS {
            return Err(too_many((self.end - self.anchor) / dt));
        }
        let resolved = self.count <= 1 || self.h > round_off(self.anchor, self.end);
        require(resolved, "dt", dt, "must be more than round-off of the times that it steps between")
    }

    /// The time since the anchor after `step` steps.
    #[inline(always)]
    pub fn tau(&self, step: u64) -> f64 {
        let steps = step as f64; // at most 1e11
        steps * self.h
    }

    #[inline(always)]
    pub fn time(&self, step: u64) -> f64 {
        if step == self.first {
            self.start
        } else if step == self.count {
            self.end
        } else {
            self.anchor + self.tau(step)
        }
    }

    /// Number of steps that this run takes in the segment.
    pub fn steps(&self) -> u64 {
        self.count - self.first
    }

    /// The segment with each step divided into `refine` equal ones.
    fn refined(self, refine: u32) -> Self {
        Self { h: self.h / f64::from(refine), count: self.count.saturating_mul(u64::from(refine)), ..self }
    }

    /// The segment of a run that resumes another one after `step` steps, if these lead to `time`.
    fn resumed(self, step: u64, time: f64) -> Option<Self> {
        let close = round_off(self.anchor, time);
        let leads_there = step < self.count && (self.anchor + self.tau(step) - time).abs() <= close;
        leads_there.then_some(Self { first: step, start: time, ..self })
    }
}

/// The round-off that times as large as these may have.
pub fn round_off(a: f64, b: f64) -> f64 {
    4.0 * f64::EPSILON * a.abs().max(b.abs())
}

fn too_many(needed: f64) -> Error {
    let (what, advice) = ("the run's steps (duration / dt)", "raise dt or shorten duration");
    Error::TooLarge { what, needed, limit: MOST_STEPS, advice }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    pub start: f64,
    pub end: f64,
}

impl Span {
    /// The span of a run from `state` over `duration`, after a check of both.
    pub fn new(inputs: &Inputs, state: &State, duration: f64) -> Result<Self> {
        Rule::Positive.check("duration", duration)?;
        Rule::Finite.check("initial.time", state.time)?;
        let start = state.time;
        let end = start + duration;
        let rule = "must reach a later, finite instant from initial.time";
        require(end.is_finite() && end > start, "duration", duration, rule)?;
        inputs.require_countable(start, end)?;
        Ok(Self { start, end })
    }

    pub fn segment_end(&self, inputs: &Inputs, from: f64) -> f64 {
        inputs.next_breakpoint(from).min(self.end)
    }
}

/// The segments of a run in steps of at most `dt`, with each step then divided into `refine` equal ones. In this way
/// the instants of the coarse grid are instants of the fine one, whatever the lengths of the segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    span: Span,
    dt: f64,
    refine: u32,
    pub first: Segment,
    pub segments: u64,
    pub steps: u64,
    pub longest: f64,
    /// Of `Inputs::next_after`.
    ahead: Vec<f64>,
}

impl Grid {
    /// The grid of a run from `state` over `duration`. Every segment is checked.
    pub fn new(inputs: &Inputs, state: &State, duration: f64, dt: f64, refine: u32) -> Result<Self> {
        Rule::Positive.check("dt", dt)?;
        Self::over(inputs, state, Span::new(inputs, state, duration)?, dt, refine)
    }

    /// The grid of a run from `state` over a span that has been checked.
    pub fn over(inputs: &Inputs, state: &State, span: Span, dt: f64, refine: u32) -> Result<Self> {
        let refine = refine.max(1);
        let to = span.segment_end(inputs, span.start);
        let first = Segment::new(span.start, to, dt);
        first.require_countable(dt)?;
        let resumed = state.grid.and_then(|(anchor, step)| {
            // There is no breakpoint between the anchor and the start, so the segment of the resumed run goes on.
            let unbroken = anchor < span.start && inputs.next_breakpoint(anchor) > span.start;
            let whole = unbroken.then(|| Segment::new(anchor, to, dt))?;
            whole.require_countable(dt).ok()?;
            whole.refined(refine).resumed(step.saturating_mul(u64::from(refine)), span.start)
        });
        let first = resumed.unwrap_or(Segment { start: span.start, ..first.refined(refine) });
        let mut grid =
            Self { span, dt, refine, first, segments: 0, steps: 0, longest: 0.0, ahead: Vec::new() };
        let (mut next, mut total) = (Some(first), 0.0);
        while let Some(segment) = next {
            let steps = segment.steps() as f64;
            total += steps;
            grid.segments += 1;
            grid.steps = grid.steps.saturating_add(segment.steps());
            grid.longest = grid.longest.max(segment.h);
            let coarse = grid.cut_after(inputs, &segment);
            coarse.map_or(Ok(()), |coarse| coarse.require_countable(dt))?;
            next = coarse.map(|coarse| coarse.refined(refine));
        }
        grid.ahead.clear();
        if total > MOST_STEPS { Err(too_many(total)) } else { Ok(grid) }
    }

    pub fn after(&mut self, inputs: &Inputs, segment: &Segment) -> Option<Segment> {
        self.cut_after(inputs, segment).map(|coarse| coarse.refined(self.refine))
    }

    pub fn is_last(&self, segment: &Segment) -> bool {
        segment.end >= self.span.end
    }

    /// The segment after this one, before its steps are refined.
    fn cut_after(&mut self, inputs: &Inputs, segment: &Segment) -> Option<Segment> {
        let from = segment.end;
        (!self.is_last(segment))
            .then(|| Segment::new(from, inputs.next_after(from, &mut self.ahead).min(self.span.end), self.dt))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_that_divides_the_segment_is_kept_to_the_bit() {
        for (from, to) in [(0.0, 1.0), (0.3, 0.7), (1.0, 3.0), (0.1 + 0.2, 8.0)] {
            let segment = Segment::new(from, to, 1e-4);
            assert_eq!(segment.h, 1e-4, "{from} {to}");
            assert_eq!(segment.time(segment.count), to);
        }
        let uneven = Segment::new(0.0, 1.0, 3e-4);
        assert_eq!(uneven.count, 3334);
        assert_eq!(uneven.h, 1.0 / 3334.0);
        let fine = uneven.refined(4);
        assert_eq!((fine.count, fine.h), (4 * 3334, 0.25 / 3334.0));
        assert!((0..=3334).all(|k| fine.time(4 * k) == uneven.time(k)));
    }

    #[test]
    fn impossible_durations_and_steps_are_refused() {
        let inputs = Inputs::constant_targets([0.0; 2]);
        let state = State::at_rest([0.0; 9].into());
        for (duration, dt) in
            [(1.0, 1e-300), (1e300, 1e-4), (f64::INFINITY, 1.0), (1.0, 0.0), (1.0, f64::NAN)]
        {
            assert!(Grid::new(&inputs, &state, duration, dt, 1).is_err(), "{duration} {dt}");
        }
    }
}
