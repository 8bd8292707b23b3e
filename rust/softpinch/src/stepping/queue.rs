//! The interface between step loops and their callers: the source and the destination of runs.

use std::borrow::Cow;

use crate::error::Result;
use crate::model::Scene;
use crate::stepping::{LaneContact, Recorder, Run};

/// Number of steps or attempts after which a loop asks whether to stop. They take a few milliseconds.
pub const POLL: u64 = 1 << 12;

/// A run before it begins.
pub struct Taken<'a> {
    pub number: usize,
    pub scene: Cow<'a, Scene>,
    /// The contacts of an earlier run with the same parameters, if they were kept.
    pub contact: Option<Box<LaneContact>>,
}

/// The source and the destination of the runs of a step loop, which is compiled once for all of them.
pub struct RunQueue<'a> {
    /// The next run, or `None` if there is none.
    pub take: &'a mut dyn FnMut() -> Result<Option<Taken<'a>>>,
    /// Whether the caller wants to stop.
    pub stops: &'a dyn Fn() -> bool,
    /// Takes a run that has ended.
    pub finish: &'a mut dyn FnMut(Finished),
    /// Records the run of a loop of one lane.
    pub recorder: Recorder<'a>,
}

pub struct Finished {
    pub number: usize,
    /// The run, which the loop itself does not record.
    pub run: Run,
    /// Its contacts, in unilateral contact.
    pub contact: Option<Box<LaneContact>>,
}
