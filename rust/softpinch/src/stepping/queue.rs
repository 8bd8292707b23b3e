//! What step loops ask of those that they work for: where runs come from and go, and how they are equipped.

use std::borrow::Cow;

use crate::error::Error;
use crate::method::traits::Stats;
use crate::model::energy::{Energies, LedgerRow, WORKS};
use crate::model::motion::Linearized;
use crate::model::parameters::Parameters;
use crate::model::scene::Scene;
use crate::number::lanes::MOST;
use crate::stepping::monitor::VIOLATIONS;
use crate::stepping::record::Instant;
use crate::stepping::status::Status;
use crate::stepping::summary::COUNT;

/// Every so many steps or attempts a loop asks whether it should stop: a few milliseconds.
pub const POLL: u64 = 1 << 12;

/// Where the runs of a step loop come from, and where they go. Runs are recorded in loops of one lane only.
pub trait RunQueue<'a> {
    /// The next run and its number, unless there is none.
    fn take(&mut self) -> Result<Option<(usize, Cow<'a, Scene>)>, Error>;

    /// Whether the runs should stop.
    fn stops(&mut self) -> bool;

    /// Takes a run that has ended; `ledger` gives the row of its last instant.
    fn finish(&mut self, finished: Finished, ledger: impl FnOnce(&Watched) -> LedgerRow);

    /// Whether the instant `t`, just watched, is recorded. An instant inside a step is recorded only where it was asked for.
    #[inline(always)]
    fn is_due(&mut self, t: f64, inside: bool) -> bool {
        let _ = (t, inside);
        false
    }

    /// Records an instant, or says that there is no memory for it.
    fn record(&mut self, watched: &Watched, ledger: impl FnOnce(&Watched) -> LedgerRow) -> Result<(), Error> {
        let _ = (watched, ledger);
        Ok(())
    }

    /// The first instant that was asked for and is not recorded yet; infinite where there is none.
    #[inline(always)]
    fn next_time(&self) -> f64 {
        f64::INFINITY
    }
}

/// An instant of a run that was found to be finite.
#[derive(Debug, Clone, Copy)]
pub struct Watched {
    /// The instant.
    pub instant: Instant,
    /// The ledger's works; zeros where they are not carried.
    pub works: [f64; WORKS],
    /// Where the Jacobian was taken that serves the next step, for methods that keep one.
    pub linearized: Option<Linearized>,
}

/// A run that has ended.
#[derive(Debug, Clone)]
pub struct Finished {
    /// Its number.
    pub number: usize,
    /// How it ended.
    pub status: Status,
    /// The same in words; empty where it reached its end.
    pub message: String,
    /// Its last instant.
    pub last: Watched,
    /// The energies at its start, where the ledger was kept.
    pub begun: Option<Energies>,
    /// When each of [`VIOLATIONS`] was first seen, s; NaN for never.
    pub first_times: [f64; VIOLATIONS.len()],
    /// The summaries, in the order of [`SUMMARIES`](crate::stepping::summary::SUMMARIES).
    pub summaries: [f64; COUNT],
    /// Counted work: of this run the steps and segments, and in a loop of one lane the rest.
    pub stats: Stats,
}

/// The parameters of the runs in all lanes.
pub type LaneParameters<'a> = [&'a Parameters; MOST];

/// Makes equations and method for the runs in all lanes.
pub trait Equip<S, I> {
    /// Of runs with these parameters.
    fn equip(&mut self, parameters: &LaneParameters<'_>) -> (S, I);

    /// The same in place, after some of the runs have changed.
    fn renew(&mut self, parameters: &LaneParameters<'_>, system: &mut S, method: &mut I) {
        (*system, *method) = self.equip(parameters);
    }
}

impl<S, I, F: FnMut(&LaneParameters<'_>) -> (S, I)> Equip<S, I> for F {
    fn equip(&mut self, parameters: &LaneParameters<'_>) -> (S, I) {
        self(parameters)
    }
}
