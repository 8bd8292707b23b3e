//! The loop of adaptive steps, which are as long as the error allows, for one run in each lane. Every lane
//! has a step of its own, which is accepted or rejected alone. A single run is one lane. Steps end on each
//! breakpoint, where a new segment begins with a cautious first step.

use crate::error::Result;
use crate::formulation::{Evaluation, MAX_COMPONENTS, SceneEquations, System};
use crate::method::{AnyAdaptiveMethod, Runs, Step, StepControl, largest};
use crate::number::{Bits, LaneTask, Lanes, MOST, each};
use crate::stepping::adaptive_events::Enter;
use crate::stepping::adaptive_lanes::{LookInside, Progress};
use crate::stepping::ending::{too_many, too_small};
use crate::stepping::sizes::{is_unresolved, next_length};
use crate::stepping::{
    AdaptiveLanes, LaneBatch, POLL, Phase, RunLoop, Sizes, StepStart, completed, interruption, merged,
};

pub struct AdaptiveSteps<'a, B> {
    pub runs: RunLoop<'a>,
    pub tolerance: f64,
    pub build: B,
}

impl<R, B> LaneTask<R> for AdaptiveSteps<'_, B>
where
    R: Lanes,
    B: FnOnce(Runs<'_>) -> (SceneEquations<R>, AnyAdaptiveMethod<R>),
{
    type Output = Result;

    #[inline(always)]
    fn run(self) -> Result {
        let Self { runs, tolerance, build } = self;
        let options = runs.options;
        let entry = options.method.entry();
        let zero = R::zero();
        let mut lanes = AdaptiveLanes {
            batch: LaneBatch::new(runs),
            progress: Progress::new(),
            control: StepControl::new(entry.error_order, entry.min_growth),
            unsolved: None,
            saved: 0,
            events: [None; MOST],
            events_in_a_row: [0; MOST],
        };
        for lane in 0..R::WIDTH {
            lanes.load(lane)?;
        }
        let mut y = [zero; MAX_COMPONENTS];
        let (system, mut method) = lanes.batch.build(build, &mut y);
        let mut start = StepStart { system, y, now: Evaluation::nothing(), sizes: Sizes::new(tolerance) };
        lanes.size(R::ALL, &mut start);
        let (mut next, mut end_state, mut corrected) = ([zero; MAX_COMPONENTS], Evaluation::nothing(), None);
        let mut attempts = 0u64;
        let most = R::constant(options.max_steps as f64);
        let (one, size) = (R::constant(1.0), start.system.size());

        loop {
            // Here lanes leave the vector code: runs that have ended make room for others, and segments begin.
            while lanes.batch.phases.at(Phase::Ended) | lanes.entering() != 0 {
                let ended = lanes.batch.phases.at(Phase::Ended);
                for lane in each(ended) {
                    if !lanes.load(lane)? {
                        start.now.rate.iter_mut().for_each(|rate| rate.set(lane, 0.0));
                    }
                }
                if ended != 0 && lanes.batch.active() != 0 {
                    lanes.batch.renew((&mut start.system, &mut *method), ended, &mut start.y);
                    lanes.size(ended, &mut start);
                }
                if lanes.entering() != 0 {
                    method.restart();
                    R::outlined(Enter { lanes: &mut lanes, start: &mut start });
                }
            }
            if lanes.batch.active() == 0 {
                return Ok(());
            }

            let Progress { from, to, length, t, tau, .. } = lanes.progress;
            let rest = length - tau;
            let approaching = lanes.batch.phases.at(Phase::Approach);
            let h = R::select(approaching, lanes.progress.h, next_length(lanes.progress.h, rest));
            let unresolved = h.less(rest) & is_unresolved(h, t, length) & !approaching;
            let spent = most.at_most(lanes.progress.attempts);
            attempts += 1;
            let stops = attempts.is_multiple_of(POLL) && (lanes.batch.queue.stops)();
            let ending = if stops { R::ALL } else { unresolved | spent } & lanes.batch.active();
            if ending != 0 {
                for lane in each(ending) {
                    let (t, h) = (t.lane(lane), h.lane(lane));
                    let end = if stops {
                        interruption(t)
                    } else if unresolved >> lane & 1 != 0 {
                        too_small(t, h, (lanes.unsolved, lanes.progress.errors.lane(lane)))
                    } else {
                        too_many(t, h, options.max_steps)
                    };
                    lanes.stop(lane, &start, Some(end));
                }
                // The other lanes repeat their attempt, with the next run beside them.
                continue;
            }
            lanes.progress.attempts = lanes.progress.attempts + one;

            let active = lanes.batch.active();
            let allowed = Some(&start.sizes.allowed);
            let (drive, stats) = (&lanes.batch.drive, &mut lanes.batch.stats);
            let system = &start.system;
            let step = Step { system, drive, tau, h, y: &start.y, rate: &start.now.rate, allowed };
            let attempted = method.step(&step, &mut next, stats);
            lanes.unsolved = attempted.err();
            if lanes.unsolved.is_some() {
                lanes.batch.phases.set(approaching, Phase::Step);
                lanes.progress.h = lanes.control.unsolved() * h;
                stats.rejected += 1;
                continue;
            }
            let mut errors = method.error(&step, lanes.control.rejected, stats);
            // The correction that puts a step back on the constraints is an error of the step, too.
            let mut arrived = &next;
            if system.corrects {
                let end = corrected.insert(next);
                system.correct(drive, tau + h, end);
                let mut correction = [zero; MAX_COMPONENTS];
                size.each(|n| correction[n] = end[n] - next[n]);
                let shift = largest(size, &correction, &start.sizes.allowed.weights);
                errors = R::select(errors.less(shift) | !shift.at_most(shift), shift, errors);
                arrived = end;
            }
            let (accepted, factor) = lanes.control.judge(errors);
            let mut accepted = accepted & active;
            (lanes.progress.errors, lanes.progress.h) = (errors, factor * h);
            stats.rejected += u64::from((active & !accepted).count_ones());
            if approaching != 0 {
                lanes.batch.phases.set(approaching & accepted, Phase::Event);
                lanes.batch.phases.set(approaching & !accepted, Phase::Step);
            }
            if accepted == 0 {
                continue;
            }
            system.evaluate_into(drive, tau + h, arrived, &mut end_state);
            stats.evaluations += 1;
            if lanes.batch.unilateral {
                let due = lanes.batch.due(&end_state, accepted & !lanes.batch.phases.at(Phase::Event));
                if due != 0 {
                    let retakes = lanes.find_events(due, &start, (h, arrived));
                    accepted &= !retakes;
                    if accepted == 0 {
                        continue;
                    }
                }
                for lane in each(accepted & !lanes.batch.phases.at(Phase::Event)) {
                    lanes.events_in_a_row[lane] = 0;
                }
            }
            method.accepted(h);
            lanes.progress.steps = R::select(accepted, lanes.progress.steps + one, lanes.progress.steps);
            let arrives = h.at_most(rest) & rest.at_most(h);
            let ends = R::select(arrives, to, from + (tau + h));

            // Dense output gives the instants inside the step: those to record, and those at which a tip
            // seems to violate a limit and to come back.
            let turning_times =
                lanes.violating_turning_points(&start.now.motion, &end_state.motion, (accepted, h));
            let asked = R::constant(lanes.batch.next_time()).less(ends);
            if each(accepted).any(|lane| asked >> lane & 1 != 0 || turning_times[lane].is_finite()) {
                let (lanes, method, start, step, next) = (&mut lanes, &mut method, &start, (tau, h), &next);
                let look = LookInside { lanes, method, start, step, next, accepted, ends, turning_times };
                accepted = R::outlined(look);
            }

            start.sizes.note(size, arrived, accepted, 0);
            lanes.progress.t = R::select(accepted, ends, t);
            lanes.progress.tau = R::select(accepted, tau + h, tau);
            // A breakpoint is watched under the inputs of the next segment. By then `start` has another state,
            // so that the last watched instant must be saved.
            let at_end = accepted & to.at_most(ends);
            let at_event = lanes.batch.phases.at(Phase::Event);
            let begins = at_end & !(lanes.progress.last | at_event);
            if begins != 0 {
                lanes.batch.phases.set(begins, Phase::Start);
            }
            let entering = begins | at_event;
            for lane in each(entering) {
                let last = lanes.last(lane, &start);
                lanes.save(lane, last);
            }
            let watching = accepted & !entering;
            let seen = lanes.batch.watch(system, &end_state, arrived, ends, watching);
            for lane in each(watching & !seen.finite) {
                lanes.stop(lane, &start, None);
            }
            let finite = watching & seen.finite;
            lanes.progress.watched = R::select(finite, ends, lanes.progress.watched);
            lanes.saved &= !finite;
            let due = finite & 1 != 0 && lanes.batch.is_due(ends.lane(0), false);
            for lane in each(finite & (seen.ended | at_end | Bits::from(due))) {
                let t = ends.lane(lane);
                let instant = lanes.batch.instant(lane, size, (&end_state, arrived), t, (t, 0));
                if lanes.goes_on(&start, lane, due, &seen, &instant) && at_end >> lane & 1 != 0 {
                    lanes.retire(&start, lane, completed(), &instant);
                }
            }
            start.now = merged(watching, &end_state, &start.now);
            size.each(|n| start.y[n] = R::select(accepted, arrived[n], start.y[n]));
        }
    }
}
