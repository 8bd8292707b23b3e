//! Runs that are stepped from outside, period by period, with inputs that are held in each of them.
//!
//! Each period is a run that goes on from the one before it, in equal steps. So n periods have the bits of one run
//! whose schedule steps at the same instants: both begin a segment there. At the end of a period the instant is
//! watched under the inputs of the period, as at the end of a run, and at the start of the next period under its
//! inputs.

use std::borrow::Cow;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::driver::lanes::in_lanes;
use crate::driver::queue::LaneRuns;
use crate::driver::simulate::{advance, require_sound};
use crate::error::Error;
use crate::formulation::scene_equations::SceneEquations;
use crate::formulation::system::System;
use crate::model::contact_modes::ContactModel;
use crate::model::inputs::Held;
use crate::model::motion::Motion;
use crate::model::rule::Rule;
use crate::model::scene::Scene;
use crate::model::start::State;
use crate::number::lanes::MOST;
use crate::stepping::contact_lane::LaneContact;
use crate::stepping::grid::{Grid, MOST_STEPS, Span, round_off};
use crate::stepping::options::{Options, Steps};
use crate::stepping::queue::Finished;
use crate::stepping::record::Instant;
use crate::stepping::status::Status;

/// What is seen of a run at the end of a period.
#[derive(Debug, Clone, PartialEq)]
pub struct Observed {
    /// Time, s.
    pub t: f64,
    /// Coordinates.
    pub q: [f64; 9],
    /// Velocities.
    pub p: [f64; 9],
    /// Multipliers under the inputs of the period.
    pub multipliers: [f64; 4],
    /// The status with which the run has ended; `None` if it goes on.
    pub status: Option<Status>,
    /// The status in words; empty if the run goes on or has reached its end.
    pub message: String,
}

/// One run of a simulator. Its scene's initial state is the present one.
#[derive(Debug, Clone)]
struct Environment {
    scene: Scene,
    /// The state from which a reset starts, and the external force from outside.
    start: State,
    force: [f64; 3],
    /// Start and end of the run, s.
    span: Span,
    /// Period k ends at `origin` + (k + 1) `period`; `periods` have passed.
    origin: f64,
    periods: u64,
    observed: Observed,
}

/// The result of a period.
#[derive(Debug, Clone)]
struct Outcome {
    status: Status,
    message: String,
    instant: Instant,
}

/// Runs that are stepped from outside.
pub struct Simulator {
    options: Options,
    dt: f64,
    period: f64,
    environments: Vec<Environment>,
    /// The ends of the period that is computed now, s, and its results.
    ends: Vec<f64>,
    outcomes: Vec<Option<Outcome>>,
    /// In unilateral contact, the contacts of each run, whose equations do not change.
    contacts: Vec<Option<Box<LaneContact>>>,
    pool: Option<ThreadPool>,
}

impl Environment {
    fn new(scene: Scene) -> Self {
        let State { time, q, p, .. } = scene.initial;
        let observed =
            Observed { t: time, q, p, multipliers: [0.0; 4], status: None, message: String::new() };
        let (start, span) = (scene.initial.clone(), Span { start: time, end: time + scene.duration });
        Self { scene, start, force: [0.0; 3], span, origin: time, periods: 0, observed }
    }

    /// Puts the run at its start. Refuses a start that a run refuses, and steps that are too many or too short.
    fn begin(&mut self, start: &State, options: &Options, (dt, period): (f64, f64)) -> Result<(), Error> {
        let Self { scene, .. } = self;
        let span = Span::new(&scene.inputs, start, scene.duration)?;
        let refine = options.refine;
        Grid::over(
            &scene.inputs,
            start,
            Span { end: span.end.min(span.start + period), ..span },
            dt,
            refine,
        )?;
        require_periods(span, period)?;
        self.place(start, span, options, dt)?;
        (self.origin, self.periods, self.force) = (start.time, 0, [0.0; 3]);
        Ok(())
    }

