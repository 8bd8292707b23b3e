//! Many runs. Threads take one run after the other, each into the lane that has become free.
//!
//! Every run gives the bits that it gives alone, whatever thread computes it and whatever runs are beside it.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use crate::driver::lanes::in_lanes;
use crate::driver::queue::{Row, Scenes, Shared, Worker};
use crate::driver::simulate::simulate;
use crate::error::Error;
use crate::model::scene::Scene;
use crate::stepping::grid::Grid;
use crate::stepping::options::{Options, Steps};
use crate::stepping::record::reserved;
use crate::stepping::status::Status;

/// Interval at which the caller gets the number of finished runs and is asked whether to stop.
const WATCH: Duration = Duration::from_millis(50);

/// Simulates runs 0 to `runs` of `scenes` on `threads` threads of its own. From time to time `watch` gets the
/// number of finished runs and says whether to stop; after a stop the rows are those of the finished runs.
/// Only the ends of runs are kept, with free steps too, and nothing is recorded.
pub fn ensemble(
    scenes: &Scenes<'_>,
    runs: usize,
    options: &Options,
    threads: usize,
    watch: &mut dyn FnMut(usize) -> bool,
) -> Result<Vec<Row>, Error> {
    let shared = &Shared::new(scenes, runs, options);
    let threads = threads.min(runs.max(1));
    let (sender, results) = channel();
    let mut rows = reserved("the rows of an ensemble, in numbers,", runs)?;
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let sender = sender.clone();
            let thread = std::thread::Builder::new().spawn_scoped(scope, move || {
                let worked = work(shared);
                if worked.is_err() {
                    shared.stop();
                }
                // The receiver waits for all threads. If it is gone, nobody needs the rows.
                let _ = sender.send(worked);
            });
            if let Err(error) = thread {
                shared.stop();
                return Err(Error::Threads { threads, reason: error.to_string() });
            }
        }
        drop(sender);
        loop {
            match results.recv_timeout(WATCH) {
                Ok(worked) => rows.extend(worked?),
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
                Err(RecvTimeoutError::Timeout) => {
                    if watch(shared.done()) {
                        shared.stop();
                    }
                }
            }
        }
    })?;
    rows.sort_unstable_by_key(|row| row.run);
    Ok(rows)
}

/// The work of one thread.
pub(super) fn work(shared: &Shared<'_>) -> Result<Vec<Row>, Error> {
    let Some(first) = shared.peek()? else { return Ok(Vec::new()) };
    let options = shared.options;
    let mut worker = Worker { shared, rows: Vec::new() };
    match in_lanes(&mut worker, &whole_run(options), options, options.choice(first.inputs.fingers()))? {
        Some(()) => Ok(worker.rows),
        None => one_by_one(shared),
    }
}

/// The times of the steps of a run from its start to its end, in equal steps.
pub(crate) fn whole_run(options: &Options) -> impl Fn(usize, &Scene) -> Result<Grid, Error> + '_ {
    // Adaptive steps have no such times, and do not ask for them.
    let dt = if let Steps::Fixed(dt) = options.steps { dt } else { f64::NAN };
    move |_, Scene { inputs, initial, duration, .. }| {
        Grid::new(inputs, initial, *duration, dt, options.refine)
    }
}

/// Simulates the runs one after the other, for methods whose steps have no lanes.
fn one_by_one(shared: &Shared<'_>) -> Result<Vec<Row>, Error> {
    let mut rows = Vec::new();
    while let Some((number, scene)) = shared.take()? {
        let (run, _) = simulate(&scene, shared.options, &|| shared.stops())?;
        if run.status == Status::Interrupted {
            break;
        }
        rows.push(Row::of(number, run));
        shared.finished();
    }
    Ok(rows)
}
