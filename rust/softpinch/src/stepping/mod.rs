//! The step loops, written over lanes. `equal` takes equal steps between breakpoints, `adaptive` takes
//! steps as long as the error allows. A single run is one lane, and a `recorder` records it. `batch` has
//! the work of both loops on the runs in their lanes.
//!
//! Events of unilateral contact: [`monitor`] has the conditions that end a mode, `event_search.rs` locates events on
//! the method's own step, `contact_changes.rs` lets them happen. `contact_lane` does this for the run in a lane,
//! `equal_events.rs` and `adaptive_events.rs` are its use in the two loops.

pub(crate) mod adaptive;
mod adaptive_events;
mod adaptive_lanes;
pub(crate) mod batch;
mod contact_changes;
pub mod contact_events;
pub(crate) mod contact_lane;
#[cfg(test)]
mod contact_tests;
pub mod ending;
pub(crate) mod equal;
mod equal_events;
mod equal_lanes;
mod event_search;
pub(crate) mod grid;
pub(crate) mod instant;
pub(crate) mod intervals;
pub(crate) mod lane_controller;
mod lone_steps;
pub mod monitor;
pub mod options;
pub(crate) mod phase;
pub(crate) mod queue;
pub mod record;
pub(crate) mod recorder;
pub(crate) mod sizes;
pub mod summary;
#[cfg(test)]
mod tests;
