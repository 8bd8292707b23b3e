//! The loop of equal steps between breakpoints, of a run in each lane. Every lane has its own breakpoints, steps and parameters, and
//! takes the next run as soon as its own has ended; a lone run is one lane.

use std::mem::swap;

use crate::error::Error;
use crate::formulation::{Evaluation, Motion, ROOM, States, System};
use crate::grid::{Grid, Segment};
use crate::integrator::newton::Unsolved;
use crate::integrator::{Integrator, Step};
use crate::lanes::{Bits, Lanes, each};
use crate::record::Linearized;
use crate::simd::Instructions;
use crate::simulate::{Options, Scene, Status};
use crate::stepping::batch::{Equip, LaneBatch, POLL, RunQueue, Seen, Watched, column, put, watched};
use crate::stepping::ending::{self, End, full, interruption, overflow};

/// The loop, before it begins.
pub struct EqualSteps<'a, Q, G, E> {
    /// Instructions to use.
    pub instructions: Instructions,
    /// How each run is simulated.
    pub options: &'a Options,
    /// Where runs come from and go.
    pub queue: Q,
    /// The times of a scene's steps.
    pub grid: G,
    /// Makes equations and method for the runs in all lanes.
    pub equip: E,
}

/// Where a run is on its grid.
struct Place {
    grid: Grid,
    /// The segment that it is in, the one before, and the steps taken until its start.
    segment: Segment,
    earlier: Option<Segment>,
    steps_before: u64,
    /// The clock when the segment ends.
    arrival: u64,
    /// The clock until when the run's held instant is the last one that was watched.
    held_until: u64,
}

impl Place {
    /// At the start of a run, whose first instant is evaluated when the clock says `from`.
    fn new(grid: Grid, from: u64) -> Self {
        Self { segment: grid.first, earlier: None, steps_before: 0, arrival: 0, held_until: from, grid }
    }

    /// Steps taken in its segment at this clock, by this run or one that it goes on from.
    fn step(&self, clock: u64) -> u64 {
        self.segment.count - (self.arrival - clock)
    }

    /// The time and the place on the grid of the instant at this clock.
    fn now(&self, clock: u64) -> (f64, (f64, u64)) {
        let step = self.step(clock);
        (self.segment.time(step), (self.segment.anchor, step))
    }

    /// The same of the instant before.
    fn before(&self, clock: u64) -> (f64, (f64, u64)) {
        let step = self.step(clock);
        let (segment, step) = match self.earlier {
            Some(earlier) if step == self.segment.first => (earlier, earlier.count - 1),
            _ => (self.segment, step.saturating_sub(1).max(self.segment.first)),
        };
        (segment.time(step), (segment.anchor, step))
    }
}

/// The last two instants of the runs in all lanes: evaluations with the states that they are of.
struct Instants<'a, R> {
    now: &'a Evaluation<R>,
    y: &'a States<R>,
    before: &'a Evaluation<R>,
    y_before: &'a States<R>,
}

/// The loop's lanes.
struct Equal<'a, R: Lanes, Q, G> {
    batch: LaneBatch<'a, R, Place, Q>,
    grid: G,
    /// When the lanes' segments begin, the steps taken since, and how long these are.
    anchor: R,
    taken: R,
    h: R,
    /// Lanes at their runs' first instants, and at their last.
    fresh: Bits,
    arrived: Bits,
    /// Those whose impulses strike now, and those whose impulses have struck, so that the instant was watched already.
    striking: Bits,
    struck: Bits,
    /// Lanes that have entered a segment since the last step.
    entered: Bits,
    /// Evaluations of the loop so far, and when the next segment of any lane ends.
    clock: u64,
    arrival: u64,
    /// For methods that keep a Jacobian, which have one lane: where it was taken, where the one was that serves the next step, and the
    /// same at the last instant that was watched.
    taken_at: Option<Linearized>,
    serving: Option<Linearized>,
    serving_last: Option<Linearized>,
}

