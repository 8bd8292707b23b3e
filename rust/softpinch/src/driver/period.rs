//! One period of the runs of a simulator: each goes on from its state to the end of the period, on one thread or
//! on several.

use std::borrow::Cow;
use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::ThreadPool;

use crate::driver::environment::{Environment, Outcome};
use crate::driver::lanes::{LaneQueue, RunsInLanes};
use crate::driver::simulate::advance;
use crate::driver::threads::share;
use crate::error::Error;
use crate::model::scene::Scene;
use crate::number::lanes::MOST;
use crate::stepping::contact_lane::LaneContact;
use crate::stepping::grid::{Grid, Span};
use crate::stepping::options::Options;
use crate::stepping::queue::{Finished, Taken};
use crate::stepping::record::Run;

/// A run during a period.
#[derive(Default)]
pub(super) struct PeriodRun {
    /// The end of the period, s.
    pub(super) end: f64,
    /// The result, once there is one.
    pub(super) outcome: Option<Outcome>,
    /// In unilateral contact, its contacts, whose equations do not change.
    pub(super) contact: Option<Box<LaneContact>>,
}

impl PeriodRun {
    /// Takes the result, and the contacts.
    fn end_with(&mut self, Run { status, message, last, .. }: Run, contact: Option<Box<LaneContact>>) {
        self.contact = contact;
        self.outcome = Some(Outcome { status, message, instant: last });
    }
}

/// Some of the runs of a simulator, for one thread.
type Part<'a> = (&'a [Environment], &'a mut [PeriodRun]);

/// Computes the period of some runs in steps of at most `dt`. A single run, and a method whose steps have no lanes, take
/// the code of lone runs.
fn compute_part(
    (options, dt): (&Options, f64),
    (environments, runs): Part<'_>,
    stops: &dyn Fn() -> bool,
) -> Result<(), Error> {
    // The grid, the source and the destination of a loop use them by turns.
    let runs = RefCell::new(runs);
    let grid = |number: usize, Scene { inputs, initial, .. }: &Scene| {
        let span = Span { start: initial.time, end: runs.borrow()[number].end };
        Grid::over(inputs, initial, span, dt, options.refine)
    };
    let mut under_way =
        (0..).zip(environments).filter(|(_, environment)| environment.observed.status.is_none());
    if let [first, _, ..] = environments {
        let mut take = || {
            let next = under_way.next();
            Ok(next.map(|(number, environment)| Taken {
                number,
                scene: Cow::Borrowed(&environment.scene),
                contact: runs.borrow_mut()[number].contact.take(),
            }))
        };
        let mut finish = |Finished { number, run, contact }: Finished| {
            runs.borrow_mut()[number].end_with(run, contact);
        };
        let queue = LaneQueue { take: &mut take, stops, finish: &mut finish };
        let choice = options.choice(&first.scene.inputs);
        let papers = first.scene.parameters.has_the_papers_parts();
        if (RunsInLanes { queue, grid: &grid, options, choice, papers }).compute()?.is_some() {
            return Ok(());
        }
    }
    for (number, Environment { scene, .. }) in under_way {
        let kept = runs.borrow_mut()[number].contact.take();
        let (found, contact) = advance((scene, kept), options, grid(number, scene)?, stops)?;
        runs.borrow_mut()[number].end_with(found, contact);
    }
    Ok(())
}

/// Computes the period of all runs. The caller's thread does a part of the work beside those of the pool.
pub(super) fn compute(
    how: (&Options, f64),
    environments: &[Environment],
    runs: &mut [PeriodRun],
    pool: Option<&ThreadPool>,
    interrupted: &dyn Fn() -> bool,
) -> Result<(), Error> {
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
    share(
        pool,
        parts,
        &stop,
        |part| compute_part(how, part, &stopped),
        |results| {
            let found = compute_part(how, own, &stops);
            stop.fetch_or(found.is_err(), Ordering::Relaxed);
            results.iter().chain([found]).collect()
        },
    )
}
