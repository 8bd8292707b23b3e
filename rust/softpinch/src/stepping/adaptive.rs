//! The loop of steps as long as the error allows, of a run in each lane. Every lane has its own step, accepted or not; a lone run is
//! one lane. Steps end on each breakpoint, where a new stretch begins with a cautious first step.

use crate::error::Error;
use crate::formulation::{Evaluation, Motion, ROOM, States, System};
use crate::grid::Span;
use crate::integrator::newton::largest;
use crate::integrator::step_control::StepControl;
use crate::integrator::{Adaptive, Step};
use crate::lanes::{Bits, LaneTask, Lanes, MOST, each};
use crate::monitor::{turn_between, turning};
use crate::simd::Instructions;
use crate::simulate::{Options, Status};
use crate::stepping::batch::{
    LaneBatch, LaneParameters, LaneRun, POLL, RunQueue, Seen, Watched, column, watched,
};
use crate::stepping::ending::{Attempt, End, full, interruption, overflow, too_many, too_small};
use crate::stepping::sizes::{Sizes, fitted, is_unresolved};

/// The loop, before it begins.
pub struct AdaptiveSteps<'a, Q, M> {
    /// Instructions to use.
    pub instructions: Instructions,
    /// How each run is simulated.
    pub options: &'a Options,
    /// Largest error of a step, as a share of each state's size.
    pub tolerance: f64,
    /// Where runs come from and go.
    pub queue: Q,
    /// Makes equations and method for the runs in all lanes.
    pub make: M,
}

/// Where a run is.
struct Place {
    span: Span,
    /// The stretch between breakpoints that it is in.
    stretch: (f64, f64),
    /// The time, and that of the last instant that was watched.
    t: f64,
    watched: f64,
    /// The time since the stretch's start, and the length of the next attempt.
    tau: f64,
    h: f64,
    control: StepControl,
    last: Attempt,
    attempts: u64,
}

impl Place {
    fn length(&self) -> f64 {
        let (from, to) = self.stretch;
        to - from
    }

    /// When a step of this length ends.
    fn end(&self, taken: f64) -> f64 {
        let (from, to) = self.stretch;
        if taken == self.length() - self.tau { to } else { from + (self.tau + taken) }
    }
}

/// The loop's lanes.
struct AdaptiveLanes<'a, R: Lanes, Q> {
    batch: LaneBatch<'a, R, Place, Q>,
    /// The step control that each run begins with.
    control: StepControl,
    /// When the stretches begin, and the time since.
    origin: R,
    tau: R,
    /// Lanes whose run has just ended, and lanes at the start of a stretch.
    left: Bits,
    entering: Bits,
}

/// Where the steps of all lanes begin.
struct Here<R> {
    y: States<R>,
    /// The evaluation of `y`.
    now: Evaluation<R>,
    /// The errors that are allowed there.
    sizes: Sizes<R>,
}