impl<'a, R: Lanes, Q: RunQueue<'a>, G: FnMut(&Scene) -> Result<Grid, Error>> Equal<'a, R, Q, G> {
    /// Puts the next run into a lane, where there is one; it is at its start when the clock says `from`.
    fn load(&mut self, lane: usize, from: u64) -> Result<(), Error> {
        let bit = 1 << lane;
        self.arrived &= !bit;
        self.fresh &= !bit;
        self.striking &= !bit;
        let grid = &mut self.grid;
        if self.batch.load_lane(lane, |scene| Ok(Place::new(grid(scene)?, from)))? {
            self.fresh |= bit;
            self.enter(lane, from);
        } else {
            self.anchor.set(lane, 0.0);
            self.taken.set(lane, 0.0);
            self.h.set(lane, 0.0);
        }
        Ok(())
    }

    /// Puts a lane at the start of its segment, where it is when the clock says `from`.
    fn enter(&mut self, lane: usize, from: u64) {
        let Some(run) = &mut self.batch.runs[lane] else { return };
        let Segment { anchor, start, h, first, count, .. } = run.place.segment;
        run.segments += 1;
        run.place.arrival = from + (count - first);
        self.batch.drive.set(lane, &run.scene.inputs.segment(anchor));
        self.anchor.set(lane, anchor);
        self.h.set(lane, h);
        #[allow(clippy::cast_precision_loss)] // at most 1e11
        self.taken.set(lane, first as f64);
        // A run that goes on inside a segment has had the impulses at its anchor.
        if first == 0 && run.scene.inputs.impulses_at(start).next().is_some() {
            self.striking |= 1 << lane;
        }
        self.entered |= 1 << lane;
    }

    /// Looks for the segment that ends next.
    fn schedule(&mut self) {
        let runs = each(self.batch.active & !self.arrived).filter_map(|lane| self.batch.runs[lane].as_ref());
        self.arrival = runs.map(|run| run.place.arrival).min().unwrap_or(u64::MAX);
    }

    /// Lanes at the ends of their segments go on to the next, or have arrived.
    #[cold]
    #[inline(never)]
    fn arrive(&mut self) {
        for lane in each(self.batch.active & !self.arrived) {
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let place = &mut run.place;
            if place.arrival != self.clock {
                continue;
            }
            match place.grid.after(&run.scene.inputs, &place.segment) {
                Some(next) => {
                    place.steps_before += place.segment.steps();
                    place.earlier = Some(std::mem::replace(&mut place.segment, next));
                    self.enter(lane, self.clock);
                }
                None => self.arrived |= 1 << lane,
            }
        }
        self.schedule();
    }

    /// The times of all lanes, exact at the ends.
    #[inline(always)]
    fn times(&self, tau: R) -> R {
        let mut t = self.anchor + tau;
        let exact = self.arrived | self.fresh;
        if exact != 0 {
            for lane in each(exact) {
                if let Some(run) = &self.batch.runs[lane] {
                    t.set(lane, run.place.now(self.clock).0);
                }
            }
        }
        t
    }

    /// The instant of a lane that was just watched.
    #[inline(always)]
    fn now(&self, system: &impl System<R>, lane: usize, at: &Instants<'_, R>) -> Option<Watched> {
        let (t, grid) = self.batch.runs[lane].as_ref()?.place.now(self.clock);
        let found = watched(system.size(), lane, at.now, at.y, t, grid);
        Some(Watched { linearized: self.serving_last, ..found })
    }

    /// The last instant of a lane that was watched before this one.
    fn before(&self, system: &impl System<R>, lane: usize, at: &Instants<'_, R>) -> Option<Watched> {
        let run = self.batch.runs[lane].as_ref()?;
        if run.held.is_some() && self.clock <= run.place.held_until {
            return run.held;
        }
        let (t, grid) = run.place.before(self.clock);
        let found = watched(system.size(), lane, at.before, at.y_before, t, grid);
        Some(Watched { linearized: self.serving_last, ..found })
    }

    /// Counts the steps that the run in a lane has taken.
    fn count(&mut self, lane: usize) {
        let Some(run) = &mut self.batch.runs[lane] else { return };
        run.steps = run.place.steps_before + run.place.step(self.clock) - run.place.segment.first;
    }

    /// Ends the run in a lane; `sound` where the instant now is its last one.
    fn retire(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        sound: bool,
        at: &Instants<'_, R>,
        end: Option<End>,
    ) {
        let bit = 1 << lane;
        let last = if sound { self.now(system, lane, at) } else { self.before(system, lane, at) };
        let Some(last) = last else { return };
        self.count(lane);
        let end = end.unwrap_or_else(|| overflow(last.instant.t));
        self.arrived &= !bit;
        self.batch.retire_lane(system, lane, end, &last);
    }

    /// The one place where lanes leave the vector code: in place of a step, a run ends and the next one begins, or impulses strike.
    /// Gives the lanes that do not take the step, with their states in `replacement`, and those among them that have another run.
    #[cold]
    #[inline(never)]
    fn hold(
        &mut self,
        system: &impl System<R>,
        (seen, leaving, tau): (&Seen, Bits, R),
        at: &Instants<'_, R>,
        replacement: &mut States<R>,
    ) -> Result<(Bits, Bits), Error> {
        let mut leaving = leaving;
        for lane in each(leaving) {
            let bit = 1 << lane;
            let Some(now) = self.now(system, lane, at) else { continue };
            self.count(lane);
            let sound = seen.sound & bit != 0;
            let end = sound.then(|| {
                let violation = self.batch.violation(lane, seen, &now.instant);
                violation.unwrap_or((Status::Completed, String::new()))
            });
            self.retire(system, lane, sound, at, end);
        }
        if (self.clock + 1).is_multiple_of(POLL) && self.batch.queue.stops() {
            for lane in each(self.batch.active) {
                let sound = self.struck >> lane & 1 == 0;
                let Some(run) = &self.batch.runs[lane] else { continue };
                let end = interruption(run.place.now(self.clock).0);
                self.retire(system, lane, sound, at, Some(end));
                leaving |= 1 << lane;
            }
        }
        for lane in each(leaving) {
            self.load(lane, self.clock + 1)?;
        }
        let striking = self.striking & !leaving;
        self.striking &= !striking;
        for lane in each(striking) {
            let now = self.now(system, lane, at);
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            // The instant after the impulses is evaluated, but not watched again; the next step follows it.
            run.held = now;
            run.place.held_until = self.clock + 2;
            run.place.arrival += 1;
            let mut y = *at.y;
            let anchor = run.place.segment.anchor;
            self.batch.strike(system, lane, (anchor, tau), &mut y);
            put(replacement, lane, &column(&y, lane));
        }
        self.struck = striking;
        self.schedule();
        Ok((leaving | striking, leaving))
    }

    /// Ends the runs in the lanes of `failed`, whose step's equations were not solved, and loads the next ones.
    #[cold]
    fn fail(
        &mut self,
        system: &impl System<R>,
        (failed, unsolved): (Bits, Unsolved),
        at: &Instants<'_, R>,
    ) -> Result<(), Error> {
        for lane in each(failed) {
            let t = self.now(system, lane, at).map_or(f64::NAN, |now| now.instant.t);
            let end = ending::unsolved(t, self.h.lane(lane), unsolved);
            self.retire(system, lane, self.struck >> lane & 1 == 0, at, Some(end));
            self.load(lane, self.clock + 1)?;
        }
        self.schedule();
        Ok(())
    }

    /// What a method that keeps a Jacobian forgets at a breakpoint, or takes over from the run that this one goes on from.
    #[cold]
    fn keep<S: System<R>, I: Integrator<R, S>>(&mut self, system: &S, method: &mut I) {
        method.restart();
        self.serving = None;
        let Some(run) = &self.batch.runs[0] else { return };
        let Some(point) = run.scene.initial.linearized.filter(|_| run.place.segment.first > 0) else {
            return;
        };
        let (tau, motion) = unpack(&point);
        let motion = Motion {
            q: motion.q.map(R::constant),
            p: motion.p.map(R::constant),
            memory: motion.memory.map(R::constant),
        };
        method.keep(&self.batch.drive, R::constant(tau), &system.begin(&motion));
        (self.serving, self.taken_at) = (Some(point), Some(point));
    }
}

