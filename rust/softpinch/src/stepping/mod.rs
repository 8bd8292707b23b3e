//! The step loops, written over lanes: [`equal`] takes equal steps between breakpoints, [`adaptive`] such as the error allows. A lone run
//! is one lane, and what it records is done by its [`recorder`]; [`batch`] has what both loops do with the runs in their lanes.

// Several small arrays run in step: an index says so best.
#![allow(clippy::needless_range_loop)]

pub mod adaptive;
pub mod batch;
pub mod ending;
pub mod equal;
pub mod recorder;
mod sizes;
#[cfg(test)]
mod tests;
