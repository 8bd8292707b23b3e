//! The lanes of the loop of equal steps: the places of their runs, and the rare work at breakpoints and ends of runs.

use crate::error::Result;
use crate::formulation::{Evaluation, SceneEquations, States, System};
use crate::method::{Integrator, Step, StepResult, Unsolved};
use crate::model::{Linearized, Motion, Scene, unpacked};
use crate::number::{Bits, Lanes, each, inlined};
use crate::stepping::batch::LaneRun;
use crate::stepping::ending;
use crate::stepping::lone_steps::LoneSteps;
use crate::stepping::{
    End, Grid, GridOf, Instant, LaneBatch, LaneController, LoopSystem, Moment, Phase, Segment, column, full,
    put, round_off, watched,
};

pub struct Place {
    pub grid: Grid,
    /// The current segment, the segment before it, and the number of steps before the current segment.
    pub segment: Segment,
    pub earlier: Option<Segment>,
    pub steps_before: u64,
    pub arrival: u64,
    /// The clock until which the saved instant of the run is its last watched one.
    pub saved_until: u64,
    /// The clock at which the run's discrete controller took its last sample.
    pub sampled: Option<u64>,
}

impl Place {
    /// The place at the start of a run, whose first instant is evaluated at the clock `from`.
    pub fn new(grid: Grid, from: u64) -> Self {
        let (segment, arrival, steps_before) = (grid.first, 0, 0);
        Self { grid, segment, earlier: None, steps_before, arrival, saved_until: from, sampled: None }
    }

    /// The phase in which a run begins the current segment, once the modes of its contacts are chosen. A run that is resumed
    /// inside a segment has already had the impulses at the start of the segment.
    pub fn phase_at_start(&self, scene: &Scene) -> Phase {
        let Segment { first, start, .. } = self.segment;
        let struck = first == 0 && scene.inputs.impulses_at(start).next().is_some();
        if struck { Phase::Impulse } else { Phase::Step }
    }

    /// Goes on in the segment after the current one.
    pub fn go_on(&mut self, next: Segment) {
        self.steps_before += self.segment.steps();
        self.earlier = Some(std::mem::replace(&mut self.segment, next));
    }

    /// Number of steps in the current segment at this clock, including those of a run that this one resumes.
    pub fn step(&self, clock: u64) -> u64 {
        self.segment.count - (self.arrival - clock)
    }

    pub fn now(&self, clock: u64) -> (f64, (f64, u64)) {
        let step = self.step(clock);
        (self.segment.time(step), (self.segment.anchor, step))
    }

    /// The segment of the step that ends at this clock, and the number of steps in it up to there.
    pub fn last_step(&self, clock: u64) -> (Segment, u64) {
        let step = self.step(clock);
        match self.earlier {
            Some(earlier) if step == self.segment.first => (earlier, earlier.count),
            _ => (self.segment, step),
        }
    }

    /// The time and the grid point of the instant before this clock.
    pub fn before(&self, clock: u64) -> (f64, (f64, u64)) {
        let (segment, step) = self.last_step(clock);
        let step = step.saturating_sub(1).max(segment.first);
        (segment.time(step), (segment.anchor, step))
    }
}

/// A row closer to the start of its step than this share of the step has the state there.
const SLIVER: f64 = 1.0 / (1u64 << 44) as f64;

/// The rows inside the last step, and the steps that lead to them.
#[derive(Default)]
pub struct RowsInside {
    /// The equations and the method, once there was a row; runs with unilateral contact have their own.
    steps: Option<Box<LoneSteps>>,
    /// The rows, until it is known how far the run gets in this step.
    pub rows: Vec<Instant>,
}

