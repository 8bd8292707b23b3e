//! The loop of adaptive steps, which are as long as the error allows, for one run in each lane. Every lane
//! has a step of its own, which is accepted or rejected alone. A single run is one lane. Steps end on each
//! breakpoint, where a new segment begins with a cautious first step.

use crate::error::Error;
use crate::formulation::equations::{Evaluation, MAX_COMPONENTS};
use crate::formulation::system::System;
use crate::method::step_control::StepControl;
use crate::method::traits::{Adaptive, Step, largest};
use crate::number::lanes::{Bits, Lanes, each};
use crate::number::simd::level::Instructions;
use crate::stepping::adaptive_contacts::AdaptiveEvents;
use crate::stepping::adaptive_lanes::{AdaptiveLanes, Enter, Here, Places, merged};
use crate::stepping::batch::LaneBatch;
use crate::stepping::ending::{interruption, too_many, too_small};
use crate::stepping::inside_step::LookInside;
use crate::stepping::instant::watched;
use crate::stepping::options::Options;
use crate::stepping::queue::{Builder, POLL, RunQueue};
use crate::stepping::sizes::{Sizes, is_unresolved, next_length};
use crate::stepping::status::Status;

/// The adaptive loop before it runs.
pub struct AdaptiveSteps<'a, Q, E> {
    /// Instructions to use.
    pub instructions: Instructions,
    /// The options of every run.
    pub options: &'a Options,
    /// Largest error of a step, as a share of each state's magnitude.
    pub tolerance: f64,
    /// The source and the destination of the runs.
    pub queue: Q,
    /// Makes the equations and the method for the runs in all lanes.
    pub builder: E,
}

