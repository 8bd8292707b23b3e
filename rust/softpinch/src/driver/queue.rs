//! The runs of an ensemble, which threads take one after the other, and their rows.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::driver::simulate::require_valid;
use crate::error::Error;
use crate::model::control::Fingers;
use crate::model::motion::Motion;
use crate::model::scene::Scene;
use crate::stepping::monitor::VIOLATIONS;
use crate::stepping::options::Options;
use crate::stepping::record::Run;
use crate::stepping::status::Status;
use crate::stepping::summary::COUNT;

/// The result of one run of an ensemble.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Number of the run.
    pub run: usize,
    /// The status with which it ended.
    pub status: Status,
    /// The status in words; empty if the run reached its end, which needs no words.
    pub message: String,
    /// Time of the last instant, s.
    pub t: f64,
    /// The motion at the last instant.
    pub motion: Motion<f64>,
    /// The time at which each of [`VIOLATIONS`] was first seen, s; NaN if it was not.
    pub violations: [f64; VIOLATIONS.len()],
    /// Whether the grasp held, see [`Run::holds`].
    pub holds: bool,
    /// Number of steps.
    pub steps: u64,
    /// The summaries, in the order of [`SUMMARIES`](crate::stepping::summary::SUMMARIES).
    pub summaries: [f64; COUNT],
}

impl Row {
    /// The row of a run.
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
pub type Scenes<'a> = dyn Fn(usize) -> Result<Scene, Error> + Sync + 'a;

/// The data that the threads share.
pub struct Shared<'a> {
    pub(super) scenes: &'a Scenes<'a>,
    /// The options of every run.
    pub options: &'a Options,
    pub(super) runs: usize,
    fingers: OnceLock<Fingers>,
    next: AtomicUsize,
    /// Number of finished runs.
    pub(super) done: AtomicUsize,
    pub(super) stop: AtomicBool,
}

impl<'a> Shared<'a> {
    /// The shared data before any run.
    pub fn new(scenes: &'a Scenes<'a>, runs: usize, options: &'a Options) -> Self {
        let (next, done, stop) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicBool::new(false));
        Self { scenes, options, runs, fingers: OnceLock::new(), next, done, stop }
    }

    /// Takes the next run, unless there is none or the caller wants to stop.
    pub fn take(&self) -> Result<Option<(usize, Scene)>, Error> {
        if self.stops() {
            return Ok(None);
        }
        let run = self.next.fetch_add(1, Ordering::Relaxed);
        if run >= self.runs {
            return Ok(None);
        }
        let scene = (self.scenes)(run)?;
        require_valid(&scene, self.options).map_err(|error| error.of_run(run))?;
        // All lanes of a loop have the same equations, so all runs must have the same kind of fingers.
        let fingers = scene.inputs.fingers();
        if *self.fingers.get_or_init(|| fingers) == fingers {
            return Ok(Some((run, scene)));
        }
        let (field, found) = (format!("run {run}"), format!("fingers = {:?}", fingers.name()));
        Err(Error::Shape { field, found, rule: "must be the same in all runs" })
    }

    /// Whether the caller wants to stop.
    pub fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Counts one more finished run.
    pub fn finished(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }
}
