//! The step loops: what they have in common. [`fixed`] takes equal steps between breakpoints, [`free`] such as the error
//! allows, [`lanes`] and [`lanes_free`] the same of several runs at once.

// Several small arrays run in step: an index says so best.
#![allow(clippy::needless_range_loop)]

pub mod fixed;
pub mod free;
pub mod lanes;
pub mod lanes_free;
#[cfg(test)]
mod tests;

use crate::energy::{Energies, LedgerRow, WORKS, closure};
use crate::error::Error;
use crate::formulation::{Evaluation, Motion, Size, States, System};
use crate::inputs::{Drive, SegmentDrive};
use crate::integrator::Stats;
use crate::integrator::newton::Unsolved;
use crate::lanes::{Bits, Lanes};
use crate::monitor::{Monitor, STOPPABLE, Set, VIOLATIONS};
use crate::parameters::Source;
use crate::real::Real;
use crate::record::{Instant, Linearized, Recording};
use crate::simulate::{Options, Run, Scene, Status};
use crate::summary::{Close, Sight, Summaries};

/// How often a step loop asks whether it should stop: every so many steps, some milliseconds.
const POLL: u32 = 1 << 14;

/// What a run needs to know.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// What is simulated.
    pub scene: &'a Scene,
    /// How.
    pub options: &'a Options,
    /// Whether the caller wants it to stop.
    pub interrupted: &'a dyn Fn() -> bool,
}

/// How a run ended, and the same in words.
type End = (Status, String);

/// The message of a run that reached its end.
#[must_use]
pub fn arrival(t: f64) -> String {
    format!("reached the end at t = {t} s")
}

#[cold]
fn overflow(from: f64) -> End {
    let message = format!(
        "a number overflowed in the step from t = {from} s; the last row is the last finite instant. Shorter steps (a \
         smaller dt or tolerance) or a less extreme scene may help"
    );
    (Status::NotFinite, message)
}

#[cold]
fn interruption(t: f64) -> End {
    (Status::Interrupted, format!("stopped from outside at t = {t} s; run.state(-1) goes on from there"))
}

/// What an iteration came to, in words.
fn failure(iterations: u32, correction: f64) -> String {
    if correction.is_finite() {
        format!(
            "its correction was still {correction:.1e} of the states' sizes after {iterations} iterations"
        )
    } else {
        format!("a number overflowed in iteration {iterations}")
    }
}

#[cold]
fn full(t: f64, error: &Error) -> End {
    (Status::Interrupted, format!("stopped at t = {t} s: {error}; run.state(-1) goes on from there"))
}

#[cold]
fn unsolved(t: f64, h: f64, Unsolved { iterations, correction }: Unsolved) -> End {
    let message = format!(
        "Newton's iteration did not converge in the step of {h:.3e} s from t = {t} s: {}. A smaller dt may help, or tolerance= \
         with a method that has it",
        failure(iterations, correction)
    );
    (Status::NewtonFailed, message)
}

/// A failure in a run that had gone on after a violation: no other step helps, but to end it there. What a failure says is its
/// cause, then ". " and what may help; the latter is replaced.
fn after_violation(end: End, first_times: &[f64; VIOLATIONS.len()]) -> End {
    use Status::{NewtonFailed, NotFinite, StepTooSmall, TooManySteps};
    let (status, message) = end;
    let first = STOPPABLE
        .iter()
        .map(|&(name, violation)| (name, first_times[violation as usize]))
        .filter(|(_, t)| !t.is_nan())
        .min_by(|(_, a), (_, b)| a.total_cmp(b));
    let (true, Some((name, t))) =
        (matches!(status, NotFinite | NewtonFailed | StepTooSmall | TooManySteps), first)
    else {
        return (status, message);
    };
    let cause = message.split_once(". ").map_or(message.as_str(), |(cause, _)| cause);
    let message = format!(
        "{cause}. The run had gone on from t = {t} s, where it was {name} and the model stopped holding: with stop_on = {name:?} it \
         ends there"
    );
    (status, message)
}