    /// The end of the next period.
    fn next(&self, period: f64) -> f64 {
        #[allow(clippy::cast_precision_loss)] // far below 2^53
        let periods = (self.periods + 1) as f64;
        let next = periods * period + self.origin;
        let end = self.span.end;
        // The rest of a duration that is a multiple of the period but for round-off is no period.
        let round_off = 1e-12 * period + 4.0 * f64::EPSILON * end.abs();
        if end - next <= round_off { end } else { next }
    }

    /// Goes on from a state in a run over this span. The multipliers are those under the schedule's own inputs.
    fn place(&mut self, state: &State, span: Span, options: &Options, dt: f64) -> Result<(), Error> {
        let Self { scene, .. } = self;
        scene.inputs.hold(None);
        let before = std::mem::replace(&mut scene.initial, state.clone());
        // A period begins a segment, so that steps that a run took before in its own segment do not count.
        if let Some(grid) = &mut scene.initial.grid {
            *grid = (state.time, 0);
        }
        let found = require_sound(scene, options).and_then(|()| multipliers(scene, options, dt));
        let multipliers = found.inspect_err(|_| scene.initial = before)?;
        let State { time: t, q, p, .. } = *state;
        self.span = span;
        let status = (t >= span.end).then_some(Status::Completed);
        self.observed = Observed { t, q, p, multipliers, status, message: String::new() };
        Ok(())
    }

    /// Takes the result of a period that ended at `until`.
    fn take(&mut self, outcome: Outcome, until: f64) {
        let Outcome { status, message, instant } = outcome;
        let Instant { t, q, p, memory, multipliers, contact, .. } = instant;
        let initial = &mut self.scene.initial;
        (initial.time, initial.q, initial.p, initial.memory, initial.contact) = (t, q, p, memory, contact);
        initial.grid = Some((t, 0));
        initial.linearized = None;
        self.periods += 1;
        let goes_on = status == Status::Completed && until < self.span.end;
        let status = if goes_on { None } else { Some(status) };
        self.observed = Observed { t, q, p, multipliers, status, message };
    }
}

/// Refuses more periods than a run can be divided into, and periods that the clock does not resolve.
fn require_periods(Span { start, end }: Span, period: f64) -> Result<(), Error> {
    let needed = (end - start) / period;
    if needed > MOST_STEPS {
        return Err(Error::TooLarge {
            what: "the periods (duration / period)",
            needed,
            limit: MOST_STEPS,
            advice: "lengthen the period or shorten the run",
        });
    }
    if period <= round_off(start, end) {
        let rule = "must be more than round-off of the times of the run";
        return Err(Error::Field { field: "period".to_owned(), value: period, rule });
    }
    Ok(())
}

/// The multipliers at the initial state of a scene.
fn multipliers(scene: &Scene, options: &Options, dt: f64) -> Result<[f64; 4], Error> {
    let instructions = options.simd.require()?;
    let choice = options.choice(scene.inputs.fingers());
    let equations =
        SceneEquations::<f64>::new(instructions, choice, &scene.parameters, &options.stabilization);
    let State { time, q, p, memory, .. } = scene.initial;
    let mut drive = scene.inputs.segment(time);
    if options.contact == ContactModel::Unilateral {
        if scene.initial.contact.is_none() {
            return LaneContact::first_multipliers(instructions, options, scene, drive, dt);
        }
        LaneContact::new(instructions, options, scene, time)?.put_into(&mut drive.contacts, 0);
    }
    let y = equations.begin(&Motion { q, p, memory });
    Ok(equations.evaluate(&drive, 0.0, &y).multipliers)
}

/// Some of the runs during a period.
struct Part<'a> {
    /// Number of the first run, and the runs from there on.
    first: usize,
    environments: &'a [Environment],
    outcomes: &'a mut [Option<Outcome>],
    contacts: &'a mut [Option<Box<LaneContact>>],
}

