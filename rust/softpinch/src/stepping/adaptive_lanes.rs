//! The lanes of the adaptive loop: the places of their runs, and the rare work at starts of segments, at
//! instants inside a step, and at ends of runs.
//!
//! The instants inside a step are those to record, and those at which a tip seems to violate a limit and to come back.
//! Dense output gives their states.

use crate::error::Result;
use crate::formulation::{Evaluation, SceneEquations, States, System};
use crate::method::{AnyAdaptiveMethod, Step, StepControl, Unsolved};
use crate::model::{Coordinates, Motion, Scene};
use crate::number::{Bits, LaneTask, Lanes, MOST, Real, each, task};
use crate::stepping::monitor::ViolatingTurningPoint;
use crate::stepping::{End, Event, Instant, LaneBatch, Phase, Seen, Sizes, Span, full, overflow};

/// The places of the runs in time. In a lane without a run all numbers are zero.
pub struct Progress<R> {
    /// Start, end and length of the segments between breakpoints.
    pub from: R,
    pub to: R,
    pub length: R,
    /// The times, the times since the starts of the segments, and the times of the last watched instants.
    pub t: R,
    pub tau: R,
    pub watched: R,
    pub h: R,
    pub steps: R,
    pub attempts: R,
    /// Errors of the last attempts, in units of the allowed error; negative before the first attempt of a segment.
    pub errors: R,
    pub last: Bits,
}

impl<R: Lanes> Progress<R> {
    #[inline(always)]
    pub fn new() -> Self {
        let [from, to, length, t, tau, watched, h, steps, attempts, errors] = [R::zero(); 10];
        Self { from, to, length, t, tau, watched, h, steps, attempts, errors, last: 0 }
    }

    /// Puts a lane at the start of a run, as if a segment without length ended there; at zero if it has no run.
    pub fn begin(&mut self, lane: usize, start: f64) {
        for number in [&mut self.h, &mut self.steps, &mut self.attempts] {
            number.set(lane, 0.0);
        }
        self.watched.set(lane, start);
        self.enter(lane, (start, start), false);
    }

    pub fn enter(&mut self, lane: usize, (from, to): (f64, f64), last: bool) {
        self.from.set(lane, from);
        self.to.set(lane, to);
        self.length.set(lane, to - from);
        self.t.set(lane, from);
        self.tau.set(lane, 0.0);
        self.errors.set(lane, -1.0);
        self.last = self.last & !(1 << lane) | Bits::from(last) << lane;
    }
}

pub struct AdaptiveLanes<'a, R> {
    pub batch: LaneBatch<'a, R, Span>,
    pub progress: Progress<R>,
    pub control: StepControl<R>,
    /// Why the equations of the last attempt were not solved, if so. Methods that solve equations have one lane.
    pub unsolved: Option<Unsolved>,
    /// Lanes whose last watched instant is saved in their run.
    pub saved: Bits,
    /// In unilateral contact: the event at which the next step ends or the last one has ended, with the length of the step
    /// in which it was found; and the number of steps in a row that ended at an event.
    pub events: [Option<(Event, f64)>; MOST],
    pub events_in_a_row: [usize; MOST],
}

/// The states from which the steps of all lanes start, and the equations of the steps.
pub struct StepStart<R> {
    pub system: SceneEquations<R>,
    pub y: States<R>,
    pub now: Evaluation<R>,
    pub sizes: Sizes<R>,
}

