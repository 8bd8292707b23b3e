//! The interface between step loops and their callers: the source and the destination of runs, and the
//! equations and methods for them.

use std::borrow::Cow;

use crate::error::Result;
use crate::formulation::Contact;
use crate::model::{ControllerState, Energies, Scene};
use crate::stepping::{Change, Instant, LaneContact, Run, ViolationSet};

/// Number of steps or attempts after which a loop asks whether to stop. They take a few milliseconds.
pub const POLL: u64 = 1 << 12;

/// A run before it begins.
pub struct Taken<'a> {
    pub number: usize,
    pub scene: Cow<'a, Scene>,
    /// The contacts of an earlier run with the same parameters, if they were kept.
    pub contact: Option<Box<LaneContact>>,
}

/// The source and the destination of the runs of a step loop. Only loops of one lane record runs.
pub trait RunQueue<'a> {
    /// The next run, or `None` if there is none.
    fn take(&mut self) -> Result<Option<Taken<'a>>>;

    fn stops(&mut self) -> bool;

    /// Takes a run that has ended. `energies` computes those of its last instant.
    fn finish(&mut self, finished: Finished, energies: impl FnOnce() -> Energies);

    /// Whether to record the instant `t`, which was just watched. One inside a step is recorded only if asked for.
    #[inline(always)]
    fn is_due(&mut self, _t: f64, _inside: bool) -> bool {
        false
    }

    /// Takes the violations that hold at the instant `t`, which was just watched. Instants that show none
    /// are left out, except the first after others.
    #[inline(always)]
    fn note(&mut self, _t: f64, _found: ViolationSet) {}

    /// Takes the contacts of a run with unilateral contact: at its start, and after each change of a mode.
    fn note_contacts(&mut self, _t: f64, _contacts: &[Contact; 2], _change: Option<&Change>) {}

    /// Takes the state of the run's discrete controller, before an instant is recorded.
    fn keep_controller(&mut self, _state: &ControllerState) {}

    /// Records an instant. The error says that there is no memory for it.
    fn record(&mut self, _watched: &Instant, _energies: impl FnOnce() -> Energies) -> Result {
        Ok(())
    }

    /// The first instant that was asked for and is not recorded yet; infinity if there is none.
    #[inline(always)]
    fn next_time(&self) -> f64 {
        f64::INFINITY
    }
}

pub struct Finished {
    pub number: usize,
    /// The run, which the loop itself does not record.
    pub run: Run,
    /// Its contacts, in unilateral contact.
    pub contact: Option<Box<LaneContact>>,
}
