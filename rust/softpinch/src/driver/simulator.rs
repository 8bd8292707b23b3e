//! Runs that are stepped from outside, period by period, with inputs that are held in each of them.
//!
//! Each period is a run that goes on from the one before it, in equal steps. So n periods have the bits of one run
//! whose schedule steps at the same instants: both begin a segment there. At the end of a period the instant is watched
//! under the inputs of the period, as at the end of a run, and at the start of the next period under its inputs.

use std::borrow::Cow;
use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::driver::require_valid;
use crate::driver::threads::share;
use crate::error::{Error, Result, require, require_at_most};
use crate::formulation::{Contact, System};
use crate::model::{ContactModel, Held, Motion, Rule, Scene, State};
use crate::number::{MOST, inlined};
use crate::stepping::{
    ContactRun, Finished, Grid, Instant, LaneContact, LaneController, MOST_STEPS, Options, Recorder, Run,
    RunLoop, RunQueue, Span, Status, Steps, Taken, round_off,
};

/// Runs that are stepped from outside.
pub struct Simulator {
    how: Stepping,
    environments: Vec<Environment>,
    /// The runs in the period that is computed now.
    runs: Vec<PeriodRun>,
    /// Threads beside the caller's that wait for work, if there are any: periods take microseconds.
    pool: Option<ThreadPool>,
}

/// The options of all runs, and the lengths of their steps and of their periods, s.
struct Stepping {
    options: Options,
    dt: f64,
    period: f64,
}

impl Simulator {
    /// Runs of these scenes, each at its initial state. A period lasts `period`, s; the last one of a run ends with
    /// its duration. `threads` threads share the work of a step.
    pub fn new(scenes: Vec<Scene>, options: &Options, period: f64, threads: usize) -> Result<Self> {
        Rule::Positive.check("period", period)?;
        if scenes.is_empty() {
            return Err(Error::shape("n", "no scenes", "must be at least one"));
        }
        let Steps::Fixed(dt) = options.steps else {
            let found = format_args!("{:?}", options.steps);
            return Err(Error::shape("tolerance", found, "a simulator takes equal steps"));
        };
        let guard = scenes.iter().any(|scene| options.guards(scene));
        let how = Stepping { options: Options { guard, ..options.clone() }, dt, period };
        let mut environments: Vec<_> = scenes.into_iter().map(Environment::new).collect();
        for (run, environment) in environments.iter_mut().enumerate() {
            environment.begin(None, &how).map_err(|error| error.of_run(run))?;
        }
        let runs = environments.iter().map(|_| PeriodRun::default()).collect();
        // More threads than vectors of lanes have nothing to do.
        let threads = threads.min(environments.len().div_ceil(MOST));
        let pool = || {
            let pool = ThreadPoolBuilder::new().num_threads(threads - 1).build();
            pool.map_err(|error| Error::Threads { threads, reason: error.to_string() })
        };
        let pool = (threads > 1).then(pool).transpose()?;
        Ok(Self { how, environments, runs, pool })
    }

    inlined! {
        /// Number of runs.
        pub runs(&self) -> usize = self.environments.len();
        /// What was last seen of a run.
        pub observed(&self, run: usize) -> &Observed = &self.environments[run].observed;
        /// The scene of a run, whose initial state is the present one, from which another run can go on.
        pub scene(&self, run: usize) -> &Scene = &self.environments[run].scene;
        /// The end of the last period of a run, s, at which a violation may have kept the run from arriving.
        pub end(&self, run: usize) -> f64 = self.environments[run].until;
    }

    /// Puts a run back to its start, or to the start of another run from `state`. There is no external force
    /// from outside then. `check` says whether a state off the constraints is refused.
    pub fn reset(&mut self, run: usize, state: Option<(&State, bool)>) -> Result {
        self.environments[run].begin(state, &self.how)
    }

    /// Goes on from a state, at its time. The run's end and the external force stay.
    pub fn set_state(&mut self, run: usize, (state, check): (&State, bool)) -> Result {
        let environment = &mut self.environments[run];
        let span @ Span { start, end } = environment.span;
        let rule = "must be between the run's start and its end; reset with a state begins another run";
        require((start..=end).contains(&state.time), "State.time", state.time, rule)?;
        environment.place((state, check), span, &self.how)?;
        // Periods go on at the instants at which they would have begun anyway, if the state is at one of them.
        let period = self.how.period;
        let periods = ((state.time - environment.origin) / period).round();
        if periods >= 0.0 && periods * period + environment.origin == state.time {
            environment.periods = periods as u64;
        } else {
            (environment.origin, environment.periods) = (state.time, 0);
        }
        Ok(())
    }

    /// Sets the external force on the object, which is held from the next period on: F_x and F_y in N and the
    /// moment in N m, beside the disturbances of the scene.
    pub fn set_force(&mut self, run: usize, force: [f64; 3]) -> Result {
        for (name, value) in ["force[0]", "force[1]", "moment"].into_iter().zip(force) {
            Rule::Finite.check(name, value)?;
        }
        self.environments[run].force = force;
        Ok(())
    }

