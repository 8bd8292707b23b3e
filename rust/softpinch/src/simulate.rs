//! One run: segment by segment, watched and recorded, from a state to a state that it can go on from.

use std::marker::PhantomData;

use crate::dynamics::Plant;
use crate::energy::{LedgerRow, WORKS};
use crate::error::Error;
use crate::formulation::csm::{self, Csm};
use crate::formulation::nullspace::{self, Nullspace};
use crate::formulation::projected::Projected;
use crate::formulation::{Evaluation, Formulation, Motion, System};
use crate::grid::{Segment, segments};
use crate::inputs::{Drive, Inputs};
use crate::integrator::dop853::Dop853;
use crate::integrator::rk4::Rk4;
use crate::integrator::{Integrator, Method};
use crate::monitor::{Monitor, STOPPABLE, Set, Violation};
use crate::parameters::{Parameters, Stabilization};
use crate::record::{Instant, Recording, Selection};
use crate::simd::{Kernel, Level, dispatch};
use crate::start::{State, require_consistent};

/// How often the step loop asks whether it should stop: every so many steps, a few milliseconds.
const POLL: u32 = 1 << 14;

/// What is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The physics.
    pub parameters: Parameters,
    /// Schedule and disturbances.
    pub inputs: Inputs,
    /// Where it starts.
    pub initial: State,
    /// Whether a start off the constraints is refused.
    pub check: bool,
    /// How long it runs from there, s.
    pub duration: f64,
}

/// How it is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Longest step, s.
    pub dt: f64,
    /// How time is stepped.
    pub method: Method,
    /// How the constraints are kept.
    pub formulation: Formulation,
    /// Gains of (19) and (20).
    pub stabilization: Stabilization,
    /// What is kept.
    pub record: Selection,
    /// Every how many steps it is kept; the last instant always is.
    pub every: u64,
    /// Violations that end the run.
    pub stop_on: Set,
    /// Instructions to use.
    pub simd: Level,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            dt: 1e-4,
            method: Method::Rk4,
            formulation: Formulation::Csm,
            stabilization: Stabilization { alpha: 1000.0, beta: 1000.0 },
            record: Selection { state: true, ..Selection::default() },
            every: 1,
            stop_on: STOPPABLE.iter().map(|&(_, violation)| violation).collect(),
            simd: Level::detect(),
        }
    }
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// It reached the end.
    Completed,
    /// A tip left the object.
    Separated,
    /// A tip was pressed flat.
    Crushed,
    /// A tip was tilted by 90 degrees.
    Folded,
    /// A number overflowed.
    NotFinite,
    /// The caller stopped it.
    Interrupted,
}

impl Status {
    /// That of a run which a violation ends.
    fn of(violation: Violation) -> Self {
        match violation {
            Violation::Separated => Self::Separated,
            Violation::Crushed => Self::Crushed,
            _ => Self::Folded,
        }
    }

    /// Its public name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Separated => "separated",
            Self::Crushed => "crushed",
            Self::Folded => "folded",
            Self::NotFinite => "not_finite",
            Self::Interrupted => "interrupted",
        }
    }
}

/// Counted work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stats {
    /// Steps taken.
    pub steps: u64,
    /// Evaluations of the right-hand side.
    pub evaluations: u64,
    /// Stretches between breakpoints.
    pub segments: u64,
}

