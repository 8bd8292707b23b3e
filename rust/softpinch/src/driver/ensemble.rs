//! Many runs. Threads take one run after the other, each into the lane that has become free.
//!
//! Every run gives the bits that it gives alone, whatever thread computes it and whatever runs are beside it.

use std::borrow::Cow;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::driver::loops::whole_run;
use crate::driver::threads::share_watched;
use crate::driver::{Derivatives, require_valid};
use crate::error::{Error, Result};
use crate::formulation::Choice;
use crate::model::{Motion, Parameters, Scene};
use crate::stepping::{
    COUNT, Finished, Options, Recorder, Run, RunLoop, RunQueue, Status, Taken, VIOLATIONS, reserved,
};

/// The result of one run of an ensemble.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // of fields that their types explain
pub struct Row {
    pub run: usize,
    pub status: Status,
    /// The status in words; empty if the run reached its end, which needs no words.
    pub message: String,
    pub t: f64,
    pub motion: Motion<f64>,
    /// The time at which each of [`VIOLATIONS`] was first seen, s; NaN if it was not.
    pub violations: [f64; VIOLATIONS.len()],
    /// Whether the grasp held, see [`Run::holds`].
    pub holds: bool,
    pub steps: u64,
    /// The summaries, in the order of [`SUMMARIES`](crate::stepping::summary::SUMMARIES).
    pub summaries: [f64; COUNT],
}

impl Row {
    pub(super) fn of(number: usize, run: Run) -> Self {
        let completed = run.status == Status::Completed;
        Self {
            run: number,
            status: run.status,
            message: if completed { String::new() } else { run.message },
            t: run.last.t,
            motion: run.last.motion,
            violations: run.first_times,
            holds: run.holds,
            steps: run.stats.steps,
            summaries: run.summaries,
        }
    }
}

/// A function that makes the scene of each run.
pub type Scenes<'a> = dyn Fn(usize) -> Result<Scene> + Sync + 'a;

pub(crate) struct Shared<'a> {
    scenes: &'a Scenes<'a>,
    pub(crate) options: &'a Options,
    runs: usize,
    /// What all runs have in common: the choice of equations, and parameters with the kinds of the parts.
    alike: OnceLock<(Choice, Parameters)>,
    /// Numbers of the next run, and of the finished runs.
    next: AtomicUsize,
    done: AtomicUsize,
    stop: AtomicBool,
}

impl<'a> Shared<'a> {
    pub(crate) fn new(scenes: &'a Scenes<'a>, runs: usize, options: &'a Options) -> Self {
        let (next, done, stop) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicBool::new(false));
        Self { scenes, options, runs, alike: OnceLock::new(), next, done, stop }
    }

    /// Takes the next run, unless there is none or the caller wants to stop.
    pub(crate) fn take(&self) -> Result<Option<(usize, Scene)>> {
        if self.stops() {
            return Ok(None);
        }
        let run = self.next.fetch_add(1, Ordering::Relaxed);
        if run >= self.runs {
            return Ok(None);
        }
        let scene = (self.scenes)(run)?;
        if !self.options.checked {
            require_valid(&scene, self.options).map_err(|error| error.of_run(run))?;
        }
        // All lanes of a loop have the same equations.
        let own @ (choice, parameters) = (self.options.choice(&scene.inputs), scene.parameters);
        let (other, kinds) = self.alike.get_or_init(|| own);
        if choice == *other && parameters == parameters.of_the_kinds(kinds) {
            return Ok(Some((run, scene)));
        }
        let rule = "fingers, a motion of the hand and the kinds of parts must be the same in all runs";
        Err(Error::shape(format_args!("run {run}"), "another kind of scene", rule))
    }

    fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Simulates runs 0 to `runs` of `scenes` on `threads` threads of its own. From time to time `watch` gets the
/// number of finished runs and says whether to stop; after a stop the rows are those of the finished runs.
/// Only the ends of runs are kept, with free steps too, and nothing is recorded.
pub fn ensemble(
    scenes: &Scenes<'_>,
    runs: usize,
    options: &Options,
    threads: usize,
    watch: &mut dyn FnMut(usize) -> bool,
) -> Result<Vec<Row>> {
    let shared = &Shared::new(scenes, runs, options);
    let mut rows = reserved("the rows of an ensemble, in numbers,", runs)?;
    let mut watch = || watch(shared.done.load(Ordering::Relaxed));
    let found = share_watched(threads.clamp(1, runs.max(1)), &shared.stop, || work(shared), &mut watch)?;
    rows.extend(found.into_iter().flatten());
    rows.sort_unstable_by_key(|row| row.run);
    Ok(rows)
}

/// Computes `one` number after the other, each the derivatives of a run from 0 to `runs`, on `threads` threads of its own.
/// It gets the number of the run, and a function that says whether to stop. Returns the derivatives in the order of the
/// runs; `None` if `watch`, which is called from time to time, has stopped the work.
pub fn derivatives(
    runs: usize,
    threads: usize,
    one: impl Fn(usize, &dyn Fn() -> bool) -> Result<Option<Derivatives>> + Sync,
    watch: &mut dyn FnMut() -> bool,
) -> Result<Option<Vec<Derivatives>>> {
    let (next, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
    let stops = || stop.load(Ordering::Relaxed);
    let work = || {
        let mut found = Vec::new();
        while !stops() {
            let run = next.fetch_add(1, Ordering::Relaxed);
            if run >= runs {
                break;
            }
            let own = one(run, &stops).map_err(|error| error.of_run(run))?;
            found.extend(own.map(|own| (run, own)));
        }
        Ok(found)
    };
    let mut found: Vec<_> =
        share_watched(threads.clamp(1, runs.max(1)), &stop, work, watch)?.into_iter().flatten().collect();
    found.sort_unstable_by_key(|(run, _)| *run);
    Ok((found.len() == runs).then(|| found.into_iter().map(|(_, own)| own).collect()))
}

pub(super) fn work(shared: &Shared<'_>) -> Result<Vec<Row>> {
    in_lanes(shared, |runs| runs.in_lanes())
}

/// Lets `compute` take runs, and returns the rows of those that it finishes.
pub(super) fn in_lanes(shared: &Shared<'_>, compute: impl FnOnce(RunLoop<'_>) -> Result) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    if shared.runs == 0 {
        return Ok(rows);
    }
    let (first, options) = ((shared.scenes)(0)?, shared.options);
    let mut take = || {
        let taken = shared.take()?;
        Ok(taken.map(|(number, scene)| Taken { number, scene: Cow::Owned(scene), contact: None }))
    };
    let mut finish = |Finished { number, run, .. }: Finished| {
        // A run that was interrupted has no row.
        if run.status != Status::Interrupted {
            rows.push(Row::of(number, run));
            shared.done.fetch_add(1, Ordering::Relaxed);
        }
    };
    let (stops, recorder) = (&|| shared.stops(), Recorder::default());
    let queue = RunQueue { take: &mut take, stops, finish: &mut finish, recorder };
    compute(RunLoop { queue, grid: &whole_run(options), options, scene: &first })?;
    Ok(rows)
}