    /// Steps all runs that have not ended by one period, with these torques on the fingers in N m, or target
    /// angles in rad. `accelerations` has those of the hands in this period along fixed axes, m/s^2, or is empty: then
    /// each has that of its scene. Returns `false` if `interrupted` has stopped it; then nothing has
    /// changed. It is called every few milliseconds.
    pub fn step(
        &mut self,
        targets: &[[f64; 2]],
        accelerations: &[[f64; 2]],
        interrupted: &dyn Fn() -> bool,
    ) -> Result<bool> {
        let Self { how, environments, runs, .. } = self;
        let given = [("actions", targets), ("acceleration", accelerations)];
        for (name, rows) in given.into_iter().take(1 + usize::from(!accelerations.is_empty())) {
            if rows.len() != environments.len() {
                let found = format_args!("{} rows", rows.len());
                return Err(Error::shape(name, found, "must have one for each run"));
            }
            for (k, value) in rows.as_flattened().iter().enumerate() {
                Rule::Finite.check(format_args!("{name}[{}, {}]", k / 2, k % 2), *value)?;
            }
        }
        for (k, (environment, run)) in environments.iter_mut().zip(runs).enumerate() {
            run.outcome = None;
            if environment.observed.status.is_none() {
                run.end = environment.next(how.period);
                let (target, force) = (targets[k], environment.force);
                let acceleration = accelerations.get(k).copied();
                environment.scene.inputs.held = Some(Held { target, force, acceleration });
            }
        }
        self.compute(interrupted)?;
        let stopped = |run: &Run| run.status == Status::Interrupted;
        if self.runs.iter().any(|run| run.outcome.as_ref().is_some_and(stopped)) {
            return Ok(false);
        }
        for (environment, run) in self.environments.iter_mut().zip(&mut self.runs) {
            if let Some(outcome) = run.outcome.take() {
                environment.take(outcome, run.end);
            }
        }
        Ok(true)
    }

    /// Computes the period of all runs. The caller's thread does a part of the work beside those of the pool.
    fn compute(&mut self, interrupted: &dyn Fn() -> bool) -> Result {
        let Self { how, environments, runs, pool } = self;
        let Some(pool) = pool else { return compute_part(how, (environments, runs), interrupted) };
        // Whole vectors of lanes, as far as there are enough runs.
        let size = environments.len().div_ceil(pool.current_num_threads() + 1).next_multiple_of(MOST);
        let mut parts = environments.chunks(size).zip(runs.chunks_mut(size));
        let Some(own) = parts.next() else { return Ok(()) };
        let stop = AtomicBool::new(false);
        let stopped = || stop.load(Ordering::Relaxed);
        let stops = || {
            stop.fetch_or(interrupted(), Ordering::Relaxed);
            stopped()
        };
        let work = |part: Part<'_>| compute_part(how, part, &stopped);
        share(pool, parts, &stop, work, |results| {
            let found = compute_part(how, own, &stops);
            stop.fetch_or(found.is_err(), Ordering::Relaxed);
            results.iter().chain([found]).collect()
        })
    }
}

/// What is seen of a run at the end of a period.
#[derive(Debug, Clone, PartialEq)]
pub struct Observed {
    /// Time, s.
    pub t: f64,
    /// The motion.
    pub motion: Motion<f64>,
    /// Multipliers under the inputs of the period.
    pub multipliers: [f64; 4],
    /// The status with which the run has ended; `None` if it goes on.
    pub status: Option<Status>,
    /// The status in words; empty if the run goes on or has reached its end.
    pub message: String,
}

/// One run of a simulator. Its scene's initial state is the present one.
struct Environment {
    scene: Scene,
    /// The state from which a reset starts, and whether it is refused if it is off the constraints.
    start: (State, bool),
    force: [f64; 3],
    span: Span,
    /// Period k ends at `origin` + (k + 1) `period`; `periods` have passed.
    origin: f64,
    periods: u64,
    /// The end of the last period, s, at which a violation may have kept the run from arriving.
    until: f64,
    observed: Observed,
}

impl Environment {
    fn new(scene: Scene) -> Self {
        let State { time, motion, .. } = scene.initial;
        let observed =
            Observed { t: time, motion, multipliers: [0.0; 4], status: None, message: String::new() };
        let start = (scene.initial.clone(), scene.check);
        let span = Span { start: time, end: time + scene.duration };
        Self { scene, start, force: [0.0; 3], span, origin: time, periods: 0, until: time, observed }
    }

    /// Puts the run at its own start or at another one. Refuses a start that a run refuses, and steps that are too many
    /// or too short.
    fn begin(&mut self, start: Option<(&State, bool)>, how: &Stepping) -> Result {
        let own = self.start.clone();
        let (start, check) = start.unwrap_or((&own.0, own.1));
        let Self { scene, .. } = self;
        let span = Span::new(&scene.inputs, start, scene.duration)?;
        let first = Span { end: span.end.min(span.start + how.period), ..span };
        Grid::over(&scene.inputs, start, first, how.dt, how.options.refine)?;
        // There may not be more periods than a run can be divided into, and the clock must resolve them.
        let (needed, what) = ((span.end - span.start) / how.period, "the periods (duration / period)");
        require_at_most(what, needed, MOST_STEPS, "lengthen the period or shorten the run")?;
        let rule = "must be more than round-off of the times of the run";
        require(how.period > round_off(span.start, span.end), "period", how.period, rule)?;
        self.place((start, check), span, how)?;
        (self.origin, self.periods, self.force) = (start.time, 0, [0.0; 3]);
        Ok(())
    }