impl<'a> Part<'a> {
    /// The runs for one thread, which computes them until `stops` says so.
    fn until<'b>(self, stops: &'b dyn Fn() -> bool) -> Chunk<'b>
    where
        'a: 'b,
    {
        let Self { first, environments, outcomes, contacts } = self;
        Chunk { first, environments, outcomes, contacts, next: 0, stops }
    }
}

/// Some of the runs during a period, for one thread.
struct Chunk<'a> {
    /// Number of the first run, and the runs from there on.
    first: usize,
    environments: &'a [Environment],
    outcomes: &'a mut [Option<Outcome>],
    contacts: &'a mut [Option<Box<LaneContact>>],
    next: usize,
    stops: &'a dyn Fn() -> bool,
}

impl<'a> Chunk<'a> {
    /// The next run that has not ended.
    fn next(&mut self) -> Option<(usize, &'a Scene)> {
        let environments = self.environments;
        let goes_on = |environment: &Environment| environment.observed.status.is_none();
        let place = self.next + environments[self.next..].iter().position(goes_on)?;
        self.next = place + 1;
        Some((self.first + place, &environments[place].scene))
    }

    fn note(&mut self, number: usize, outcome: Outcome) {
        self.outcomes[number - self.first] = Some(outcome);
    }
}

impl<'a> LaneRuns<'a> for Chunk<'a> {
    fn take(&mut self) -> Result<Option<(usize, Cow<'a, Scene>)>, Error> {
        Ok(self.next().map(|(number, scene)| (number, Cow::Borrowed(scene))))
    }

    fn take_contact(&mut self) -> Option<Box<LaneContact>> {
        self.contacts[self.next - 1].take()
    }

    fn stops(&mut self) -> bool {
        (self.stops)()
    }

    fn finish(&mut self, Finished { number, status, message, last, contact, .. }: Finished) {
        self.contacts[number - self.first] = contact;
        self.note(number, Outcome { status, message, instant: last.instant });
    }
}

/// The steps that all runs take.
#[derive(Clone, Copy)]
struct Period<'a> {
    options: &'a Options,
    dt: f64,
    ends: &'a [f64],
}

impl<'a> Period<'a> {
    fn grid(&self, number: usize, Scene { inputs, initial, .. }: &Scene) -> Result<Grid, Error> {
        let span = Span { start: initial.time, end: self.ends[number] };
        Grid::over(inputs, initial, span, self.dt, self.options.refine)
    }

    /// Computes the period of the runs in a chunk. A single run, and a method whose steps have no lanes, take
    /// the code of lone runs.
    fn compute<'b>(self, mut chunk: Chunk<'b>) -> Result<(), Error>
    where
        'a: 'b,
    {
        let Self { options, .. } = self;
        if let [first, _, ..] = chunk.environments {
            let choice = options.choice(first.scene.inputs.fingers());
            let grid = |number, scene: &Scene| self.grid(number, scene);
            if in_lanes(&mut chunk, &grid, options, choice)?.is_some() {
                return Ok(());
            }
        }
        while let Some((number, scene)) = chunk.next() {
            let place = number - chunk.first;
            let grid = self.grid(number, scene)?;
            let kept = (scene, chunk.contacts[place].take());
            let (run, contact) = advance(kept, options, grid, chunk.stops)?;
            chunk.contacts[place] = contact;
            chunk.note(number, Outcome { status: run.status, message: run.message, instant: run.last });
        }
        Ok(())
    }
}

