//! The lanes of the adaptive loop: where their runs are, and what is rare: starts of stretches, looks inside a step, ends.

use crate::error::Error;
use crate::formulation::equations::{Evaluation, States};
use crate::formulation::system::System;
use crate::method::step_control::StepControl;
use crate::method::traits::{Adaptive, Step, Unsolved};
use crate::model::motion::Motion;
use crate::model::scene::Scene;
use crate::number::lanes::{Bits, LaneTask, Lanes, MOST, each};
use crate::stepping::batch::{LaneBatch, Seen};
use crate::stepping::ending::{Attempt, End, full, overflow};
use crate::stepping::grid::Span;
use crate::stepping::instant::{column, watched};
use crate::stepping::monitor::{turn_between, turning};
use crate::stepping::queue::{RunQueue, Watched};
use crate::stepping::sizes::Sizes;

/// Where the runs are. In a lane without a run all is zero.
pub(super) struct Places<R> {
    /// When the stretches between breakpoints begin and end, and how long these are.
    pub(super) from: R,
    pub(super) to: R,
    pub(super) length: R,
    /// The times, those since the stretches' starts, and those of the last instants that were watched.
    pub(super) t: R,
    pub(super) tau: R,
    pub(super) watched: R,
    /// The lengths of the next attempts.
    pub(super) h: R,
    /// Steps and attempts so far.
    pub(super) steps: R,
    pub(super) attempts: R,
    /// Errors of the last attempts, in allowed errors; negative where the stretch has had none.
    pub(super) errors: R,
    /// Lanes in their last stretch.
    pub(super) last: Bits,
}

impl<R: Lanes> Places<R> {
    /// Without any run.
    #[inline(always)]
    pub(super) fn new() -> Self {
        let zero = R::zero();
        Self {
            from: zero,
            to: zero,
            length: zero,
            t: zero,
            tau: zero,
            watched: zero,
            h: zero,
            steps: zero,
            attempts: zero,
            errors: zero,
            last: 0,
        }
    }

    /// Puts a lane where a run starts, at the end of a stretch without a length; or at zero, where it has none.
    pub(super) fn begin(&mut self, lane: usize, start: f64) {
        for number in [&mut self.h, &mut self.steps, &mut self.attempts] {
            number.set(lane, 0.0);
        }
        self.watched.set(lane, start);
        self.enter(lane, (start, start), false);
    }

    /// Puts a lane at the start of a stretch.
    pub(super) fn enter(&mut self, lane: usize, (from, to): (f64, f64), last: bool) {
        self.from.set(lane, from);
        self.to.set(lane, to);
        self.length.set(lane, to - from);
        self.t.set(lane, from);
        self.tau.set(lane, 0.0);
        self.errors.set(lane, -1.0);
        self.last = self.last & !(1 << lane) | Bits::from(last) << lane;
    }
}

/// The loop's lanes.
pub(super) struct AdaptiveLanes<'a, R: Lanes, Q> {
    pub(super) batch: LaneBatch<'a, R, Span, Q>,
    pub(super) places: Places<R>,
    pub(super) control: StepControl<R>,
    /// Why the equations of the last attempt were not solved, if so: methods that solve for their stages have one lane.
    pub(super) unsolved: Option<Unsolved>,
    /// Lanes whose last watched instant is the one that their run holds.
    pub(super) held: Bits,
    /// Lanes whose run has just ended, and lanes at the start of a stretch.
    pub(super) left: Bits,
    pub(super) entering: Bits,
}

/// Where the steps of all lanes begin.
pub(super) struct Here<R> {
    pub(super) y: States<R>,
    /// The evaluation of `y`.
    pub(super) now: Evaluation<R>,
    /// The errors that are allowed there.
    pub(super) sizes: Sizes<R>,
}