/// Everything that a run carries from step to step beside its state.
struct Observer {
    stop_on: Set,
    every: u64,
    until_record: u64,
    until_poll: u32,
    monitor: Monitor,
    recording: Recording,
    /// The last instant that was finite, for the end of a run that overflows.
    last: Instant,
    last_works: [f64; WORKS],
    /// The energies of the run's start, where the ledger was asked for.
    begun: Option<Energies>,
    /// Whether the method keeps a Jacobian, and where the one was taken that serves the next step; the same of the last instant.
    keeps: bool,
    linearized: Option<Linearized>,
    last_linearized: Option<Linearized>,
    last_recorded: bool,
    summaries: Summaries<f64>,
    half_width: f64,
    /// When the run began, or its summaries.
    from: f64,
    stats: Stats,
}

impl Observer {
    #[inline(always)]
    fn new(job: Job<'_>, recording: Recording, keeps: bool) -> Self {
        let Job { scene, options, .. } = job;
        let initial = &scene.initial;
        Self {
            stop_on: options.stop_on,
            every: options.every,
            until_record: 0,
            until_poll: POLL,
            monitor: Monitor::new(&scene.parameters),
            recording,
            last: Instant {
                t: initial.time,
                grid: (initial.time, 0),
                q: initial.q,
                p: initial.p,
                memory: initial.memory,
                multipliers: [f64::NAN; 4],
                residuals: [f64::NAN; 4],
                torque: [f64::NAN; 2],
            },
            last_works: [0.0; WORKS],
            begun: None,
            keeps,
            linearized: None,
            last_linearized: None,
            last_recorded: false,
            summaries: Summaries::new(&options.summaries),
            half_width: half_width(&scene.parameters),
            from: initial.time.max(options.summaries.after),
            stats: Stats::default(),
        }
    }

    /// Notes the energies of the run's start.
    fn begin(&mut self, system: &impl System<f64>) {
        let Instant { q, p, memory, .. } = self.last;
        self.begun = system.size().ledger.then(|| system.energies(&Motion { q, p, memory }));
    }

    /// What the ledger leaves open at an instant, zero where it was not asked for; or how the run ends because something of the
    /// instant is not finite.
    #[inline(always)]
    fn require_finite(
        &self,
        system: &impl System<f64>,
        now: &Evaluation<f64>,
        y: &States<f64>,
    ) -> Result<f64, End> {
        let open = match &self.begun {
            Some(begun) => closure(begun, &system.energies(&now.motion), &works(system.size(), y)),
            None => 0.0,
        };
        if finite(now, open) == 0 { Err(overflow(self.last.t)) } else { Ok(open) }
    }

    /// Watches an instant that is finite, and takes it for the last one. Gives what ends the run there.
    #[inline(always)]
    fn watch(
        &mut self,
        instant: Instant,
        sin_tilt: &[f64; 2],
        works: [f64; WORKS],
        closure: f64,
    ) -> Option<End> {
        let found = self.monitor.observe(instant.t, &instant.q, sin_tilt, &instant.multipliers);
        (self.last, self.last_works) = (instant, works);
        if self.keeps {
            self.last_linearized = self.linearized;
        }
        self.last_recorded = false;
        if !self.summaries.is_empty() {
            self.summarize(closure);
        }
        let violation = found.intersection(self.stop_on).first()?;
        Some((
            Status::of(violation),
            self.monitor.explain(violation, (instant.t, self.stats.steps == 0), &instant.q),
        ))
    }

    #[inline(always)]
    fn summarize(&mut self, closure: f64) {
        let Instant { t, q, p, multipliers, residuals, torque, .. } = self.last;
        let half_width = self.half_width;
        self.summaries.watch(&Sight { t, q, p, multipliers, residuals, closure, half_width, torque }, 1);
    }