impl<'a, R: Lanes, Q: RunQueue<'a>> AdaptiveLanes<'a, R, Q> {
    /// Puts the next run into a lane, where there is one; it is at the start of its first stretch.
    fn load(&mut self, lane: usize, here: &mut Here<R>) -> Result<(), Error> {
        let control = self.control;
        let loaded = self.batch.load_lane(lane, |scene| {
            let span = Span::new(&scene.inputs, &scene.initial, scene.duration)?;
            Ok(Place {
                // `enter` goes on to the first one.
                stretch: (span.start, span.start),
                span,
                t: span.start,
                watched: span.start,
                tau: 0.0,
                h: 0.0,
                control,
                last: Attempt::None,
                attempts: 0,
            })
        })?;
        if loaded {
            self.entering |= 1 << lane;
        } else {
            self.origin.set(lane, 0.0);
            self.tau.set(lane, 0.0);
            for rate in &mut here.now.rate {
                rate.set(lane, 0.0);
            }
        }
        Ok(())
    }

    /// Makes equations and method for the runs in the lanes, of which those in `fresh` have changed.
    #[inline(always)]
    fn equip<S: System<R>, I>(
        &mut self,
        make: &mut impl FnMut(&LaneParameters<'_>) -> (S, I),
        fresh: Bits,
        here: &mut Here<R>,
    ) -> (S, I) {
        let (system, method) = self.batch.equip(make, fresh, &mut here.y);
        let usual = system.begin(&self.batch.gathered(Motion::sizes));
        let slow = system.begin(&self.batch.gathered(Motion::slow_sizes));
        here.sizes.begin(fresh, &usual, &slow);
        (system, method)
    }

    /// Ends the run in a lane at its last instant.
    fn retire(&mut self, system: &impl System<R>, lane: usize, end: End, last: &Watched) {
        self.left |= 1 << lane;
        self.batch.retire_lane(system, lane, end, last);
    }

    /// The last instant of a lane that was watched.
    fn last(&self, system: &impl System<R>, lane: usize, here: &Here<R>) -> Option<Watched> {
        let run = self.batch.runs[lane].as_ref()?;
        let t = run.place.watched;
        Some(run.held.unwrap_or_else(|| watched(system.size(), lane, &here.now, &here.y, t, (t, 0))))
    }

    /// Ends the run in a lane after the last instant that was watched; `None` where a number overflowed.
    #[cold]
    #[inline(never)]
    fn stop(&mut self, system: &impl System<R>, lane: usize, here: &Here<R>, end: Option<End>) {
        let Some(last) = self.last(system, lane, here) else { return };
        let end = end.unwrap_or_else(|| overflow(last.instant.t));
        self.retire(system, lane, end, &last);
    }

    /// Records an instant that was just watched, where that is `due`, and ends the run there where a violation or the want of memory
    /// does. Whether the run goes on.
    #[inline(always)]
    fn goes_on(
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
            Ok(()) if seen.ended >> lane & 1 != 0 => self.batch.violation(lane, seen, &instant.instant),
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
    fn enter(&mut self, system: &impl System<R>, here: &mut Here<R>) {
        let (size, mut length) = (system.size(), R::zero());
        for lane in each(self.entering) {
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let place = &mut run.place;
            let (_, from) = place.stretch;
            place.stretch = (from, place.span.stretch_end(&run.scene.inputs, from));
            (place.t, place.tau, place.last) = (from, 0.0, Attempt::None);
            place.control.restart();
            run.segments += 1;
            self.batch.drive.set(lane, &run.scene.inputs.segment(from));
            self.origin.set(lane, from);
            self.tau.set(lane, 0.0);
            length.set(lane, place.length());
        }
        let mut now = system.evaluate(&self.batch.drive, self.tau, &here.y);
        self.batch.stats.evaluations += 1;
        let seen = self.batch.watch(system, &now, &here.y, self.origin, self.entering);
        let (mut stays, mut struck): (Bits, Bits) = (0, 0);
        for lane in each(self.entering) {
            let bit = 1 << lane;
            let t = self.origin.lane(lane);
            if seen.sound & bit == 0 {
                self.stop(system, lane, here, None);
                continue;
            }
            let instant = watched(size, lane, &now, &here.y, t, (t, 0));
            let due = self.batch.queue.is_due(t, false);
            if !self.goes_on(system, lane, due, &seen, &instant) {
                continue;
            }
            let jumps = self.batch.strike(system, lane, (t, self.tau), &mut here.y);
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            run.held = jumps.then_some(instant);
            run.place.watched = t;
            struck |= Bits::from(jumps) << lane;
            stays |= bit;
        }
        self.entering = 0;
        if stays == 0 {
            return;
        }
        if struck != 0 {
            now = system.evaluate(&self.batch.drive, self.tau, &here.y);
            self.batch.stats.evaluations += 1;
        }
        here.now = merged(stays, &now, &here.now);
        here.sizes.note(size, &here.y, stays);
        self.batch.stats.evaluations += 1;
        let (equations, states) = ((system, &self.batch.drive), (&here.y, &here.now.rate));
        let h = here.sizes.first_step(equations, &self.control, states, (stays, length));
        for lane in each(stays) {
            if let Some(run) = &mut self.batch.runs[lane] {
                run.place.h = h.lane(lane);
            }
        }
    }

    /// Where tips seem to be lost and to come back inside a step: when, infinite where none does.
    #[inline(always)]
    fn turns(&self, before: &Motion<R>, after: &Motion<R>, (accepted, h): (Bits, R)) -> [f64; MOST] {
        let mut turns = [f64::INFINITY; MOST];
        for lane in each(turning(before, after) & accepted) {
            let Some(run) = &self.batch.runs[lane] else { continue };
            let (place, taken) = (&run.place, h.lane(lane));
            let (before, after) = (motion(before, lane), motion(after, lane));
            if let Some(x) = turn_between(&run.scene.parameters, &before, &after, taken) {
                turns[lane] = place.stretch.0 + x.mul_add(taken, place.tau);
            }
        }
        turns
    }
}

/// The evaluation of `a` in the lanes whose bits are set, else that of `b`.
#[inline(always)]
fn merged<R: Lanes>(bits: Bits, a: &Evaluation<R>, b: &Evaluation<R>) -> Evaluation<R> {
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
struct Enter<'b, 'a, R: Lanes, Q, S>(&'b mut AdaptiveLanes<'a, R, Q>, &'b S, &'b mut Here<R>);

impl<'a, R: Lanes, Q: RunQueue<'a>, S: System<R>> LaneTask<R> for Enter<'_, 'a, R, Q, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.enter(self.1, self.2);
    }
}

