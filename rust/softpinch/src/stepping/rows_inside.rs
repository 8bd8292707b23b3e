//! Rows between the ends of equal steps. Each takes a step of the run's own method from the start of the step around
//! it, so that a row is as accurate as the ends of steps, whatever the method. The run itself does not change.

use crate::formulation::equations::States;
use crate::formulation::scene_equations::SceneEquations;
use crate::formulation::system::System;
use crate::method::traits::Unsolved;
use crate::number::lanes::Lanes;
use crate::stepping::contact_lane::Moment;
use crate::stepping::ending::full;
use crate::stepping::equal_lanes::EqualLanes;
use crate::stepping::grid::round_off;
use crate::stepping::instant::{column, watched};
use crate::stepping::lone_steps::LoneSteps;
use crate::stepping::queue::{RunQueue, Sample};
use crate::stepping::record::Instant;

/// A row closer to the start of its step than this share of the step has the state there.
const SLIVER: f64 = 1.0 / (1u64 << 44) as f64;

/// The rows inside the last step, and the steps that lead to them.
#[derive(Default)]
pub(super) struct RowsInside {
    /// The equations and the method, once there was a row; runs with unilateral contact have their own.
    steps: Option<Box<LoneSteps>>,
    /// The rows, until it is known how far the run gets in this step.
    rows: Vec<Sample>,
}

impl<'a, R: Lanes, Q: RunQueue<'a>> EqualLanes<'_, 'a, R, Q> {
    /// Computes the instants that were asked for before the end of the step that the run in lane 0 takes from the time
    /// `tau` of its segment and the state `y`.
    #[cold]
    #[inline(never)]
    pub(super) fn look_inside(
        &mut self,
        system: &SceneEquations<R>,
        tau: R,
        y: &States<R>,
    ) -> Result<(), Unsolved> {
        let (tau, y) = (tau.lane(0), column(y, 0));
        let Some(run) = &mut self.batch.runs[0] else { return Ok(()) };
        let (start, end) = (run.place.now(self.clock).0, run.place.now(self.clock + 1).0);
        if let Some(steps) = &mut self.inside.steps {
            steps.method.forget_start();
        }
        loop {
            let time = self.batch.queue.next_time();
            if time >= end {
                return Ok(());
            }
            self.batch.queue.is_due(time, true);
            // A step as short as round-off might not be solved.
            let shortest = round_off(start, end).max(SLIVER * (end - start));
            let length = if time - start <= shortest { 0.0 } else { time - start };
            let row = if let Some(contact) = &mut run.contact {
                contact.inside(&Moment { earlier: false, tau, h: length, y: &y })?
            } else {
                let mut drive = run.scene.inputs.segment(run.place.segment.anchor);
                if let Some(controller) = &run.controller {
                    drive.hold(controller.held());
                }
                let how = (self.batch.instructions, self.batch.options);
                let new = || Box::new(LoneSteps::new(how.0, how.1, &run.scene));
                let steps = self.inside.steps.get_or_insert_with(new);
                let next = if length > 0.0 { steps.step(&drive, (tau, &y), length)? } else { y };
                let now = steps.evaluate(&drive, tau + length, &next);
                self.batch.stats.evaluations += 1 + steps.take_stats().evaluations;
                watched(system.size(), (0, None), &now, &next, time, (time, 0))
            };
            // After an overflow the run ends at this step.
            if row.is_finite() {
                let instant = Instant { t: time, grid: (time, 0), ..row.instant };
                self.inside.rows.push(Sample { instant, ..row });
            }
        }
    }

    /// Records the rows inside the last step, which the run has followed until the time `until`. Returns whether the
    /// run goes on: it ends if there is no memory for a row.
    #[cold]
    #[inline(never)]
    pub(super) fn record_inside(&mut self, system: &SceneEquations<R>, until: f64) -> bool {
        for row in std::mem::take(&mut self.inside.rows) {
            if row.instant.t >= until {
                break;
            }
            if let Err(error) = self.batch.record(system, &row) {
                self.retire(system, 0, full(row.instant.t, &error), &row);
                return false;
            }
        }
        true
    }

    /// Whether there are rows to record.
    #[inline(always)]
    pub(super) fn has_rows_inside(&self) -> bool {
        R::WIDTH == 1 && !self.inside.rows.is_empty()
    }
}
