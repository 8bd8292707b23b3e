//! Steps as long as the error allows, shortened to end on each breakpoint.

use crate::formulation::{Chosen, Motion, Moved, ROOM, Size, States, System};
use crate::grid::Span;
use crate::inputs::{Drive, SegmentDrive};
use crate::integrator::newton::{Unsolved, largest};
use crate::integrator::step_control::StepControl;
use crate::integrator::{Adaptive, Allowed, Step};
use crate::lanes::{Bits, LaneTask, Lanes};
use crate::record::Recording;
use crate::simulate::{Run, Status};
use crate::stepping::{End, Job, Observer, failure, full, instant, interruption, strike, works};

/// A state's size is at least this share of its usual one, a rate's of what viscosity leaves of that: from rest nothing else
/// is known.
const LEAST_SIZE: f64 = 1e-3;
/// No error below this share of a state's usual size is asked for.
const ROUND_OFF: f64 = 100.0 * f64::EPSILON;
/// The shortest step, as a share of the time, or of a billionth of the stretch where that is longer: next to time zero.
const SHORTEST: f64 = 16.0 * f64::EPSILON;
const NEXT_TO_ZERO: f64 = 1e-9;

/// The step loop of one run.
pub struct Free<'a, I> {
    /// What is run.
    pub job: Job<'a>,
    /// When the run starts and ends.
    pub span: Span,
    /// Largest error of a step, as a share of each state's size.
    pub tolerance: f64,
    /// Instants to record; `None` for the ends of steps.
    pub times: Option<&'a [f64]>,
    /// Its equations.
    pub system: &'a Chosen<f64>,
    /// How they are stepped.
    pub integrator: I,
    /// The states' usual sizes.
    pub sizes: States<f64>,
    /// Where its rows go.
    pub recording: Recording,
}

/// What the last attempt of a step came to.
#[derive(Clone, Copy)]
pub(super) enum Attempt {
    /// There has been none.
    None,
    /// Its error, in allowed errors; small where the step stood.
    Error(f64),
    /// Its equations were not solved.
    Unsolved(Unsolved),
}

#[cold]
pub(super) fn too_small(t: f64, h: f64, last: Attempt) -> End {
    let reason = match last {
        Attempt::None => {
            "the clock does not resolve a first step there; a start nearer to zero does".to_owned()
        }
        Attempt::Error(error) if !error.is_finite() => "a number overflowed in the last attempt".to_owned(),
        Attempt::Error(error) if error > 1.0 => {
            format!("the last attempt's error was still {error:.1e} times what tolerance allows")
        }
        Attempt::Error(_) => "the error asks for ever shorter ones".to_owned(),
        Attempt::Unsolved(Unsolved { iterations, correction }) => {
            format!(
                "in the last attempt Newton's iteration did not converge, {}",
                failure(iterations, correction)
            )
        }
    };
    let message = format!(
        "no step was short enough at t = {t} s, down to {h:.3e} s: {reason}. The motion may run away there; else a larger \
         tolerance or another method may help"
    );
    (Status::StepTooSmall, message)
}

#[cold]
pub(super) fn too_many(t: f64, h: f64, most: u64) -> End {
    let message = format!(
        "{most} steps, rejected ones too, were not enough: it came to t = {t} s, where a step has {h:.3e} s. With an explicit method \
         the scene is stiff: \"radau5\" takes longer steps; else a larger tolerance or max_steps"
    );
    (Status::TooManySteps, message)
}

/// What is allowed of each state, from the largest size that each has had.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes<R = f64> {
    pub(super) largest: States<R>,
    /// Less than this is not asked for.
    pub(super) round_off: States<R>,
    pub(super) allowed: Allowed<R>,
}

impl Sizes {
    /// At a run's start.
    #[inline(always)]
    pub(super) fn new(tolerance: f64, usual: &States<f64>, slow: &States<f64>) -> Self {
        let largest = slow.map(|size| LEAST_SIZE * size);
        let round_off = usual.map(|size| ROUND_OFF * size);
        Self { largest, round_off, allowed: Allowed { tolerance, weights: [0.0; ROOM] } }
    }

    /// The size of rates, as a share of the states' sizes.
    #[inline(always)]
    fn share(&self, size: Size, rate: &States<f64>) -> f64 {
        self.allowed.tolerance * largest(size, rate, &self.allowed.weights)
    }
}

