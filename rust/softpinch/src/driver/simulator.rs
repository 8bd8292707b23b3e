//! Runs that are stepped from outside, period by period, with inputs that are held in each of them.
//!
//! Each period is a run that goes on from the one before it, in equal steps. So n periods have the bits of one run
//! whose schedule steps at the same instants: both begin a segment there. At the end of a period the instant is
//! watched under the inputs of the period, as at the end of a run, and at the start of the next period under its
//! inputs.

use rayon::ThreadPool;

pub use crate::driver::environment::Observed;
use crate::driver::environment::{Environment, Outcome};
use crate::driver::period::{PeriodRun, compute};
use crate::driver::threads::waiting;
use crate::error::Error;
use crate::model::inputs::Held;
use crate::model::rule::Rule;
use crate::model::scene::Scene;
use crate::model::start::State;
use crate::number::lanes::MOST;
use crate::stepping::grid::Span;
use crate::stepping::options::{Options, Steps};
use crate::stepping::status::Status;

/// Runs that are stepped from outside.
pub struct Simulator {
    options: Options,
    dt: f64,
    period: f64,
    environments: Vec<Environment>,
    /// The runs in the period that is computed now.
    runs: Vec<PeriodRun>,
    /// Threads beside the caller's, if there are any.
    pool: Option<ThreadPool>,
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
            let (found, rule) = (format!("{:?}", options.steps), "a simulator takes equal steps");
            return Err(Error::Shape { field: "tolerance".to_owned(), found, rule });
        };
        let guard = scenes.iter().any(|scene| options.may_be_unstable(scene));
        let options = &Options { guard, ..options.clone() };
        let mut environments = Vec::with_capacity(scenes.len());
        for (run, scene) in scenes.into_iter().enumerate() {
            let mut environment = Environment::new(scene);
            let (start, check) = environment.start.clone();
            environment.begin((&start, check), options, (dt, period)).map_err(|error| error.of_run(run))?;
            environments.push(environment);
        }
        let runs = environments.iter().map(|_| PeriodRun::default()).collect();
        // More threads than vectors of lanes have nothing to do.
        let threads = threads.min(environments.len().div_ceil(MOST));
        let pool = (threads > 1).then(|| waiting(threads - 1)).transpose()?;
        Ok(Self { options: options.clone(), dt, period, environments, runs, pool })
    }

    /// Number of runs.
    pub fn runs(&self) -> usize {
        self.environments.len()
    }

    /// What was last seen of a run.
    pub fn observed(&self, run: usize) -> &Observed {
        &self.environments[run].observed
    }

    /// The present state of a run, from which another one can go on.
    pub fn state(&self, run: usize) -> &State {
        &self.environments[run].scene.initial
    }

    /// The end of the last period of a run, s, at which a violation may have kept the run from arriving.
    pub fn end(&self, run: usize) -> f64 {
        self.environments[run].until
    }

    /// Puts a run back to its start, or to the start of another run from `state`. There is no external force
    /// from outside then. `check` says whether a state off the constraints is refused.
    pub fn reset(&mut self, run: usize, state: Option<(&State, bool)>) -> Result<(), Error> {
        let Self { options, dt, period, environments, .. } = self;
        let environment = &mut environments[run];
        let (start, check) = environment.start.clone();
        environment.begin(state.unwrap_or((&start, check)), options, (*dt, *period))
    }

    /// Goes on from a state, at its time. The run's end and the external force stay.
    pub fn set_state(&mut self, run: usize, (state, check): (&State, bool)) -> Result<(), Error> {
        let Self { options, dt, period, environments, .. } = self;
        let environment = &mut environments[run];
        let span @ Span { start, end } = environment.span;
        if !(start..=end).contains(&state.time) {
            let rule = "must be between the run's start and its end; reset with a state begins another run";
            return Err(Error::Field { field: "State.time".to_owned(), value: state.time, rule });
        }
        environment.place((state, check), span, options, *dt)?;
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
    /// angles in rad. `accelerations` has those of the hands in this period along fixed axes, m/s^2, or is empty: then
    /// each has that of its scene. Returns `false` if `interrupted` has stopped it; then nothing has
    /// changed. It is called every few milliseconds.
    pub fn step(
        &mut self,
        targets: &[[f64; 2]],
        accelerations: &[[f64; 2]],
        interrupted: &dyn Fn() -> bool,
    ) -> Result<bool, Error> {
        let Self { options, dt, period, environments, runs, pool } = self;
        let given = [("actions", targets), ("acceleration", accelerations)];
        for (name, rows) in given.into_iter().take(1 + usize::from(!accelerations.is_empty())) {
            if rows.len() != environments.len() {
                let (found, rule) = (format!("{} rows", rows.len()), "must have one for each run");
                return Err(Error::Shape { field: name.to_owned(), found, rule });
            }
            for (k, value) in rows.as_flattened().iter().enumerate() {
                Rule::Finite.check_named(|| format!("{name}[{}, {}]", k / 2, k % 2), *value)?;
            }
        }
        for (k, (environment, run)) in environments.iter_mut().zip(&mut *runs).enumerate() {
            run.outcome = None;
            if environment.observed.status.is_none() {
                run.end = environment.next(*period);
                let (target, force) = (targets[k], environment.force);
                let acceleration = accelerations.get(k).copied();
                environment.scene.inputs.hold(Some(Held { target, force, acceleration }));
            }
        }
        compute((options, *dt), environments, runs, pool.as_ref(), interrupted)?;
        let stopped = |outcome: &Outcome| outcome.status == Status::Interrupted;
        if runs.iter().any(|run| run.outcome.as_ref().is_some_and(stopped)) {
            return Ok(false);
        }
        for (environment, run) in environments.iter_mut().zip(runs) {
            if let Some(outcome) = run.outcome.take() {
                environment.take(outcome, run.end);
            }
        }
        Ok(true)
    }
}