impl Simulator {
    /// Runs of these scenes, each at its initial state. A period lasts `period`, s; the last one of a run ends with
    /// its duration. `threads` threads share the work of a step.
    pub fn new(scenes: Vec<Scene>, options: &Options, period: f64, threads: usize) -> Result<Self, Error> {
        Rule::Positive.check("period", period)?;
        if scenes.is_empty() {
            let found = "no scenes".to_owned();
            return Err(Error::Shape { field: "n".to_owned(), found, rule: "must be at least one" });
        }
        let Steps::Fixed(dt) = options.steps else {
            return Err(Error::Shape {
                field: "tolerance".to_owned(),
                found: format!("{:?}", options.steps),
                rule: "a simulator takes equal steps",
            });
        };
        let mut environments = Vec::with_capacity(scenes.len());
        for (run, scene) in scenes.into_iter().enumerate() {
            let refused = |error| Error::Run { run, error: Box::new(error) };
            let mut environment = Environment::new(scene);
            let start = environment.start.clone();
            environment.begin(&start, options, (dt, period)).map_err(refused)?;
            environments.push(environment);
        }
        let (ends, outcomes) = (vec![0.0; environments.len()], vec![None; environments.len()]);
        // More threads than vectors of lanes have nothing to do.
        let pool = pool(threads.min(environments.len().div_ceil(MOST)))?;
        let contacts = environments.iter().map(|_| None).collect();
        Ok(Self { options: options.clone(), dt, period, environments, ends, outcomes, contacts, pool })
    }

    /// Number of runs.
    #[must_use]
    pub fn runs(&self) -> usize {
        self.environments.len()
    }

    /// What was last seen of a run.
    #[must_use]
    pub fn observed(&self, run: usize) -> &Observed {
        &self.environments[run].observed
    }

    /// The present state of a run, from which another one can go on.
    #[must_use]
    pub fn state(&self, run: usize) -> &State {
        &self.environments[run].scene.initial
    }

    /// The end of the last period of a run, s, at which a violation may have kept the run from arriving.
    #[must_use]
    pub fn end(&self, run: usize) -> f64 {
        self.ends[run]
    }

    /// Puts a run back to its start, or to the start of another run from `state`. There is no external force
    /// from outside then. `check` says whether a state off the constraints is refused.
    pub fn reset(&mut self, run: usize, state: Option<(&State, bool)>) -> Result<(), Error> {
        let Self { options, dt, period, environments, .. } = self;
        let environment = &mut environments[run];
        let Some((state, check)) = state else {
            let start = environment.start.clone();
            return environment.begin(&start, options, (*dt, *period));
        };
        let before = std::mem::replace(&mut environment.scene.check, check);
        let begun = environment.begin(state, options, (*dt, *period));
        environment.scene.check = before;
        begun
    }

    /// Goes on from a state, at its time. The run's end and the external force stay.
    pub fn set_state(&mut self, run: usize, (state, check): (&State, bool)) -> Result<(), Error> {
        let Self { options, dt, period, environments, .. } = self;
        let environment = &mut environments[run];
        let span @ Span { start, end } = environment.span;
        if !(start..=end).contains(&state.time) {
            return Err(Error::Field {
                field: "State.time".to_owned(),
                value: state.time,
                rule: "must be between the run's start and its end; reset with a state begins another run",
            });
        }
        let before = std::mem::replace(&mut environment.scene.check, check);
        let placed = environment.place(state, span, options, *dt);
        environment.scene.check = before;
        placed?;
        // Periods go on at the instants at which they would have begun anyway, if the state is at one of them.
        let periods = ((state.time - environment.origin) / *period).round();
        if periods >= 0.0 && periods * *period + environment.origin == state.time {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a whole number
            (environment.periods = periods as u64);
        } else {
            (environment.origin, environment.periods) = (state.time, 0);
        }
        Ok(())
    }

    /// Sets the external force on the object, which is held from the next period on: F_x and F_y in N and the
    /// moment in N m, beside the disturbances of the scene.
    pub fn set_force(&mut self, run: usize, force: [f64; 3]) -> Result<(), Error> {
        for (name, value) in ["force[0]", "force[1]", "moment"].into_iter().zip(force) {
            Rule::Finite.check(name, value)?;
        }
        self.environments[run].force = force;
        Ok(())
    }