impl<'a, Q: RunQueue<'a>, E> AdaptiveSteps<'a, Q, E> {
    /// Computes all runs of the queue, and returns the queue.
    #[inline(always)]
    #[allow(clippy::too_many_lines)] // one step, from one attempt to the next
    pub fn run<R: Lanes, S: System<R>, I: Adaptive<R, S>>(self) -> Result<Q, Error>
    where
        E: Builder<S, I>,
    {
        let Self { instructions, options, tolerance, queue, mut builder } = self;
        let zero = R::zero();
        let mut lanes = AdaptiveLanes {
            batch: LaneBatch::new(instructions, queue, options),
            places: Places::new(),
            control: StepControl::new(I::ERROR_ORDER, I::MIN_GROWTH),
            unsolved: None,
            saved: 0,
            left: 0,
            entering: 0,
            events: AdaptiveEvents::new(),
        };
        let mut here =
            Here { y: [zero; MAX_COMPONENTS], now: Evaluation::nothing(), sizes: Sizes::new(tolerance) };
        for lane in 0..R::WIDTH {
            lanes.load(lane, &mut here)?;
        }
        let (mut system, mut method) = lanes.batch.build(&mut builder, &mut here.y);
        lanes.size(&system, R::ALL, &mut here);
        let (mut next, mut there, mut corrected) = ([zero; MAX_COMPONENTS], Evaluation::nothing(), None);
        let mut attempts = 0u64;
        #[allow(clippy::cast_precision_loss)] // so many attempts would take centuries
        let most = R::constant(options.max_steps as f64);
        let (one, size) = (R::constant(1.0), system.size());

        loop {
            // Here lanes leave the vector code: runs that have ended make room for others, and segments
            // begin.
            while lanes.left | lanes.entering != 0 {
                let left = std::mem::take(&mut lanes.left);
                for lane in each(left) {
                    lanes.load(lane, &mut here)?;
                }
                if left != 0 && lanes.batch.active != 0 {
                    lanes.batch.renew(&mut builder, (&mut system, &mut method), left, &mut here.y);
                    lanes.size(&system, left, &mut here);
                }
                if lanes.entering != 0 {
                    method.restart();
                    R::call(instructions, Enter(&mut lanes, &system, &mut here));
                }
            }
            if lanes.batch.active == 0 {
                return Ok(lanes.batch.queue);
            }

            let Places { from, to, length, t, tau, .. } = lanes.places;
            let rest = length - tau;
            let h = R::select(lanes.events.located, lanes.places.h, next_length(lanes.places.h, rest));
            let unresolved = h.less(rest) & is_unresolved(h, t, length) & !lanes.events.located;
            let spent = most.at_most(lanes.places.attempts);
            attempts += 1;
            let stops = attempts.is_multiple_of(POLL) && lanes.batch.queue.stops();
            let ending = if stops { R::ALL } else { unresolved | spent } & lanes.batch.active;
            if ending != 0 {
                for lane in each(ending) {
                    let (t, h) = (t.lane(lane), h.lane(lane));
                    let end = if stops {
                        interruption(t)
                    } else if unresolved >> lane & 1 != 0 {
                        too_small(t, h, lanes.attempt(lane))
                    } else {
                        too_many(t, h, options.max_steps)
                    };
                    lanes.stop(&system, lane, &here, Some(end));
                }
                // The other lanes repeat their attempt, with the next run beside them.
                continue;
            }
            lanes.places.attempts = lanes.places.attempts + one;

            let allowed = Some(&here.sizes.allowed);
            let step = Step { tau, h, y: &here.y, rate: &here.now.rate, allowed };
            let (drive, stats) = (&lanes.batch.drive, &mut lanes.batch.stats);
            let attempted = method.step(&system, drive, &step, &mut next, stats);
            lanes.unsolved = attempted.err().map(Into::into);
            if lanes.unsolved.is_some() {
                lanes.events.located = 0;
                lanes.places.h = lanes.control.unsolved() * h;
                stats.rejected += 1;
                continue;
            }
            let mut errors = method.error(&system, drive, &step, lanes.control.retries(), stats);
            // The correction that puts a step back on the constraints is an error of the step, too.
            let mut arrived = &next;
            if system.corrects() {
                let end = corrected.insert(next);
                system.correct(drive, tau + h, end);
                let mut correction = [zero; MAX_COMPONENTS];
                size.each(|n| correction[n] = end[n] - next[n]);
                let shift = largest(size, &correction, &here.sizes.allowed.weights);
                errors = R::select(errors.less(shift) | !shift.at_most(shift), shift, errors);
                arrived = end;
            }
            let (accepted, factor) = lanes.control.judge(errors);
            let mut accepted = accepted & lanes.batch.active;
            (lanes.places.errors, lanes.places.h) = (errors, factor * h);
            stats.rejected += u64::from((lanes.batch.active & !accepted).count_ones());
            lanes.events.reached |= lanes.events.located & accepted;
            lanes.events.located = 0;
            if accepted == 0 {
                continue;
            }
            system.evaluate_into(drive, tau + h, arrived, &mut there);
            stats.evaluations += 1;
            if lanes.batch.unilateral {
                let due = lanes.batch.due(&there) & accepted & !lanes.events.reached;
                if due != 0 {
                    let retakes = lanes.find_events(&system, due, &here, (h, arrived));
                    accepted &= !retakes;
                    if accepted == 0 {
                        continue;
                    }
                }
                lanes.events.settle(accepted);
            }
            method.accepted(h);
            lanes.places.steps = R::select(accepted, lanes.places.steps + one, lanes.places.steps);
            let arrives = h.at_most(rest) & rest.at_most(h);
            let ends = R::select(arrives, to, from + (tau + h));

            // Dense output gives the instants inside the step: those to record, and those at which a tip
            // seems to violate a limit and to come back.
            let turning_times =
                lanes.violating_turning_points(&here.now.motion, &there.motion, (accepted, h));
            let asked = R::constant(lanes.batch.queue.next_time()).less(ends);
            if each(accepted).any(|lane| asked >> lane & 1 != 0 || turning_times[lane].is_finite()) {
                let (lanes, system, method) = (&mut lanes, &system, &mut method);
                let (here, step, next) = (&here, &step, &next);
                let look =
                    LookInside { lanes, system, method, here, step, next, accepted, ends, turning_times };
                accepted = R::call(instructions, look);
            }

            here.sizes.note(size, arrived, accepted, 0);
            lanes.places.t = R::select(accepted, ends, t);
            lanes.places.tau = R::select(accepted, tau + h, tau);
            // A breakpoint is watched under the inputs of the next segment. By then `here` has another state,
            // so that the last watched instant must be saved.
            let at_end = accepted & to.at_most(ends);
            lanes.entering = at_end & !lanes.places.last | lanes.events.reached & accepted;
            for lane in each(lanes.entering) {
                let last = lanes.last(&system, lane, &here);
                lanes.save(lane, last);
            }
            let watching = accepted & !lanes.entering;
            let seen = lanes.batch.watch(&system, &there, arrived, ends, watching);
            for lane in each(watching & !seen.sound) {
                lanes.stop(&system, lane, &here, None);
            }
            let sound = watching & seen.sound;
            lanes.places.watched = R::select(sound, ends, lanes.places.watched);
            lanes.saved &= !sound;
            let due = sound & 1 != 0 && lanes.batch.queue.is_due(ends.lane(0), false);
            for lane in each(sound & (seen.ended | at_end | Bits::from(due))) {
                let t = ends.lane(lane);
                let contact = lanes.batch.contact_row(lane);
                let instant = watched(size, (lane, contact), &there, arrived, t, (t, 0));
                if lanes.goes_on(&system, lane, due, &seen, &instant) && at_end >> lane & 1 != 0 {
                    lanes.retire(&system, lane, (Status::Completed, String::new()), &instant);
                }
            }
            here.now = merged(watching, &there, &here.now);
            size.each(|n| here.y[n] = R::select(accepted, arrived[n], here.y[n]));
        }
    }
}