    fn next(&self, period: f64) -> f64 {
        let periods = (self.periods + 1) as f64; // far below 2^53
        let next = periods * period + self.origin;
        let end = self.span.end;
        // The rest of a duration that is a multiple of the period but for round-off is no period.
        let round_off = 1e-12 * period + 4.0 * f64::EPSILON * end.abs();
        if end - next <= round_off { end } else { next }
    }

    /// Goes on from a state in a run over this span. `check` says whether a state off the constraints is refused.
    /// The multipliers are those under the schedule's own inputs.
    fn place(&mut self, (state, check): (&State, bool), span: Span, how: &Stepping) -> Result {
        let Self { scene, .. } = self;
        scene.inputs.held = None;
        scene.check = check;
        let before = std::mem::replace(&mut scene.initial, state.clone());
        scene.inputs.start_controller(state.origin());
        // A period begins a segment, so that steps that a run took before in its own segment do not count.
        if let Some(grid) = &mut scene.initial.grid {
            *grid = (state.time, 0);
        }
        let found = require_valid(scene, &how.options).and_then(|()| multipliers(scene, how));
        let multipliers = found.inspect_err(|_| {
            scene.inputs.start_controller(before.origin());
            scene.initial = before;
        })?;
        let State { time: t, motion, .. } = *state;
        self.span = span;
        let status = (t >= span.end).then_some(Status::Completed);
        self.observed = Observed { t, motion, multipliers, status, message: String::new() };
        Ok(())
    }

    /// Takes the run of a period that ended at `until`.
    fn take(&mut self, Run { status, message, last, controller, .. }: Run, until: f64) {
        let Instant { t, motion, multipliers, contact, .. } = last;
        let initial = &mut self.scene.initial;
        (initial.time, initial.motion, initial.contact) = (t, motion, contact);
        initial.controller = controller;
        initial.grid = Some((t, 0));
        initial.linearized = None;
        self.periods += 1;
        self.until = until;
        let goes_on = status == Status::Completed && until < self.span.end;
        let status = if goes_on { None } else { Some(status) };
        self.observed = Observed { t, motion, multipliers, status, message };
    }
}

fn multipliers(scene: &Scene, Stepping { options, dt, .. }: &Stepping) -> Result<[f64; 4]> {
    let equations = options.runs(scene).system::<f64>();
    let State { time, motion, .. } = scene.initial;
    let mut drive = scene.inputs.segment(time);
    if let Some(controller) = LaneController::new(scene)? {
        drive.hold(controller.held());
    }
    if options.contact == ContactModel::Unilateral {
        let Some(row) = &scene.initial.contact else {
            return LaneContact::multipliers(options, scene, drive, *dt);
        };
        ContactRun::new(Contact::of_row(row)?).put_into(&mut drive.contacts, 0);
    }
    let y = equations.begin(&motion);
    Ok(equations.evaluate(&drive, 0.0, &y).multipliers)
}

#[derive(Default)]
struct PeriodRun {
    end: f64,
    outcome: Option<Run>,
    /// In unilateral contact, its contacts, whose equations do not change.
    contact: Option<Box<LaneContact>>,
}

/// Some of the runs of a simulator, for one thread.
type Part<'a> = (&'a [Environment], &'a mut [PeriodRun]);

/// Computes the period of some runs. A single run takes the code of lone runs.
fn compute_part(
    Stepping { options, dt, .. }: &Stepping,
    (environments, runs): Part<'_>,
    stops: &dyn Fn() -> bool,
) -> Result {
    // The grid, the source and the destination of a loop use them by turns.
    let runs = RefCell::new(runs);
    let grid = |number: usize, Scene { inputs, initial, .. }: &Scene| {
        let span = Span { start: initial.time, end: runs.borrow()[number].end };
        Grid::over(inputs, initial, span, *dt, options.refine)
    };
    let mut under_way =
        (0..).zip(environments).filter(|(_, environment)| environment.observed.status.is_none());
    let mut finish = |Finished { number, run, contact }: Finished| {
        let own = &mut runs.borrow_mut()[number];
        (own.outcome, own.contact) = (Some(run), contact);
    };
    let mut take = || {
        let next = under_way.next();
        Ok(next.map(|(number, environment)| Taken {
            number,
            scene: Cow::Borrowed(&environment.scene),
            contact: runs.borrow_mut()[number].contact.take(),
        }))
    };
    let queue = RunQueue { take: &mut take, stops, finish: &mut finish, recorder: Recorder::default() };
    let Some(Environment { scene, .. }) = environments.first() else { return Ok(()) };
    let runs = RunLoop { queue, grid: &grid, options, scene };
    if environments.len() == 1 { runs.alone() } else { runs.in_lanes() }
}