    /// Steps all runs that have not ended by one period, with these torques on the fingers in N m, or target
    /// angles in rad. Returns `false` if `interrupted` has stopped it; then nothing has
    /// changed. It is called every few milliseconds.
    pub fn step(&mut self, targets: &[[f64; 2]], interrupted: &dyn Fn() -> bool) -> Result<bool, Error> {
        let Self { options, dt, period, environments, ends, outcomes, contacts, pool } = self;
        if targets.len() != environments.len() {
            return Err(Error::Shape {
                field: "actions".to_owned(),
                found: format!("{} rows", targets.len()),
                rule: "must have one for each run",
            });
        }
        for (k, value) in targets.as_flattened().iter().enumerate() {
            Rule::Finite.check_named(|| format!("actions[{}, {}]", k / 2, k % 2), *value)?;
        }
        let running = environments.iter_mut().zip(&mut *ends).zip(targets);
        for ((environment, end), &target) in running.filter(|((run, _), _)| run.observed.status.is_none()) {
            *end = environment.next(*period);
            let force = environment.force;
            environment.scene.inputs.hold(Some(Held { target, force }));
        }
        outcomes.fill(None);
        let task = Period { options, dt: *dt, ends };
        compute(task, environments, (outcomes, contacts), pool.as_ref(), interrupted)?;
        let stopped = |outcome: &Option<Outcome>| {
            outcome.as_ref().is_some_and(|outcome| outcome.status == Status::Interrupted)
        };
        if outcomes.iter().any(stopped) {
            return Ok(false);
        }
        for ((environment, end), outcome) in environments.iter_mut().zip(&*ends).zip(outcomes) {
            if let Some(outcome) = outcome.take() {
                environment.take(outcome, *end);
            }
        }
        Ok(true)
    }
}

/// Computes the period of all runs. The caller's thread does a part of the work.
fn compute(
    task: Period<'_>,
    environments: &[Environment],
    (outcomes, contacts): (&mut [Option<Outcome>], &mut [Option<Box<LaneContact>>]),
    pool: Option<&ThreadPool>,
    interrupted: &dyn Fn() -> bool,
) -> Result<(), Error> {
    let threads = pool.map_or(1, |pool| pool.current_num_threads() + 1);
    // Whole vectors of lanes, as far as there are enough runs.
    let size = environments.len().div_ceil(threads).next_multiple_of(MOST);
    let all = environments.chunks(size).zip(outcomes.chunks_mut(size)).zip(contacts.chunks_mut(size));
    let mut parts = all.enumerate().map(|(k, ((environments, outcomes), contacts))| Part {
        first: k * size,
        environments,
        outcomes,
        contacts,
    });
    let Some(own) = parts.next() else { return Ok(()) };
    let Some(pool) = pool else {
        return task.compute(own.until(interrupted));
    };
    let (stop, failed) = (AtomicBool::new(false), OnceLock::new());
    let found = pool.in_place_scope(|scope| {
        for part in parts {
            let (stop, failed) = (&stop, &failed);
            scope.spawn(move |_| {
                let stops = || stop.load(Ordering::Relaxed);
                if let Err(error) = task.compute(part.until(&stops)) {
                    // One error is enough.
                    let _ = failed.set(error);
                }
            });
        }
        let stops = || {
            let stops = interrupted();
            stop.fetch_or(stops, Ordering::Relaxed);
            stops
        };
        task.compute(own.until(&stops))
    });
    failed.into_inner().map_or(found, Err)
}

/// Threads that wait for work beside the caller's; `None` if there are none.
fn pool(threads: usize) -> Result<Option<ThreadPool>, Error> {
    if threads < 2 {
        return Ok(None);
    }
    let pool = ThreadPoolBuilder::new().num_threads(threads - 1).build();
    pool.map(Some).map_err(|error| Error::Threads { threads, reason: error.to_string() })
}
