//! The step loops, written over lanes. `equal` takes equal steps between breakpoints, `adaptive` takes
//! steps as long as the error allows. A single run is one lane, and a `recorder` records it. `batch` has
//! the work of both loops on the runs in their lanes.

pub(crate) mod adaptive;
mod adaptive_events;
mod adaptive_lanes;
pub(crate) mod batch;
mod batch_events;
mod contact_changes;
pub(crate) mod contact_events;
pub(crate) mod contact_lane;
#[cfg(test)]
mod contact_tests;
pub(crate) mod ending;
pub(crate) mod equal;
mod equal_events;
mod equal_lanes;
mod event_search;
pub(crate) mod grid;
pub(crate) mod instant;
pub(crate) mod intervals;
pub(crate) mod lane_controller;
mod lone_steps;
pub(crate) mod monitor;
pub(crate) mod options;
pub(crate) mod phase;
pub(crate) mod record;
pub(crate) mod recorder;
pub(crate) mod sizes;
pub(crate) mod summary;
#[cfg(test)]
mod tests;

pub(crate) use adaptive::AdaptiveSteps;
pub(crate) use adaptive_lanes::{AdaptiveLanes, StepStart, merged};
pub(crate) use batch::{Finished, LaneBatch, LoopSystem, POLL, RunLoop, RunQueue, Seen, Taken};
pub use contact_events::Change;
pub(crate) use contact_events::{Cause, ContactRun, Event, Passage};
pub(crate) use contact_lane::{LaneContact, Moment};
pub(crate) use ending::{
    ContactEnd, End, EventResult, Loss, MOST_EVENTS, Reason, completed, full, interruption, overflow,
};
pub use ending::{STATUSES, Status, arrival};
pub(crate) use equal::EqualSteps;
pub(crate) use equal_lanes::{EqualLanes, Instants, RowsInside};
pub(crate) use event_search::{EventStepper, SegmentState};
pub(crate) use grid::{Grid, GridOf, MOST_STEPS, Segment, Span, round_off};
pub(crate) use instant::{Instant, all_finite, column, put, watched};
pub(crate) use lane_controller::LaneController;
pub(crate) use monitor::{Limits, Margins, STOP_ON, ViolationSet};
pub use monitor::{VIOLATIONS, Violation};
pub use options::{MAX_STEPS, Options, Steps};
pub(crate) use phase::Phase;
pub(crate) use record::Selection;
pub use record::{COLUMNS, Column, RECORDABLE, Recordable, Recording, Run, reserved};
pub(crate) use recorder::{Due, Recorder};
pub(crate) use sizes::Sizes;
pub(crate) use summary::{COUNT, Summaries, SummaryInstant, SummarySet};
pub use summary::{SUMMARIES, Summary, UNITS, Wanted};
