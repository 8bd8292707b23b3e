//! The place of a run on its grid, in the loop of equal steps.

use crate::model::scene::Scene;
use crate::stepping::grid::{Grid, Segment};
use crate::stepping::phase::Phase;

pub(super) struct Place {
    pub(super) grid: Grid,
    /// The current segment, the segment before it, and the number of steps before the current segment.
    pub(super) segment: Segment,
    pub(super) earlier: Option<Segment>,
    pub(super) steps_before: u64,
    /// The clock at the end of the segment.
    pub(super) arrival: u64,
    /// The clock until which the saved instant of the run is its last watched one.
    pub(super) saved_until: u64,
    /// The clock at which the run's discrete controller took its last sample.
    pub(super) sampled: Option<u64>,
}

impl Place {
    /// The place at the start of a run, whose first instant is evaluated at the clock `from`.
    pub(super) fn new(grid: Grid, from: u64) -> Self {
        Self {
            segment: grid.first,
            earlier: None,
            steps_before: 0,
            arrival: 0,
            saved_until: from,
            sampled: None,
            grid,
        }
    }

    /// The phase in which a run begins the current segment, once the modes of its contacts are chosen. A run that is resumed
    /// inside a segment has already had the impulses at the start of the segment.
    pub(super) fn phase_at_start(&self, scene: &Scene) -> Phase {
        let Segment { first, start, .. } = self.segment;
        let struck = first == 0 && scene.inputs.impulses_at(start).next().is_some();
        if struck { Phase::Impulse } else { Phase::Step }
    }

    /// Goes on in the segment after the current one.
    pub(super) fn go_on(&mut self, next: Segment) {
        self.steps_before += self.segment.steps();
        self.earlier = Some(std::mem::replace(&mut self.segment, next));
    }

    /// Number of steps in the current segment at this clock, including those of a run that this one resumes.
    pub(super) fn step(&self, clock: u64) -> u64 {
        self.segment.count - (self.arrival - clock)
    }

    /// The time and the grid point at this clock.
    pub(super) fn now(&self, clock: u64) -> (f64, (f64, u64)) {
        let step = self.step(clock);
        (self.segment.time(step), (self.segment.anchor, step))
    }

    /// The segment of the step that ends at this clock, and the number of steps in it up to there.
    pub(super) fn last_step(&self, clock: u64) -> (Segment, u64) {
        let step = self.step(clock);
        match self.earlier {
            Some(earlier) if step == self.segment.first => (earlier, earlier.count),
            _ => (self.segment, step),
        }
    }

    /// The time and the grid point of the run's first instant in the current segment.
    pub(super) fn first(&self) -> (f64, (f64, u64)) {
        (self.segment.start, (self.segment.anchor, self.segment.first))
    }

    /// The time and the grid point of the instant before this clock.
    pub(super) fn before(&self, clock: u64) -> (f64, (f64, u64)) {
        let (segment, step) = self.last_step(clock);
        let step = step.saturating_sub(1).max(segment.first);
        (segment.time(step), (segment.anchor, step))
    }
}