impl<'a, R: Lanes, Q: RunQueue<'a>> AdaptiveLanes<'a, R, Q> {
    /// Puts the next run into a lane, where there is one; it is at the start of its first stretch.
    pub(super) fn load(&mut self, lane: usize, here: &mut Here<R>) -> Result<(), Error> {
        let place = |scene: &Scene| Span::new(&scene.inputs, &scene.initial, scene.duration);
        let loaded = self.batch.load_lane(lane, place)?;
        let start = self.batch.runs[lane].as_ref().map_or(0.0, |run| run.place.start);
        self.places.begin(lane, start);
        if loaded {
            (self.entering, self.held) = (self.entering | 1 << lane, self.held | 1 << lane);
        } else {
            for rate in &mut here.now.rate {
                rate.set(lane, 0.0);
            }
        }
        Ok(())
    }

    /// Counts the steps that the run in a lane has taken.
    pub(super) fn count(&mut self, lane: usize) {
        let steps = self.places.steps.lane(lane);
        if let Some(run) = &mut self.batch.runs[lane] {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a whole number
            let steps = steps as u64;
            run.steps = steps;
        }
    }

    /// The usual sizes of the states in the lanes of `fresh`, whose runs have changed.
    #[inline(always)]
    pub(super) fn size(&self, system: &impl System<R>, fresh: Bits, here: &mut Here<R>) {
        let usual = system.begin(&self.batch.gathered(Motion::sizes));
        let slow = system.begin(&self.batch.gathered(Motion::slow_sizes));
        here.sizes.begin(fresh, &usual, &slow);
    }

    /// Ends the run in a lane at its last instant.
    pub(super) fn retire(&mut self, system: &impl System<R>, lane: usize, end: End, last: &Watched) {
        self.left |= 1 << lane;
        self.count(lane);
        self.batch.retire_lane(system, lane, end, last);
    }

    /// The last instant of a lane that was watched.
    pub(super) fn last(&self, system: &impl System<R>, lane: usize, here: &Here<R>) -> Option<Watched> {
        if self.held >> lane & 1 != 0 {
            return self.batch.runs[lane].as_ref()?.held;
        }
        let t = self.places.watched.lane(lane);
        Some(watched(system.size(), lane, &here.now, &here.y, t, (t, 0)))
    }

    /// Holds the last instant of a lane that was watched.
    pub(super) fn hold(&mut self, lane: usize, last: Option<Watched>) {
        self.held |= 1 << lane;
        if let Some(run) = &mut self.batch.runs[lane] {
            run.held = last;
        }
    }

    /// What the last attempt of a lane's step came to.
    pub(super) fn attempt(&self, lane: usize) -> Attempt {
        match (self.unsolved, self.places.errors.lane(lane)) {
            (Some(unsolved), _) => Attempt::Unsolved(unsolved),
            (None, error) if error < 0.0 => Attempt::None,
            (None, error) => Attempt::Error(error),
        }
    }

    /// Ends the run in a lane after the last instant that was watched; `None` where a number overflowed.
    #[cold]
    #[inline(never)]
    pub(super) fn stop(&mut self, system: &impl System<R>, lane: usize, here: &Here<R>, end: Option<End>) {
        let Some(last) = self.last(system, lane, here) else { return };
        let end = end.unwrap_or_else(|| overflow(last.instant.t));
        self.retire(system, lane, end, &last);
    }

    /// Records an instant that was just watched, where that is `due`, and ends the run there where a violation or the want of memory
    /// does. Whether the run goes on.
    #[inline(always)]
    pub(super) fn goes_on(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        due: bool,
        seen: &Seen,
        instant: &Watched,
    ) -> bool {
        let recorded = if due { self.batch.record(system, instant) } else { Ok(()) };
        let end = match recorded {
            Err(error) => Some(full(instant.instant.t, &error)),
            Ok(()) if seen.ended >> lane & 1 != 0 => {
                self.count(lane);
                self.batch.violation(lane, seen, &instant.instant)
            }
            Ok(()) => None,
        };
        let goes_on = end.is_none();
        if let Some(end) = end {
            self.retire(system, lane, end, instant);
        }
        goes_on
    }

    /// Begins a stretch in the lanes of `entering`, up to the first step.
    #[inline(always)]
    pub(super) fn enter(&mut self, system: &impl System<R>, here: &mut Here<R>) {
        let size = system.size();
        self.control.restart(self.entering);
        self.unsolved = None;
        for lane in each(self.entering) {
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let from = self.places.to.lane(lane);
            let to = run.place.stretch_end(&run.scene.inputs, from);
            self.places.enter(lane, (from, to), to == run.place.end);
            self.batch.drive.set(lane, &run.scene.inputs.segment(from));
            run.segments += 1;
        }
        let (from, tau) = (self.places.from, self.places.tau);
        let mut now = system.evaluate(&self.batch.drive, tau, &here.y);
        self.batch.stats.evaluations += 1;
        let seen = self.batch.watch(system, &now, &here.y, from, self.entering);
        let (mut stays, mut struck): (Bits, Bits) = (0, 0);
        for lane in each(self.entering) {
            let bit = 1 << lane;
            let t = from.lane(lane);
            if seen.sound & bit == 0 {
                self.stop(system, lane, here, None);
                continue;
            }
            let instant = watched(size, lane, &now, &here.y, t, (t, 0));
            let due = self.batch.queue.is_due(t, false);
            if !self.goes_on(system, lane, due, &seen, &instant) {
                continue;
            }
            let jumps = self.batch.strike(system, lane, (t, tau), &mut here.y);
            self.held &= !bit;
            if jumps {
                self.hold(lane, Some(instant));
            }
            self.places.watched.set(lane, t);
            struck |= Bits::from(jumps) << lane;
            stays |= bit;
        }
        self.entering = 0;
        if stays == 0 {
            return;
        }
        if struck != 0 {
            now = system.evaluate(&self.batch.drive, tau, &here.y);
            self.batch.stats.evaluations += 1;
        }
        here.now = merged(stays, &now, &here.now);
        here.sizes.note(size, &here.y, stays, stays);
        self.batch.stats.evaluations += 1;
        let (equations, states) = ((system, &self.batch.drive), (&here.y, &here.now.rate));
        let h = here.sizes.first_step(equations, &self.control, states, (stays, self.places.length));
        self.places.h = R::select(stays, h, self.places.h);
    }

    /// Where tips seem to be lost and to come back inside a step: when, infinite where none does.
    #[inline(always)]
    pub(super) fn turns(
        &self,
        before: &Motion<R>,
        after: &Motion<R>,
        (accepted, h): (Bits, R),
    ) -> [f64; MOST] {
        let mut turns = [f64::INFINITY; MOST];
        for lane in each(turning(before, after) & accepted) {
            let Some(run) = &self.batch.runs[lane] else { continue };
            let (taken, from, tau) = (h.lane(lane), self.places.from.lane(lane), self.places.tau.lane(lane));
            let (before, after) = (motion(before, lane), motion(after, lane));
            if let Some(x) = turn_between(&run.scene.parameters, &before, &after, taken) {
                turns[lane] = from + x.mul_add(taken, tau);
            }
        }
        turns
    }
}