/// A finished run.
#[derive(Debug, Clone)]
pub struct Run {
    /// What was asked for.
    pub recording: Recording,
    /// The last instant, whatever was recorded.
    pub last: Instant,
    /// How it ended.
    pub status: Status,
    /// The same in words, with the numbers.
    pub message: String,
    /// What the monitors saw, with the first time.
    pub violations: Vec<(&'static str, f64)>,
    /// Counted work.
    pub stats: Stats,
}

/// Advice on a step that the stabilisation's gains do not allow (`None` where they do).
#[must_use]
pub fn stability_warning(options: &Options, longest: f64) -> Option<String> {
    if options.formulation != Formulation::Csm {
        return None;
    }
    let limit = options.method.real_stability_limit()?;
    let Stabilization { alpha, beta } = options.stabilization;
    let (name, gain) = if alpha >= beta { ("alpha", alpha) } else { ("beta", beta) };
    (gain * longest > limit).then(|| {
        format!(
            "{name} * dt = {:.4} is beyond {:.4}, where {} stops damping the constraint \
             stabilisation's own modes: take dt <= {:.3e} s, or {name} <= {:.4e} 1/s, or formulation \
             \"nullspace\", which has no gains",
            gain * longest,
            limit,
            options.method.name(),
            limit / gain,
            limit / longest,
        )
    })
}

/// Simulates a scene. `interrupted` is asked every few milliseconds whether to stop. Advice on stability comes with the
/// run; bad input is the only error.
pub fn simulate(
    scene: &Scene,
    options: &Options,
    interrupted: &dyn Fn() -> bool,
) -> Result<(Run, Option<String>), Error> {
    if options.every == 0 {
        return Err(Error::Field { field: "every".to_owned(), value: 0.0, rule: "must be at least 1" });
    }
    for ((name, rule), value) in Stabilization::FIELDS.iter().zip(options.stabilization.fields()) {
        rule.check(format!("stabilization.{name}"), value)?;
    }
    let initial = &scene.initial;
    // Only the stabilisation can lead back to the constraints.
    if scene.check || options.formulation != Formulation::Csm {
        require_consistent(&scene.parameters, &initial.q, &initial.p)?;
    }
    let segments = segments(&scene.inputs, initial, scene.duration, options.dt)?;
    let steps: u64 = segments.iter().map(|segment| segment.count - segment.first).sum();
    let rows = steps / options.every + 2;
    let recording = Recording::with_capacity(options.record, rows)?;
    let longest = segments.iter().map(|segment| segment.h).fold(0.0, f64::max);
    let warning = stability_warning(options, longest);

    let controllers = scene.parameters.control.map(|gains| gains.lift());
    let plant = Plant::new(&scene.parameters, controllers);
    let job = Job { scene, options, segments: &segments, interrupted };
    let run = match options.formulation {
        Formulation::Csm => {
            let system = Csm::new(plant, &options.stabilization);
            job.run::<_, { csm::STATES }, { csm::STATES_WITH_LEDGER }>(&system, recording)
        }
        Formulation::Projected => {
            let system = Projected::new(plant);
            job.run::<_, { csm::STATES }, { csm::STATES_WITH_LEDGER }>(&system, recording)
        }
        Formulation::Nullspace => {
            let system = Nullspace::new(plant);
            job.run::<_, { nullspace::STATES }, { nullspace::STATES_WITH_LEDGER }>(&system, recording)
        }
    };
    Ok((run, warning))
}

/// What a run needs to know.
#[derive(Clone, Copy)]
struct Job<'a> {
    scene: &'a Scene,
    options: &'a Options,
    segments: &'a [Segment],
    interrupted: &'a dyn Fn() -> bool,
}

impl Job<'_> {
    /// Runs a system that has `N` states, or `M` with the ledger.
    fn run<S, const N: usize, const M: usize>(self, system: &S, recording: Recording) -> Run
    where
        S: System<f64, N> + System<f64, M>,
    {
        if self.options.record.energy {
            self.step_through::<S, M>(system, recording)
        } else {
            self.step_through::<S, N>(system, recording)
        }
    }

    fn step_through<S: System<f64, N>, const N: usize>(self, system: &S, recording: Recording) -> Run {
        let level = self.options.simd;
        match self.options.method {
            Method::Rk4 => dispatch(level, Stepping::<S, Rk4, N>::new(self, system, recording)),
            Method::Dop853 => dispatch(level, Stepping::<S, Dop853, N>::new(self, system, recording)),
        }
    }
}

/// The step loop, compiled once for each level of instructions.
struct Stepping<'a, S, I, const N: usize> {
    job: Job<'a>,
    system: &'a S,
    recording: Recording,
    method: PhantomData<I>,
}

impl<'a, S, I, const N: usize> Stepping<'a, S, I, N> {
    fn new(job: Job<'a>, system: &'a S, recording: Recording) -> Self {
        Self { job, system, recording, method: PhantomData }
    }
}

#[cold]
fn overflow_message(from: f64) -> String {
    format!(
        "a number overflowed in the step from t = {from} s; the last row is the last finite instant. A smaller dt or a \
         less extreme scene may help"
    )
}

#[cold]
fn interruption_message(t: f64) -> String {
    format!("stopped from outside at t = {t} s; run.state(-1) goes on from there")
}

/// Everything that a run carries from step to step beside its state.
struct Observer {
    stop_on: Set,
    every: u64,
    until_record: u64,
    monitor: Monitor,
    recording: Recording,
    last_recorded: bool,
    stats: Stats,
}

impl Observer {
    #[inline(always)]
    fn record(&mut self, instant: &Instant, ledger: impl FnOnce() -> LedgerRow) {
        self.recording.push(instant, ledger);
        self.last_recorded = true;
    }

    /// Watches the end of a step (or the start) and records it where it is due. Gives what ends the run here.
    #[inline(always)]
    fn observe(&mut self, instant: &Instant, sin_tilt: &[f64; 2], ledger: impl FnOnce() -> LedgerRow) -> Set {
        let found = self.monitor.observe(instant.t, &instant.q, sin_tilt, &instant.multipliers);
        self.last_recorded = false;
        if self.until_record == 0 {
            self.until_record = self.every;
            self.record(instant, ledger);
        }
        self.until_record -= 1;
        found.intersection(self.stop_on)
    }
}