fn pack<R: Lanes>(tau: R, motion: &Motion<R>) -> Linearized {
    let mut point = [tau.lane(0); 21];
    for n in 0..9 {
        (point[1 + n], point[10 + n]) = (motion.q[n].lane(0), motion.p[n].lane(0));
    }
    (point[19], point[20]) = (motion.memory[0].lane(0), motion.memory[1].lane(0));
    point
}

fn unpack(point: &Linearized) -> (f64, Motion<f64>) {
    let motion = Motion {
        q: std::array::from_fn(|k| point[1 + k]),
        p: std::array::from_fn(|k| point[10 + k]),
        memory: [point[19], point[20]],
    };
    (point[0], motion)
}

impl<'a, Q: RunQueue<'a>, G: FnMut(&Scene) -> Result<Grid, Error>, E> EqualSteps<'a, Q, G, E> {
    /// Computes all runs of the queue, and gives it back.
    #[inline(always)]
    pub fn run<R: Lanes, S: System<R>, I: Integrator<R, S>>(self) -> Result<Q, Error>
    where
        E: Equip<S, I>,
    {
        let Self { instructions, options, queue, grid, mut equip } = self;
        let zero = R::zero();
        let mut lanes = Equal {
            batch: LaneBatch::new(instructions, queue, options),
            grid,
            anchor: zero,
            taken: zero,
            h: zero,
            fresh: 0,
            arrived: 0,
            striking: 0,
            struck: 0,
            entered: 0,
            clock: 0,
            arrival: u64::MAX,
            taken_at: None,
            serving: None,
            serving_last: None,
        };
        for lane in 0..R::WIDTH {
            lanes.load(lane, 0)?;
        }
        // States now and after the step, and of the lanes that do not take the step that the others take.
        let (mut first, mut second, mut replacement) = ([zero; ROOM], [zero; ROOM], [zero; ROOM]);
        let (mut y, mut after) = (&mut first, &mut second);
        let (mut one, mut other) = (Evaluation::nothing(), Evaluation::nothing());
        let (mut now, mut before) = (&mut one, &mut other);
        let (mut system, mut method) = lanes.batch.equip(&mut equip, y);
        replacement.copy_from_slice(&y[..]);
        lanes.schedule();

        while lanes.batch.active != 0 {
            if lanes.entered != 0 {
                lanes.entered = 0;
                if method.keeps() {
                    lanes.keep(&system, &mut method);
                }
            }
            let tau = lanes.taken * lanes.h;
            let t = lanes.times(tau);
            swap(&mut now, &mut before);
            system.evaluate_into(&lanes.batch.drive, tau, y, now);
            lanes.batch.stats.evaluations += 1;
            let watching = lanes.batch.active & !lanes.struck;
            let seen = lanes.batch.watch(&system, now, y, t, watching);
            if method.keeps() && watching & seen.sound != 0 {
                lanes.serving_last = lanes.serving;
            }
            let at = Instants { now, y, before, y_before: after };
            if watching & seen.sound & 1 != 0
                && lanes.batch.queue.is_due(t.lane(0), false)
                && let Some(row) = lanes.now(&system, 0, &at)
                && let Err(error) = lanes.batch.record(&system, &row)
            {
                lanes.retire(&system, 0, true, &at, Some(full(row.instant.t, &error)));
                // The run cannot go on, and no other one is recorded.
                break;
            }

            // Lanes that do not take the step, and those among them that have another run.
            let mut held = R::ALL & !lanes.batch.active;
            let mut loaded = 0;
            let leaving = (watching & !seen.sound) | seen.ended | lanes.arrived;
            let polls = (lanes.clock + 1).is_multiple_of(POLL);
            lanes.fresh = 0;
            if leaving | lanes.striking | lanes.struck != 0 || polls {
                let (holding, fresh) = lanes.hold(&system, (&seen, leaving, tau), &at, &mut replacement)?;
                (held, loaded) = (held | holding, fresh);
            }
            if held != R::ALL {
                let step = Step { tau, h: lanes.h, y, rate: &now.rate, allowed: None };
                let (drive, stats) = (&lanes.batch.drive, &mut lanes.batch.stats);
                let jacobians = stats.jacobians;
                match method.step(&system, drive, &step, after, stats) {
                    Ok(()) => {
                        if method.keeps() {
                            if stats.jacobians > jacobians {
                                lanes.taken_at = Some(pack(tau, &now.motion));
                            }
                            lanes.serving = lanes.taken_at.filter(|_| method.serves());
                        }
                        system.correct(drive, tau + lanes.h, after);
                    }
                    Err(failure) => {
                        let failed = R::ALL & !held;
                        let at = Instants { now, y, before, y_before: y };
                        lanes.fail(&system, (failed, failure.into()), &at)?;
                        (held, loaded) = (held | failed, loaded | failed);
                    }
                }
            }
            if loaded != 0 {
                if lanes.batch.active == 0 {
                    break;
                }
                lanes.batch.renew(&mut equip, (&mut system, &mut method), loaded, &mut replacement);
            }
            swap(&mut y, &mut after);
            if held != 0 {
                system.each(|n| y[n] = R::select(held, replacement[n], y[n]));
            }
            lanes.taken = R::select(held, lanes.taken, lanes.taken + R::constant(1.0));
            lanes.clock += 1;
            if lanes.clock == lanes.arrival {
                lanes.arrive();
            }
        }
        Ok(lanes.batch.queue)
    }
}