impl<R: Lanes> Sizes<R> {
    /// Takes the states of the lanes whose bits are set.
    #[inline(always)]
    pub(super) fn note(&mut self, size: Size, y: &States<R>, bits: Bits) {
        let tolerance = R::constant(self.allowed.tolerance);
        for n in 0..size.states {
            self.largest[n] = self.largest[n].raised(y[n].abs(), bits);
            let error = (tolerance * self.largest[n]).raised(self.round_off[n], R::ALL);
            self.allowed.weights[n] = R::constant(1.0) / error;
        }
    }
}

/// The length of the next attempt: `h`, or what is `left` of the stretch, or half of that where `h` would leave next to nothing.
#[inline(always)]
pub(super) fn fitted(h: f64, left: f64) -> f64 {
    if h >= 0.999_999 * left {
        left
    } else if 2.0 * h > left {
        0.5 * left
    } else {
        h
    }
}

/// Whether the clock does not resolve a step at `t` in a stretch of this length.
#[inline(always)]
pub(super) fn unresolved(taken: f64, t: f64, length: f64) -> bool {
    taken <= SHORTEST * t.abs().max(NEXT_TO_ZERO * length)
}

/// The first step of a stretch.
#[inline(always)]
pub(super) fn first_step(
    (system, drive): (&Chosen<f64>, &SegmentDrive),
    control: &StepControl,
    sizes: &Sizes,
    (y, rate): (&States<f64>, &States<f64>),
    length: f64,
) -> f64 {
    let size = system.size();
    let pace = sizes.share(size, rate);
    // An explicit Euler step that changes no state by much shows how fast the rates change.
    let trial = f64::min(0.01 / pace, 1e-3 * length);
    let mut change = *rate;
    system.rates(&drive.at(trial), Moved { from: y, by: trial, along: rate }, &mut change);
    for n in 0..size.states {
        change[n] = (change[n] - rate[n]) / trial;
    }
    let first = control.first(sizes.allowed.tolerance, pace, sizes.share(size, &change));
    if first > 0.0 { first.min(length) } else { trial }
}

/// The earlier one of an instant and the first of those asked for.
#[inline(always)]
fn first_of(turn: Option<f64>, asked: &[f64]) -> Option<f64> {
    match (turn, asked.first()) {
        (Some(turn), Some(&first)) => Some(turn.min(first)),
        (turn, first) => turn.or(first.copied()),
    }
}