/// Looks at instants inside the step just taken, in the lanes of `accepted`: those that were asked for, and where a tip seems to be
/// lost and to come back (`turns`). Gives the lanes whose runs go on. Called, not inlined, since it is rare.
struct LookInside<'b, 'a, R: Lanes, Q, S, I> {
    lanes: &'b mut AdaptiveLanes<'a, R, Q>,
    system: &'b S,
    method: &'b mut I,
    here: &'b Here<R>,
    step: &'b Step<'b, R>,
    /// The states that the method ends at.
    next: &'b States<R>,
    accepted: Bits,
    turns: [f64; MOST],
}

impl<'a, R: Lanes, Q: RunQueue<'a>, S: System<R>, I: Adaptive<R, S>> LaneTask<R>
    for LookInside<'_, 'a, R, Q, S, I>
{
    type Output = Bits;

    #[inline(always)]
    fn run(self) -> Bits {
        let Self { lanes, system, method, here, step, next, mut accepted, mut turns } = self;
        let size = system.size();
        method.prepare(system, &lanes.batch.drive, step, next, &mut lanes.batch.stats);
        loop {
            let mut inside: Bits = 0;
            let (mut time, mut share) = (lanes.origin, R::zero());
            for lane in each(accepted) {
                let Some(run) = &lanes.batch.runs[lane] else { continue };
                let (tau, taken, from) = (run.place.tau, step.h.lane(lane), run.place.stretch.0);
                let asked = lanes.batch.queue.next_time();
                let asked = if asked < run.place.end(taken) { asked } else { f64::INFINITY };
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
            let since = time - lanes.origin;
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
                    if let Some(run) = &mut lanes.batch.runs[lane] {
                        run.held = Some(instant);
                    }
                    let due = lanes.batch.queue.is_due(t, true);
                    lanes.goes_on(system, lane, due, &seen, &instant);
                }
                accepted &= !(lanes.left & bit);
            }
        }
    }
}