impl RowsInside {
    /// Computes the instants that were asked for before the end of the step that the run in lane 0 takes from the time
    /// `tau` of its segment and the state `y`.
    #[cold]
    #[inline(never)]
    pub fn look_inside<R: Lanes>(
        &mut self,
        batch: &mut LaneBatch<'_, R, Place>,
        clock: u64,
        system: &SceneEquations<R>,
        (tau, y): (R, &States<R>),
    ) -> StepResult {
        let (tau, y) = (tau.lane(0), column(y, 0));
        let Some(run) = &mut batch.runs[0] else { return Ok(()) };
        let (start, end) = (run.place.now(clock).0, run.place.now(clock + 1).0);
        if let Some(steps) = &mut self.steps {
            steps.method.forget_start();
        }
        loop {
            let time = batch.queue.recorder.next_time();
            if time >= end {
                return Ok(());
            }
            batch.queue.recorder.is_due(time, true);
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
                let options = batch.options;
                let new = || Box::new(LoneSteps::new(options, &run.scene));
                let steps = self.steps.get_or_insert_with(new);
                let LoneSteps { system: alone, method } = &mut **steps;
                let next = if length > 0.0 { method.step(alone, &drive, (tau, &y), length)? } else { y };
                let now = alone.evaluate(&drive, tau + length, &next);
                batch.stats.evaluations += 1;
                batch.stats.add(&std::mem::take(&mut method.stats));
                watched(system.size(), (0, None), &now, &next, time, (time, 0))
            };
            // After an overflow the run ends at this step.
            if row.is_finite() {
                self.rows.push(Instant { t: time, grid: (time, 0), ..row });
            }
        }
    }
}

/// The last two instants of the runs in all lanes: the states and their evaluations by the equations.
pub struct Instants<'a, R> {
    pub system: &'a SceneEquations<R>,
    pub now: &'a Evaluation<R>,
    pub y: &'a States<R>,
    pub before: &'a Evaluation<R>,
    pub y_before: &'a States<R>,
}

pub struct EqualLanes<'a, R: Lanes> {
    pub batch: LaneBatch<'a, R, Place>,
    pub grid: &'a GridOf<'a>,
    /// Starts of the lanes' segments, steps taken since then, and lengths of the steps.
    pub anchor: R,
    pub taken: R,
    pub h: R,
    /// Lanes that have not yet stepped in their segment, and whether one of them has just entered it.
    pub at_start: Bits,
    pub entered: bool,
    /// Lanes that took the last step, and lanes that do not take the next one, because an event or a sample acts now.
    pub stepped: Bits,
    pub held: Bits,
    /// The clock, which counts the evaluations of the loop, and its reading when the next segment of any lane ends.
    pub clock: u64,
    pub arrival: u64,
    /// For methods that keep a Jacobian, which have one lane: the point at which it was last taken, the point
    /// of the Jacobian that the next step uses, and that point at the last watched instant.
    pub taken_at: Option<Linearized>,
    pub in_use: Option<Linearized>,
    pub in_use_last: Option<Linearized>,
    /// For a recorded run, which has lane 0: the rows inside its last step.
    pub inside: RowsInside,
}