#[inline(always)]
fn instant<const N: usize>(t: f64, grid: (f64, u64), now: &Evaluation<f64, N>) -> Instant {
    let Motion { q, p, memory } = now.motion;
    Instant { t, grid, q, p, memory, multipliers: now.multipliers, residuals: now.residuals }
}

#[inline(always)]
fn works<S: System<f64, N>, const N: usize>(y: &[f64; N]) -> [f64; WORKS] {
    std::array::from_fn(|k| if S::LEDGER { y[S::STATES + k] } else { 0.0 })
}

#[inline(always)]
fn ledger<S: System<f64, N>, const N: usize>(system: &S, at: &Instant, works: [f64; WORKS]) -> LedgerRow {
    LedgerRow { energies: system.energies(&Motion { q: at.q, p: at.p, memory: at.memory }), works }
}

/// Whether state and multipliers are finite: zero times each adds up to zero, not to NaN. There is no threshold, so
/// scaling changes nothing.
#[inline(always)]
fn is_finite<const N: usize>(y: &[f64; N], now: &Evaluation<f64, N>) -> bool {
    let state = y.iter().fold(0.0, |sum, value| value.mul_add(0.0, sum));
    now.multipliers.iter().fold(state, |sum, value| value.mul_add(0.0, sum)) == 0.0
}

impl<S: System<f64, N>, I: Integrator, const N: usize> Kernel for Stepping<'_, S, I, N> {
    type Output = Run;

    #[inline(always)]
    fn run(self) -> Run {
        let Job { scene, options, segments, interrupted } = self.job;
        let system = self.system;
        let initial = &scene.initial;
        let mut y: [f64; N] = system.begin(&Motion { q: initial.q, p: initial.p, memory: initial.memory });
        let mut observer = Observer {
            stop_on: options.stop_on,
            every: options.every,
            until_record: 0,
            monitor: Monitor::new(&scene.parameters),
            recording: self.recording,
            last_recorded: false,
            stats: Stats::default(),
        };
        // The last instant that was finite, for the end of a run that overflows.
        let mut last = Instant {
            t: initial.time,
            grid: (initial.time, 0),
            q: initial.q,
            p: initial.p,
            memory: initial.memory,
            multipliers: [f64::NAN; 4],
            residuals: [f64::NAN; 4],
        };
        let mut last_works = [0.0; WORKS];
        let mut ended: Option<(Status, String)> = None;
        let mut until_poll = POLL;

        'run: for (number, segment) in segments.iter().enumerate() {
            let drive = scene.inputs.segment(segment.anchor);
            observer.stats.segments += 1;
            let final_step = if number + 1 == segments.len() { segment.count } else { segment.count - 1 };
            for step in segment.first..=final_step {
                let tau = segment.tau(step);
                let t = if step == segment.first && number == 0 { initial.time } else { segment.time(step) };
                let mut now = system.evaluate(&drive.at(tau), &y);
                observer.stats.evaluations += 1;
                let here = instant(t, (segment.anchor, step), &now);
                if !is_finite(&y, &now) {
                    ended = Some((Status::NotFinite, overflow_message(last.t)));
                    break 'run;
                }
                let stop =
                    observer.observe(&here, &now.sin_tilt, || ledger(system, &here, works::<S, N>(&y)));
                (last, last_works) = (here, works::<S, N>(&y));
                if let Some(violation) = stop.first() {
                    let message = observer.monitor.explain(violation, t, &here.q);
                    ended = Some((Status::of(violation), message));
                    break 'run;
                }
                if step == segment.count {
                    break 'run;
                }
                until_poll -= 1;
                if until_poll == 0 {
                    until_poll = POLL;
                    if interrupted() {
                        ended = Some((Status::Interrupted, interruption_message(t)));
                        break 'run;
                    }
                }
                if step == segment.first && (number > 0 || segment.first == 0) {
                    let mut struck = false;
                    for impulse in scene.inputs.impulses_at(t) {
                        system.jump(&mut y, &impulse.impulse);
                        struck = true;
                    }
                    if struck {
                        now = system.evaluate(&drive.at(tau), &y);
                        observer.stats.evaluations += 1;
                    }
                }
                y = I::step(system, &drive, tau, segment.h, &y, &now.rate);
                system.correct(&mut y);
                observer.stats.steps += 1;
                observer.stats.evaluations += I::EVALUATIONS - 1;
            }
        }

        if !observer.last_recorded {
            observer.record(&last, || ledger(system, &last, last_works));
        }
        let (status, message) =
            ended.unwrap_or_else(|| (Status::Completed, format!("reached the end at t = {} s", last.t)));
        Run {
            recording: observer.recording,
            last,
            status,
            message,
            violations: observer.monitor.violations(),
            stats: observer.stats,
        }
    }
}
