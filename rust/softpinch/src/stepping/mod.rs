//! The step loops, written over lanes: [`equal`] takes equal steps between breakpoints, [`adaptive`] such as the error allows. A lone run
//! is one lane, and what it records is done by its [`recorder`]; [`batch`] has what both loops do with the runs in their lanes.

// Several small arrays run in step: an index says so best.
#![allow(clippy::needless_range_loop)]

pub mod adaptive;
mod adaptive_lanes;
pub mod batch;
pub mod ending;
pub mod equal;
mod equal_lanes;
pub mod grid;
pub mod instant;
pub mod monitor;
pub mod options;
pub mod queue;
pub mod record;
pub mod recorder;
pub mod sizes;
pub mod status;
pub mod summary;
#[cfg(test)]
mod tests;