impl<R: Lanes> AdaptiveLanes<'_, R> {
    /// Loads the next run into a lane, and puts it at the start of its first segment. Returns whether there is one.
    pub fn load(&mut self, lane: usize) -> Result<bool> {
        let place = |_, scene: &Scene| Span::new(&scene.inputs, &scene.initial, scene.duration);
        let loaded = self.batch.load_lane(lane, place)?;
        let from = self.batch.runs[lane].as_ref().map_or(0.0, |run| run.place.start);
        self.progress.begin(lane, from);
        self.events_in_a_row[lane] = 0;
        // A controller that measures at the start of the run needs the inputs before that.
        if self.batch.runs[lane].as_ref().is_some_and(|run| run.controller.is_some()) {
            self.batch.enter_segment(lane, from, None);
        }
        self.saved |= Bits::from(loaded) << lane;
        Ok(loaded)
    }

    /// The lanes at the start of a segment, or at an event, from which they go on as from such a start.
    #[inline(always)]
    pub fn entering(&self) -> Bits {
        self.batch.phases.at(Phase::Start) | self.batch.phases.at(Phase::Event)
    }

    /// Sets the typical magnitudes of the states in the lanes of `changed`, which have new runs.
    #[inline(always)]
    pub fn size(&self, changed: Bits, start: &mut StepStart<R>) {
        let usual = start.system.begin(&self.batch.gathered(Motion::typical_magnitudes));
        let slow = start.system.begin(&self.batch.gathered(Motion::slow_magnitudes));
        start.sizes.begin(changed, &usual, &slow);
    }

    pub fn retire(&mut self, start: &StepStart<R>, lane: usize, end: End, last: &Instant) {
        let steps = self.progress.steps.lane(lane) as u64; // a whole number
        self.batch.retire_lane(&start.system, lane, end, last, steps);
    }

    pub fn last(&self, lane: usize, start: &StepStart<R>) -> Option<Instant> {
        if self.saved >> lane & 1 != 0 {
            return self.batch.runs[lane].as_ref()?.saved_instant;
        }
        let t = self.progress.watched.lane(lane);
        Some(self.batch.instant(lane, start.system.size(), (&start.now, &start.y), t, (t, 0)))
    }

    pub fn save(&mut self, lane: usize, last: Option<Instant>) {
        self.saved |= 1 << lane;
        if let Some(run) = &mut self.batch.runs[lane] {
            run.saved_instant = last;
        }
    }

    /// Ends the run in a lane at the last watched instant. An `end` of `None` means that a number overflowed.
    #[cold]
    #[inline(never)]
    pub fn stop(&mut self, lane: usize, start: &StepStart<R>, end: Option<End>) {
        let Some(last) = self.last(lane, start) else { return };
        let end = end.unwrap_or_else(|| overflow(last.t));
        self.retire(start, lane, end, &last);
    }

    /// Records an instant that was just watched, if it is `due`. Ends the run there if a violation or a lack
    /// of memory requires it. Returns whether the run goes on.
    #[inline(always)]
    pub fn goes_on(
        &mut self,
        start: &StepStart<R>,
        lane: usize,
        due: bool,
        seen: &Seen,
        instant: &Instant,
    ) -> bool {
        let recorded = if due { self.batch.record(&start.system, instant) } else { Ok(()) };
        let end = match recorded {
            Err(error) => Some(full(instant.t, &error)),
            Ok(()) if seen.ended >> lane & 1 != 0 => self.batch.violation(lane, seen, instant),
            Ok(()) => None,
        };
        let Some(end) = end else { return true };
        self.retire(start, lane, end, instant);
        false
    }

    /// The time inside each lane's step at which a tip seems to violate a limit and to come back; infinity if none.
    #[inline(always)]
    pub fn violating_turning_points(
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
            if let Some(x) = f64::outlined(task) {
                turning_times[lane] = from + x.mul_add(taken, tau);
            }
        }
        turning_times
    }
}

/// The evaluation `a` in the lanes of `bits`, `b` in all other lanes, but for what only monitors need.
#[inline(always)]
pub fn merged<R: Lanes>(bits: Bits, a: &Evaluation<R>, b: &Evaluation<R>) -> Evaluation<R> {
    fn each<R: Lanes, const N: usize>(bits: Bits, a: &[R; N], b: &[R; N]) -> [R; N] {
        std::array::from_fn(|n| R::select(bits, a[n], b[n]))
    }
    Evaluation {
        rate: each(bits, &a.rate, &b.rate),
        motion: Motion {
            q: Coordinates::select(bits, &a.motion.q, &b.motion.q),
            p: Coordinates::select(bits, &a.motion.p, &b.motion.p),
            memory: each(bits, &a.motion.memory, &b.motion.memory),
            relaxation: each(bits, &a.motion.relaxation, &b.motion.relaxation),
        },
        multipliers: each(bits, &a.multipliers, &b.multipliers),
        residuals: each(bits, &a.residuals, &b.residuals),
        torque: each(bits, &a.torque, &b.torque),
        ..*b
    }
}

task! {
    /// In the lanes of `accepted`, looks at the instants inside the step (its start since that of the segment, and its length)
    /// that are to be recorded, and at those of `turning_times`. `next` has the states at the end of the method's step, before
    /// any correction; the steps end at `ends`. Returns the lanes whose runs go on. This is rare, so the code is called.
    pub ['b, 'a, R: Lanes]
    LookInside<'b, 'a, R>(lanes: &'b mut AdaptiveLanes<'a, R>, method: &'b mut AnyAdaptiveMethod<R>, start: &'b StepStart<R>,
        step: (R, R), next: &'b States<R>, accepted: Bits, ends: R, turning_times: [f64; MOST])
    for R => Bits = {
        let (mut accepted, mut turning_times) = (accepted, turning_times);
        let (system, y, (tau, h), drive) = (&start.system, &start.y, step, &lanes.batch.drive);
        let size = system.size();
        let allowed = Some(&start.sizes.allowed);
        let step = Step { system, drive, tau, h, y, rate: &start.now.rate, allowed };
        method.prepare(&step, next, &mut lanes.batch.stats);
        loop {
            let mut inside: Bits = 0;
            let (from, mut time, mut share) = (lanes.progress.from, lanes.progress.from, R::zero());
            for lane in each(accepted) {
                let (tau, taken, from) = (tau.lane(lane), h.lane(lane), from.lane(lane));
                let asked = lanes.batch.next_time();
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
                    lanes.stop(lane, start, None);
                } else {
                    let instant = lanes.batch.instant(lane, size, (&then, &between), t, (t, 0));
                    lanes.save(lane, Some(instant));
                    let due = lanes.batch.is_due(t, true);
                    lanes.goes_on(start, lane, due, &seen, &instant);
                }
            }
            accepted &= !lanes.batch.phases.at(Phase::Ended);
        }
    }
}