/// The evaluation of `a` in the lanes whose bits are set, else that of `b`.
#[inline(always)]
pub(super) fn merged<R: Lanes>(bits: Bits, a: &Evaluation<R>, b: &Evaluation<R>) -> Evaluation<R> {
    fn each<R: Lanes, const N: usize>(bits: Bits, a: &[R; N], b: &[R; N]) -> [R; N] {
        std::array::from_fn(|n| R::select(bits, a[n], b[n]))
    }
    Evaluation {
        rate: each(bits, &a.rate, &b.rate),
        motion: Motion {
            q: each(bits, &a.motion.q, &b.motion.q),
            p: each(bits, &a.motion.p, &b.motion.p),
            memory: each(bits, &a.motion.memory, &b.motion.memory),
        },
        multipliers: each(bits, &a.multipliers, &b.multipliers),
        residuals: each(bits, &a.residuals, &b.residuals),
        sin_tilt: each(bits, &a.sin_tilt, &b.sin_tilt),
        torque: each(bits, &a.torque, &b.torque),
    }
}

/// The motion of one lane, as far as monitors ask.
fn motion<R: Lanes>(motion: &Motion<R>, lane: usize) -> Motion<f64> {
    Motion { q: column(&motion.q, lane), p: column(&motion.p, lane), memory: [0.0; 2] }
}

