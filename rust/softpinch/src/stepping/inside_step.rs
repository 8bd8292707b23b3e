//! Instants inside an adaptive step: those to record, and those at which a tip seems to violate a limit and to
//! come back. Dense output gives their states.

use crate::formulation::equations::States;
use crate::formulation::scene_equations::SceneEquations;
use crate::formulation::system::System;
use crate::method::called::AnyAdaptiveMethod;
use crate::method::traits::Step;
use crate::model::motion::Motion;
use crate::number::lanes::{Bits, LaneTask, Lanes, MOST, each};
use crate::stepping::adaptive_lanes::{AdaptiveLanes, StepStart};
use crate::stepping::instant::watched;
use crate::stepping::monitor::ViolatingTurningPoint;
use crate::stepping::phase::Phase;
use crate::stepping::queue::RunQueue;

impl<'a, R: Lanes, Q: RunQueue<'a>> AdaptiveLanes<'a, R, Q> {
    /// For each lane, the time inside the step at which a tip seems to violate a limit and to come back;
    /// infinity if there is none.
    #[inline(always)]
    pub(super) fn violating_turning_points(
        &self,
        before: &Motion<R>,
        after: &Motion<R>,
        (accepted, h): (Bits, R),
    ) -> [f64; MOST] {
        let mut turning_times = [f64::INFINITY; MOST];
        for lane in each(self.batch.limits.turning_points(before, after) & accepted) {
            let Some(run) = &self.batch.runs[lane] else { continue };
            let (taken, from, tau) =
                (h.lane(lane), self.progress.from.lane(lane), self.progress.tau.lane(lane));
            let (ends, parameters) = ([&before.lane(lane), &after.lane(lane)], &run.scene.parameters);
            let task = ViolatingTurningPoint { parameters, ends, h: taken };
            if let Some(x) = f64::call(self.batch.instructions, task) {
                turning_times[lane] = from + x.mul_add(taken, tau);
            }
        }
        turning_times
    }
}

/// In the lanes of `accepted`, looks at the instants inside the step that are to be recorded, and at those of
/// `turning_times`. Returns the lanes whose runs go on. This is rare, so the code is called, not inlined.
pub(super) struct LookInside<'b, 'a, R: Lanes, Q> {
    pub(super) lanes: &'b mut AdaptiveLanes<'a, R, Q>,
    pub(super) system: &'b SceneEquations<R>,
    pub(super) method: &'b mut AnyAdaptiveMethod<R>,
    pub(super) start: &'b StepStart<R>,
    /// The time of the step's start since that of the segment, and the length of the step.
    pub(super) step: (R, R),
    /// The states at the end of the method's step, before any correction.
    pub(super) next: &'b States<R>,
    pub(super) accepted: Bits,
    /// The times at which the steps end.
    pub(super) ends: R,
    pub(super) turning_times: [f64; MOST],
}

impl<'a, R: Lanes, Q: RunQueue<'a>> LaneTask<R> for LookInside<'_, 'a, R, Q> {
    type Output = Bits;

    #[inline(always)]
    fn run(self) -> Bits {
        let Self { lanes, system, method, start, step, next, mut accepted, ends, mut turning_times } = self;
        let size = system.size();
        let ((tau, h), y, drive) = (step, &start.y, &lanes.batch.drive);
        let allowed = Some(&start.sizes.allowed);
        let step = Step { system, drive, tau, h, y, rate: &start.now.rate, allowed };
        method.prepare(&step, next, &mut lanes.batch.stats);
        loop {
            let mut inside: Bits = 0;
            let (from, mut time, mut share) = (lanes.progress.from, lanes.progress.from, R::zero());
            for lane in each(accepted) {
                let (tau, taken, from) = (tau.lane(lane), h.lane(lane), from.lane(lane));
                let asked = lanes.batch.queue.next_time();
                let asked = if asked < ends.lane(lane) { asked } else { f64::INFINITY };
                let at = turning_times[lane].min(asked);
                if at.is_finite() {
                    time.set(lane, at);
                    share.set(lane, (((at - from) - tau) / taken).clamp(0.0, 1.0));
                    inside |= 1 << lane;
                }
            }
            if inside == 0 {
                return accepted;
            }
            let since = time - from;
            let mut between = method.interpolate(y, next, share);
            system.correct(&lanes.batch.drive, since, &mut between);
            let then = system.evaluate(&lanes.batch.drive, since, &between);
            lanes.batch.stats.evaluations += 1;
            let seen = lanes.batch.watch(system, &then, &between, time, inside);
            for lane in each(inside) {
                let t = time.lane(lane);
                if turning_times[lane] <= t {
                    turning_times[lane] = f64::INFINITY;
                }
                if seen.finite >> lane & 1 == 0 {
                    lanes.stop(system, lane, start, None);
                } else {
                    let contact = lanes.batch.contact_row(lane);
                    let instant = watched(size, (lane, contact), &then, &between, t, (t, 0));
                    lanes.save(lane, Some(instant));
                    let due = lanes.batch.queue.is_due(t, true);
                    lanes.goes_on(system, lane, due, &seen, &instant);
                }
            }
            accepted &= !lanes.batch.phases.at(Phase::Ended);
        }
    }
}
