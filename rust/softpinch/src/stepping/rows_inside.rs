//! Rows between the ends of equal steps. Each takes a step of the run's own method from the start of the step around
//! it, so that a row is as accurate as the ends of steps, whatever the method. The run itself does not change.

use crate::formulation::equations::States;
use crate::formulation::scene_equations::SceneEquations;
use crate::formulation::system::System;
use crate::method::traits::Unsolved;
use crate::number::lanes::Lanes;
use crate::stepping::batch::LaneBatch;
use crate::stepping::contact_lane::Moment;
use crate::stepping::grid::round_off;
use crate::stepping::instant::{Instant, column, watched};
use crate::stepping::lone_steps::LoneSteps;
use crate::stepping::place::Place;
use crate::stepping::queue::RunQueue;

/// A row closer to the start of its step than this share of the step has the state there.
const SLIVER: f64 = 1.0 / (1u64 << 44) as f64;

/// The rows inside the last step, and the steps that lead to them.
#[derive(Default)]
pub(super) struct RowsInside {
    /// The equations and the method, once there was a row; runs with unilateral contact have their own.
    steps: Option<Box<LoneSteps>>,
    /// The rows, until it is known how far the run gets in this step.
    rows: Vec<Instant>,
}

impl RowsInside {
    /// Computes the instants that were asked for before the end of the step that the run in lane 0 takes from the time
    /// `tau` of its segment and the state `y`.
    #[cold]
    #[inline(never)]
    pub(super) fn look_inside<'a, R: Lanes, Q: RunQueue<'a>>(
        &mut self,
        batch: &mut LaneBatch<'a, R, Place, Q>,
        clock: u64,
        system: &SceneEquations<R>,
        (tau, y): (R, &States<R>),
    ) -> Result<(), Unsolved> {
        let (tau, y) = (tau.lane(0), column(y, 0));
        let Some(run) = &mut batch.runs[0] else { return Ok(()) };
        let (start, end) = (run.place.now(clock).0, run.place.now(clock + 1).0);
        if let Some(steps) = &mut self.steps {
            steps.method.forget_start();
        }
        loop {
            let time = batch.queue.next_time();
            if time >= end {
                return Ok(());
            }
            batch.queue.is_due(time, true);
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
                let how = (batch.instructions, batch.options);
                let new = || Box::new(LoneSteps::new(how.0, how.1, &run.scene));
                let steps = self.steps.get_or_insert_with(new);
                let LoneSteps { system: alone, method } = &mut **steps;
                let next = if length > 0.0 { method.step(alone, &drive, (tau, &y), length)? } else { y };
                let now = alone.evaluate(&drive, tau + length, &next);
                batch.stats.evaluations += 1 + steps.take_stats().evaluations;
                watched(system.size(), (0, None), &now, &next, time, (time, 0))
            };
            // After an overflow the run ends at this step.
            if row.is_finite() {
                self.rows.push(Instant { t: time, grid: (time, 0), ..row });
            }
        }
    }

    /// The rows inside the last step, which the run has followed until the time `until`. No rows are left.
    pub(super) fn take_until(&mut self, until: f64) -> impl Iterator<Item = Instant> + use<> {
        std::mem::take(&mut self.rows).into_iter().take_while(move |row| row.t < until)
    }

    #[inline(always)]
    pub(super) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
}