/// Begins stretches; called, not inlined, since it is rare.
pub(super) struct Enter<'b, 'a, R: Lanes, Q, S>(
    pub(super) &'b mut AdaptiveLanes<'a, R, Q>,
    pub(super) &'b S,
    pub(super) &'b mut Here<R>,
);

impl<'a, R: Lanes, Q: RunQueue<'a>, S: System<R>> LaneTask<R> for Enter<'_, 'a, R, Q, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.enter(self.1, self.2);
    }
}

/// Looks at instants inside the step just taken, in the lanes of `accepted`: those that were asked for, and where a tip seems to be
/// lost and to come back (`turns`). Gives the lanes whose runs go on. Called, not inlined, since it is rare.
pub(super) struct LookInside<'b, 'a, R: Lanes, Q, S, I> {
    pub(super) lanes: &'b mut AdaptiveLanes<'a, R, Q>,
    pub(super) system: &'b S,
    pub(super) method: &'b mut I,
    pub(super) here: &'b Here<R>,
    pub(super) step: &'b Step<'b, R>,
    /// The states that the method ends at.
    pub(super) next: &'b States<R>,
    pub(super) accepted: Bits,
    /// When the steps end.
    pub(super) ends: R,
    pub(super) turns: [f64; MOST],
}

impl<'a, R: Lanes, Q: RunQueue<'a>, S: System<R>, I: Adaptive<R, S>> LaneTask<R>
    for LookInside<'_, 'a, R, Q, S, I>
{
    type Output = Bits;

    #[inline(always)]
    fn run(self) -> Bits {
        let Self { lanes, system, method, here, step, next, mut accepted, ends, mut turns } = self;
        let size = system.size();
        method.prepare(system, &lanes.batch.drive, step, next, &mut lanes.batch.stats);
        loop {
            let mut inside: Bits = 0;
            let (from, mut time, mut share) = (lanes.places.from, lanes.places.from, R::zero());
            for lane in each(accepted) {
                let (tau, taken, from) = (step.tau.lane(lane), step.h.lane(lane), from.lane(lane));
                let asked = lanes.batch.queue.next_time();
                let asked = if asked < ends.lane(lane) { asked } else { f64::INFINITY };
                let at = turns[lane].min(asked);
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
            let mut between = method.interpolate(step, next, share);
            system.correct(&lanes.batch.drive, since, &mut between);
            let then = system.evaluate(&lanes.batch.drive, since, &between);
            lanes.batch.stats.evaluations += 1;
            let seen = lanes.batch.watch(system, &then, &between, time, inside);
            for lane in each(inside) {
                let bit = 1 << lane;
                let t = time.lane(lane);
                if turns[lane] <= t {
                    turns[lane] = f64::INFINITY;
                }
                if seen.sound & bit == 0 {
                    lanes.stop(system, lane, here, None);
                } else {
                    let instant = watched(size, lane, &then, &between, t, (t, 0));
                    lanes.hold(lane, Some(instant));
                    let due = lanes.batch.queue.is_due(t, true);
                    lanes.goes_on(system, lane, due, &seen, &instant);
                }
                accepted &= !(lanes.left & bit);
            }
        }
    }
}
