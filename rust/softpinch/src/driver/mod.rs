//! The drivers of simulations: one run, many runs, and runs that are stepped from outside.

mod contact_derivatives;
mod differentiated_run;
pub(crate) mod ensemble;
mod loops;
pub(crate) mod request;
pub(crate) mod sensitivities;
pub(crate) mod simulate;
pub(crate) mod simulator;
#[cfg(test)]
pub(crate) mod tests;
mod threads;

pub use ensemble::{Row, derivatives, ensemble};
pub use request::{COMPONENTS, Derivatives, Direction, DirectionEnd, QUANTITIES, Request, Shift};
pub use sensitivities::sensitivities;
pub(crate) use simulate::require_valid;
pub use simulate::{Outline, check, outline, simulate, stability_warning};
pub use simulator::{Observed, Simulator};