impl<I: Adaptive<f64, Chosen<f64>>> LaneTask<f64> for Free<'_, I> {
    type Output = Run;

    #[inline(always)]
    fn run(self) -> Run {
        let Self { job, span, tolerance, times, system, mut integrator, sizes, recording } = self;
        let slow = system.begin(&Motion::slow_sizes(&job.scene.parameters));
        let (scene, size) = (job.scene, system.size());
        let initial = &scene.initial;
        let mut y = system.begin(&Motion { q: initial.q, p: initial.p, memory: initial.memory });
        let mut observer = Observer::new(job, recording, false);
        let mut sizes = Sizes::new(tolerance, &sizes, &slow);
        let mut control = StepControl::new(I::ERROR_ORDER, I::WORTH);
        let mut due = times.unwrap_or_default();
        observer.begin(system);
        let mut ended: Option<End> = None;
        let mut next = y;

        let mut to = span.start;
        'run: while to < span.end {
            let from = to;
            to = span.stretch_end(&scene.inputs, from);
            let drive = scene.inputs.segment(from);
            let length = to - from;
            observer.stats.segments += 1;
            integrator.restart();
            control.restart();
            let mut last = Attempt::None;
            let (mut tau, mut t, mut h) = (0.0, from, 0.0);
            let mut arrival = None;
            loop {
                // The state here, after a step or at the stretch's start.
                let mut now = arrival.take().unwrap_or_else(|| {
                    observer.stats.evaluations += 1;
                    system.evaluate(&drive, tau, &y)
                });
                let closure = match observer.require_finite(system, &now, &y) {
                    Ok(closure) => closure,
                    Err(end) => {
                        ended = Some(end);
                        break 'run;
                    }
                };
                ended = observer.watch(instant(t, (t, 0), &now), &now.sin_tilt, works(size, &y), closure);
                if let Err(error) = observer.recording.make_room() {
                    ended = Some(full(t, &error));
                    break;
                }
                if times.is_none() {
                    observer.record_if_due(system);
                } else if let [first, rest @ ..] = due
                    && *first == t
                {
                    observer.record(system);
                    due = rest;
                }
                if ended.is_some() || t == to {
                    break;
                }
                if observer.is_interrupted(job) {
                    ended = Some(interruption(t));
                    break;
                }
                if tau == 0.0 {
                    if strike(scene, system, &drive, (t, tau), &mut y) {
                        now = system.evaluate(&drive, tau, &y);
                        observer.stats.evaluations += 1;
                    }
                    sizes.note(size, &y, 1);
                    observer.stats.evaluations += 1;
                    let here = (system, &drive);
                    h = first_step(here, &control, &sizes, (&y, &now.rate), length);
                }

                // Attempts, each shorter than the one before, until the error is allowed.
                let (start, arrived, taken) = loop {
                    let left = length - tau;
                    let taken = fitted(h, left);
                    if taken < left && unresolved(taken, t, length) {
                        ended = Some(too_small(t, taken, last));
                        break 'run;
                    }
                    if observer.stats.steps + observer.stats.rejected == job.options.max_steps {
                        ended = Some(too_many(t, taken, job.options.max_steps));
                        break 'run;
                    }
                    let step = Step { tau, h: taken, y: &y, rate: &now.rate, allowed: Some(&sizes.allowed) };
                    let judged = match integrator.step(system, &drive, &step, &mut next, &mut observer.stats)
                    {
                        Ok(()) => {
                            let retried = control.retries();
                            let own = integrator.error(system, &drive, &step, retried, &mut observer.stats);
                            // What puts a step back on the constraints is an error of it, too.
                            let mut arrived = next;
                            system.correct(&drive, tau + taken, &mut arrived);
                            let mut moved = [0.0; ROOM];
                            for n in 0..size.states {
                                moved[n] = arrived[n] - next[n];
                            }
                            let shift = largest(size, &moved, &sizes.allowed.weights);
                            let error = if shift > own || shift.is_nan() { shift } else { own };
                            last = Attempt::Error(error);
                            control.judge(error).map(|growth| (growth, arrived))
                        }
                        Err(unsolved) => {
                            last = Attempt::Unsolved(unsolved.into());
                            Err(control.unsolved())
                        }
                    };
                    match judged {
                        Ok((growth, arrived)) => {
                            h = growth * taken;
                            integrator.accepted(taken);
                            break (step, arrived, taken);
                        }
                        Err(shrink) => h = shrink * taken,
                    }
                    observer.stats.rejected += 1;
                };
                observer.stats.steps += 1;
                let end = if taken == length - tau { to } else { from + (tau + taken) };

                let there = system.evaluate(&drive, tau + taken, &arrived);
                observer.stats.evaluations += 1;

                // What was asked for inside the step, by dense output; and where a tip seems to be lost and to come back.
                let inside = due.partition_point(|&time| time < end);
                let turn = observer.monitor.between(&now.motion, &there.motion, taken);
                let mut turn = turn.map(|x| from + x.mul_add(taken, tau));
                if inside > 0 || turn.is_some() {
                    integrator.prepare(system, &drive, &start, &next, &mut observer.stats);
                }
                let (mut asked, rest) = due.split_at(inside);
                while let Some(time) = first_of(turn, asked) {
                    let x = (((time - from) - tau) / taken).clamp(0.0, 1.0);
                    let mut between = integrator.interpolate(&start, &next, x);
                    system.correct(&drive, time - from, &mut between);
                    let then = system.evaluate(&drive, time - from, &between);
                    observer.stats.evaluations += 1;
                    let closure = match observer.require_finite(system, &then, &between) {
                        Ok(closure) => closure,
                        Err(end) => {
                            ended = Some(end);
                            break 'run;
                        }
                    };
                    let at = instant(time, (time, 0), &then);
                    ended = observer.watch(at, &then.sin_tilt, works(size, &between), closure);
                    if let [first, others @ ..] = asked
                        && *first == time
                    {
                        observer.record(system);
                        asked = others;
                    } else {
                        turn = None;
                    }
                    if ended.is_some() {
                        break 'run;
                    }
                }
                due = rest;

                y = arrived;
                sizes.note(size, &y, 1);
                (tau, t) = (tau + taken, end);
                // A breakpoint is watched under the inputs that hold from there on.
                if t == to && to < span.end {
                    break;
                }
                arrival = Some(there);
            }
            if ended.is_some() {
                break;
            }
        }
        observer.finish(system, ended)
    }
}