impl<R: Lanes> EqualLanes<'_, R> {
    /// Loads the next run, if there is one, into a lane. The run starts at the clock `from`.
    pub fn load(&mut self, lane: usize, from: u64) -> Result {
        let grid = self.grid;
        if self.batch.load_lane(lane, |number, scene| Ok(Place::new(grid(number, scene)?, from)))? {
            self.enter(lane, from);
        } else {
            self.anchor.set(lane, 0.0);
            self.taken.set(lane, 0.0);
            self.h.set(lane, 0.0);
        }
        Ok(())
    }

    /// Puts a lane at the start of its segment, which it reaches at the clock `from`.
    pub fn enter(&mut self, lane: usize, from: u64) {
        let Some(run) = &mut self.batch.runs[lane] else { return };
        let Segment { anchor, start, h, first, count, .. } = run.place.segment;
        run.place.arrival = from + (count - first);
        self.anchor.set(lane, anchor);
        self.h.set(lane, h);
        self.taken.set(lane, first as f64); // at most 1e11
        self.at_start |= 1 << lane;
        self.entered = true;
        if run.controller.as_ref().is_some_and(|controller| controller.is_due(start)) {
            // The run starts with a sample. Its segment begins after that.
            self.batch.phases.set(1 << lane, Phase::Sample);
            self.batch.enter_segment(lane, anchor, None);
            return;
        }
        let phase = match run.contact.as_deref() {
            Some(contact) if first == 0 || contact.is_unset() => Phase::Start,
            _ => run.place.phase_at_start(&run.scene),
        };
        self.batch.phases.set(1 << lane, phase);
        self.batch.enter_segment(lane, anchor, Some(start));
    }

    /// Lets the discrete controllers of the lanes in `sampling` measure the instant that was just evaluated, and
    /// begins their next segment. It is evaluated again under the new torques, and watched then.
    #[cold]
    #[inline(never)]
    pub fn take_samples(&mut self, sampling: Bits, now: &Evaluation<R>) {
        self.held |= sampling;
        for lane in each(sampling) {
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let place = &mut run.place;
            if place.arrival == self.clock
                && let Some(next) = place.grid.after(&run.scene.inputs, &place.segment)
            {
                place.go_on(next);
            }
            place.sampled = Some(self.clock);
            let start = place.segment.start;
            self.batch.take_sample(lane, start, now);
            self.enter(lane, self.clock + 1);
        }
        self.schedule();
    }

    /// Finds the clock at which the next segment ends.
    pub fn schedule(&mut self) {
        let under_way = self.batch.active() & !self.batch.phases.at(Phase::End);
        let runs = each(under_way).filter_map(|lane| self.batch.runs[lane].as_ref());
        self.arrival = runs.map(|run| run.place.arrival).min().unwrap_or(u64::MAX);
    }

    /// Puts lanes at the end of a segment into the next segment. A lane at the end of its last segment has arrived.
    #[cold]
    #[inline(never)]
    pub fn arrive(&mut self) {
        for lane in each(self.batch.active() & !self.batch.phases.at(Phase::End)) {
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let place = &mut run.place;
            if place.arrival != self.clock {
                continue;
            }
            let sampled = |controller: &LaneController| controller.is_due(place.segment.end);
            if place.grid.is_last(&place.segment) {
                self.batch.phases.set(1 << lane, Phase::End);
            } else if run.controller.as_deref().is_some_and(sampled) {
                // The controller measures at the end of the segment, before another one begins.
                self.batch.phases.set(1 << lane, Phase::Sample);
            } else if let Some(next) = place.grid.after(&run.scene.inputs, &place.segment) {
                place.go_on(next);
                self.enter(lane, self.clock);
            }
        }
        self.schedule();
    }

    /// The times of all lanes, which are exact at breakpoints and at starts and ends of runs.
    #[inline(always)]
    pub fn times(&self, tau: R) -> R {
        let mut t = self.anchor + tau;
        let exact = self.batch.phases.at(Phase::End) | self.at_start;
        if exact != 0 {
            for lane in each(exact) {
                if let Some(run) = &self.batch.runs[lane] {
                    t.set(lane, run.place.now(self.clock).0);
                }
            }
        }
        t
    }

    /// The instant that was just watched, in one lane.
    #[inline(always)]
    pub fn now(&self, lane: usize, at: &Instants<'_, R>) -> Option<Instant> {
        let (t, grid) = self.batch.runs[lane].as_ref()?.place.now(self.clock);
        let found = self.batch.instant(lane, at.system.size(), (at.now, at.y), t, grid);
        Some(Instant { linearized: self.in_use_last, ..found })
    }

    /// The last watched instant of a lane: the current one if it is `finite`, else one before it.
    pub fn last(&self, lane: usize, finite: bool, at: &Instants<'_, R>) -> Option<Instant> {
        if finite {
            return self.now(lane, at);
        }
        let run = self.batch.runs[lane].as_ref()?;
        let place = &run.place;
        let Segment { anchor, start, first, .. } = place.segment;
        let since_sample = place.sampled.map_or(u64::MAX, |clock| self.clock - clock);
        if since_sample > 1 && run.saved_instant.is_some() && self.clock <= place.saved_until {
            return run.saved_instant;
        }
        // The instant of a sample is evaluated twice, first under the torques before it.
        let (t, grid) = if since_sample <= 1 { (start, (anchor, first)) } else { place.before(self.clock) };
        let (evaluation, y) = if since_sample == 0 { (at.now, at.y) } else { (at.before, at.y_before) };
        let found = self.batch.instant(lane, at.system.size(), (evaluation, y), t, grid);
        Some(Instant { linearized: self.in_use_last, before_sample: since_sample <= 1, ..found })
    }

    inlined! {
        /// The lanes whose present instant is watched: the state of the others has just been replaced.
        pub watched_now(&self) -> Bits =
            self.batch.active() & !(self.batch.phases.at(Phase::Struck) | self.held);
        pub has_rows_inside(&self) -> bool = R::WIDTH == 1 && !self.inside.rows.is_empty();
    }

    pub fn retire(&mut self, system: &SceneEquations<R>, lane: usize, end: End, last: &Instant) {
        if self.has_rows_inside() && !self.record_inside(system, last.t) {
            return;
        }
        let Some(LaneRun { place, .. }) = &self.batch.runs[lane] else { return };
        let steps = place.steps_before + place.step(self.clock) - place.segment.first;
        self.batch.retire_lane(system, lane, end, last, steps);
    }

    /// Records the rows inside the last step, which the run has followed until the time `until`. Returns whether the
    /// run goes on: it ends if there is no memory for a row.
    #[cold]
    #[inline(never)]
    pub fn record_inside(&mut self, system: &SceneEquations<R>, until: f64) -> bool {
        let rows = std::mem::take(&mut self.inside.rows);
        for row in rows.into_iter().take_while(|row| row.t < until) {
            if let Err(error) = self.batch.record(system, &row) {
                self.retire(system, 0, full(row.t, &error), &row);
                return false;
            }
        }
        true
    }

    /// Replaces the state of a lane, which is evaluated again. Until the run has been watched again, after so many
    /// evaluations, its last watched instant is `before`.
    pub fn hold(
        &mut self,
        lane: usize,
        before: Instant,
        (y, evaluations): (&States<f64>, u64),
        replacement: &mut States<R>,
    ) {
        put(replacement, lane, y);
        let Some(run) = &mut self.batch.runs[lane] else { return };
        run.saved_instant = Some(before);
        run.place.saved_until = self.clock + evaluations;
        run.place.arrival += 1;
    }

    /// Ends the runs in the lanes of `failed`, where the equations of the step were not solved, and loads the
    /// next runs.
    #[cold]
    pub fn fail(&mut self, (failed, unsolved): (Bits, Unsolved), at: &Instants<'_, R>) -> Result {
        for lane in each(failed) {
            let watched = self.watched_now() >> lane & 1 != 0;
            let Some(last) = self.last(lane, watched, at) else { continue };
            let Some(run) = &self.batch.runs[lane] else { continue };
            let end = ending::unsolved(run.place.now(self.clock).0, self.h.lane(lane), unsolved);
            self.retire(at.system, lane, end, &last);
            self.load(lane, self.clock + 1)?;
        }
        self.schedule();
        Ok(())
    }

    /// Takes a step from the state `y`, evaluated as `now`, and the rows inside it, unless it is not solved.
    #[inline(always)]
    pub fn step<S: LoopSystem<R>>(
        &mut self,
        (system, method, keeps_jacobian): (&S, &mut (impl Integrator<R, S> + ?Sized), bool),
        (tau, now, y): (R, &Evaluation<R>, &States<R>),
        after: &mut States<R>,
    ) -> StepResult {
        let (drive, stats) = (&self.batch.drive, &mut self.batch.stats);
        let step = Step { system, drive, tau, h: self.h, y, rate: &now.rate, allowed: None };
        let jacobians = stats.jacobians;
        method.step(&step, after, stats)?;
        if keeps_jacobian {
            if stats.jacobians > jacobians {
                self.taken_at = Some(pack(tau, &now.motion));
            }
            self.in_use = self.taken_at.filter(|_| method.jacobian_is_reusable());
        }
        system.called().correct(drive, tau + self.h, after);
        if self.batch.next_time() < f64::INFINITY {
            self.inside.look_inside(&mut self.batch, self.clock, system.called(), (tau, y))?;
        }
        Ok(())
    }

    /// At a breakpoint, a method that keeps a Jacobian forgets it, or takes that of the run that this one resumes.
    #[cold]
    pub fn restart_jacobian<S: System<R>>(
        &mut self,
        system: &SceneEquations<R>,
        method: &mut (impl Integrator<R, S> + ?Sized),
    ) {
        method.restart();
        self.in_use = None;
        let Some(run) = &self.batch.runs[0] else { return };
        let Some(point) = run.scene.initial.linearized.filter(|_| run.place.segment.first > 0) else {
            return;
        };
        let (tau, motion) = unpacked(&point);
        method.take_jacobian(&self.batch.drive, R::constant(tau), &system.begin(&Motion::constant(&motion)));
        (self.in_use, self.taken_at) = (Some(point), Some(point));
    }
}

fn pack<R: Lanes>(tau: R, motion: &Motion<R>) -> Linearized {
    let mut point: Linearized = [tau.lane(0); _];
    point[1..].copy_from_slice(&motion.lane(0).row());
    point
}