impl<'a, Q: RunQueue<'a>, M> AdaptiveSteps<'a, Q, M> {
    /// Computes all runs of the queue, and gives it back.
    #[inline(always)]
    #[allow(clippy::too_many_lines)] // one step, from the attempt to the next
    pub fn run<R: Lanes, S: System<R>, I: Adaptive<R, S>>(self) -> Result<Q, Error>
    where
        M: FnMut(&LaneParameters<'_>) -> (S, I),
    {
        let Self { instructions, options, tolerance, queue, mut make } = self;
        let zero = R::zero();
        let mut lanes = AdaptiveLanes {
            batch: LaneBatch::new(instructions, queue, options),
            control: StepControl::new(I::ERROR_ORDER, I::WORTH),
            origin: zero,
            tau: zero,
            left: 0,
            entering: 0,
        };
        let mut here = Here { y: [zero; ROOM], now: Evaluation::nothing(), sizes: Sizes::new(tolerance) };
        for lane in 0..R::WIDTH {
            lanes.load(lane, &mut here)?;
        }
        let (mut system, mut method) = lanes.equip(&mut make, R::ALL, &mut here);
        let (mut next, mut attempts) = ([zero; ROOM], 0u64);
        let size = system.size();

        loop {
            // The one place where lanes leave the vector code: runs that have ended make room for others, and stretches begin.
            while lanes.left | lanes.entering != 0 {
                let left = std::mem::take(&mut lanes.left);
                for lane in each(left) {
                    lanes.load(lane, &mut here)?;
                }
                if left != 0 && lanes.batch.active != 0 {
                    (system, method) = lanes.equip(&mut make, left, &mut here);
                }
                if lanes.entering != 0 {
                    method.restart();
                    R::call(instructions, Enter(&mut lanes, &system, &mut here));
                }
            }
            if lanes.batch.active == 0 {
                return Ok(lanes.batch.queue);
            }

            attempts += 1;
            let stops = attempts.is_multiple_of(POLL) && lanes.batch.queue.stops();
            let mut h = zero;
            let mut retried: Bits = 0;
            for lane in each(lanes.batch.active) {
                let Some(run) = &mut lanes.batch.runs[lane] else { continue };
                let (place, most) = (&mut run.place, options.max_steps);
                let rest = place.length() - place.tau;
                let taken = fitted(place.h, rest);
                h.set(lane, taken);
                retried |= Bits::from(place.control.retries()) << lane;
                let end = if stops {
                    Some(interruption(place.t))
                } else if taken < rest && is_unresolved(taken, place.t, place.length()) {
                    Some(too_small(place.t, taken, place.last))
                } else if place.attempts == most {
                    Some(too_many(place.t, taken, most))
                } else {
                    None
                };
                place.attempts += 1;
                if end.is_some() {
                    lanes.stop(&system, lane, &here, end);
                }
            }
            if lanes.batch.active == 0 {
                continue;
            }

            let tau = lanes.tau;
            let allowed = Some(&here.sizes.allowed);
            let step = Step { tau, h, y: &here.y, rate: &here.now.rate, allowed };
            let (drive, stats) = (&lanes.batch.drive, &mut lanes.batch.stats);
            if let Err(failure) = method.step(&system, drive, &step, &mut next, stats) {
                let unsolved = Attempt::Unsolved(failure.into());
                for lane in each(lanes.batch.active) {
                    let Some(run) = &mut lanes.batch.runs[lane] else { continue };
                    run.place.last = unsolved;
                    run.place.h = run.place.control.unsolved() * h.lane(lane);
                    stats.rejected += 1;
                }
                continue;
            }
            let errors = method.error(&system, drive, &step, retried, stats);
            // What puts a step back on the constraints is an error of it, too.
            let mut arrived = next;
            system.correct(drive, tau + h, &mut arrived);
            let mut moved = [zero; ROOM];
            size.each(|n| moved[n] = arrived[n] - next[n]);
            let shifts = largest(size, &moved, &here.sizes.allowed.weights);
            let mut accepted: Bits = 0;
            for lane in each(lanes.batch.active) {
                let Some(run) = &mut lanes.batch.runs[lane] else { continue };
                let (own, shift, taken) = (errors.lane(lane), shifts.lane(lane), h.lane(lane));
                let error = if shift > own || shift.is_nan() { shift } else { own };
                run.place.last = Attempt::Error(error);
                match run.place.control.judge(error) {
                    Ok(growth) => {
                        run.place.h = growth * taken;
                        run.steps += 1;
                        accepted |= 1 << lane;
                    }
                    Err(shrink) => {
                        run.place.h = shrink * taken;
                        stats.rejected += 1;
                    }
                }
            }
            if accepted == 0 {
                continue;
            }
            method.accepted(h);
            let there = system.evaluate(drive, tau + h, &arrived);
            stats.evaluations += 1;

            // Instants inside the step: those asked for, by dense output, and where a tip seems to be lost and to come back.
            let turns = lanes.turns(&here.now.motion, &there.motion, (accepted, h));
            let asked = lanes.batch.queue.next_time();
            let inside = |run: &LaneRun<'_, Place>, lane| {
                asked < run.place.end(h.lane(lane)) || turns[lane].is_finite()
            };
            if each(accepted).any(|lane| lanes.batch.runs[lane].as_ref().is_some_and(|run| inside(run, lane)))
            {
                let (lanes, system, method) = (&mut lanes, &system, &mut method);
                let look = LookInside {
                    lanes,
                    system,
                    method,
                    here: &here,
                    step: &step,
                    next: &next,
                    accepted,
                    turns,
                };
                accepted = R::call(instructions, look);
            }

            here.sizes.note(size, &arrived, accepted);
            let mut t = zero;
            // Lanes at the ends of their runs.
            let mut done: Bits = 0;
            for lane in each(accepted) {
                let Some(run) = &mut lanes.batch.runs[lane] else { continue };
                let place = &mut run.place;
                let (taken, (_, to)) = (h.lane(lane), place.stretch);
                (place.tau, place.t) = (place.tau + taken, place.end(taken));
                lanes.tau.set(lane, place.tau);
                t.set(lane, place.t);
                if place.t == to && to < place.span.end {
                    // A breakpoint is watched under the inputs that hold from there on, when `here` is another state.
                    lanes.entering |= 1 << lane;
                    let last = lanes.last(&system, lane, &here);
                    if let Some(run) = &mut lanes.batch.runs[lane] {
                        run.held = last;
                    }
                } else if place.t == to {
                    done |= 1 << lane;
                }
            }
            let watching = accepted & !lanes.entering;
            let seen = lanes.batch.watch(&system, &there, &arrived, t, watching);
            for lane in each(watching) {
                let bit = 1 << lane;
                if seen.sound & bit == 0 {
                    lanes.stop(&system, lane, &here, None);
                    continue;
                }
                let Some(run) = &mut lanes.batch.runs[lane] else { continue };
                let at = t.lane(lane);
                (run.held, run.place.watched) = (None, at);
                let due = lanes.batch.queue.is_due(at, false);
                if due || (seen.ended | done) & bit != 0 {
                    let instant = watched(size, lane, &there, &arrived, at, (at, 0));
                    if lanes.goes_on(&system, lane, due, &seen, &instant) && done & bit != 0 {
                        lanes.retire(&system, lane, (Status::Completed, String::new()), &instant);
                    }
                }
            }
            here.now = merged(watching, &there, &here.now);
            size.each(|n| here.y[n] = R::select(accepted, arrived[n], here.y[n]));
        }
    }
}
