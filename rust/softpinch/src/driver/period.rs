//! One period of the runs of a simulator: each goes on from its state to the end of the period, on one thread or
//! on several.

use std::borrow::Cow;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::driver::environment::{Environment, Outcome};
use crate::driver::lanes::compute_in_lanes;
use crate::driver::queue::LaneRuns;
use crate::driver::simulate::advance;
use crate::error::Error;
use crate::model::scene::Scene;
use crate::number::lanes::MOST;
use crate::stepping::contact_lane::LaneContact;
use crate::stepping::grid::{Grid, Span};
use crate::stepping::options::Options;
use crate::stepping::queue::Finished;

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
pub(super) struct Period<'a> {
    pub(super) options: &'a Options,
    pub(super) dt: f64,
    /// The ends of the period, s.
    pub(super) ends: &'a [f64],
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
            if compute_in_lanes(&mut chunk, &grid, options, choice)?.is_some() {
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

/// Computes the period of all runs. The caller's thread does a part of the work.
pub(super) fn compute(
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
pub(super) fn pool(threads: usize) -> Result<Option<ThreadPool>, Error> {
    if threads < 2 {
        return Ok(None);
    }
    let pool = ThreadPoolBuilder::new().num_threads(threads - 1).build();
    pool.map(Some).map_err(|error| Error::Threads { threads, reason: error.to_string() })
}