    /// Records the last instant.
    #[inline(always)]
    fn record(&mut self, system: &impl System<f64>) {
        let (last, works) = (&self.last, self.last_works);
        self.recording.push(last, || ledger(system, last, works));
        if self.keeps {
            self.recording.push_linearized(self.last_linearized);
        }
        self.last_recorded = true;
    }

    /// Records the last instant where it is due.
    #[inline(always)]
    fn record_if_due(&mut self, system: &impl System<f64>) {
        if self.until_record == 0 {
            self.until_record = self.every;
            self.record(system);
        }
        self.until_record -= 1;
    }

    /// Whether the caller wants to stop, asked now and then.
    #[inline(always)]
    fn is_interrupted(&mut self, job: Job<'_>) -> bool {
        self.until_poll -= 1;
        if self.until_poll > 0 {
            return false;
        }
        self.until_poll = POLL;
        (job.interrupted)()
    }

    /// The finished run; the last instant is recorded in any case.
    #[inline(always)]
    fn finish(mut self, system: &impl System<f64>, ended: Option<End>) -> Run {
        if !self.last_recorded {
            self.record(system);
        }
        let ended = ended.unwrap_or_else(|| (Status::Completed, arrival(self.last.t)));
        let (status, message) = after_violation(ended, self.monitor.first_times());
        let close = Close { from: self.from, completed: status == Status::Completed };
        Run {
            recording: self.recording,
            last: self.last,
            linearized: self.last_linearized,
            begun: self.begun,
            status,
            message,
            violations: self.monitor.violations(),
            summaries: self.summaries.values(0, &close),
            stats: self.stats,
        }
    }
}

#[inline(always)]
fn instant(t: f64, grid: (f64, u64), now: &Evaluation<f64>) -> Instant {
    let Motion { q, p, memory } = now.motion;
    let Evaluation { multipliers, residuals, torque, .. } = *now;
    Instant { t, grid, q, p, memory, multipliers, residuals, torque }
}

/// W / 2, for the summaries.
#[inline(always)]
fn half_width<R: Real>(source: &impl Source<R>) -> R {
    source.number(|p| 0.5 * p.grasped.width)
}

#[inline(always)]
pub(crate) fn works<R: Real>(size: Size, y: &States<R>) -> [R; WORKS] {
    let mut works = [R::zero(); WORKS];
    if size.ledger {
        works.copy_from_slice(&y[size.states..size.all()]);
    }
    works
}

#[inline(always)]
fn ledger(system: &impl System<f64>, at: &Instant, works: [f64; WORKS]) -> LedgerRow {
    LedgerRow { energies: system.energies(&Motion { q: at.q, p: at.p, memory: at.memory }), works }
}

/// Where everything that is said of an instant is finite: zero times each number adds up to zero, not to NaN. There is no
/// threshold, so scaling changes nothing. The ledger's `closure` is finite only where each energy and work is.
#[inline(always)]
pub(crate) fn finite<R: Lanes>(now: &Evaluation<R>, closure: R) -> Bits {
    let Evaluation { motion: Motion { q, p, memory }, multipliers, residuals, torque, .. } = now;
    let mut sum = closure * R::zero();
    for values in [&q[..], p, memory, multipliers, residuals, torque] {
        for value in values {
            sum = value.mul_add(R::zero(), sum);
        }
    }
    sum.vanishes()
}

/// Lets the impulses at time `t`, `tau` after its segment's start, strike. Whether there was one.
#[inline(always)]
fn strike(
    scene: &Scene,
    system: &impl System<f64>,
    drive: &SegmentDrive,
    (t, tau): (f64, f64),
    y: &mut States<f64>,
) -> bool {
    let mut struck = false;
    for impulse in scene.inputs.impulses_at(t) {
        system.jump(&drive.at(tau), y, &impulse.impulse);
        struck = true;
    }
    struck
}
