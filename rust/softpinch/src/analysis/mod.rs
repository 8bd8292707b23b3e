//! A scene at one state: every term of (24), the linearised motion; and where a scene comes to rest.
//!
//! | file | contents |
//! |---|---|
//! | `evaluate.rs` | every term of (24) at one state, as matrices |
//! | `linear.rs` | the motion linearised about one state, with inputs and outputs |
//! | `balance.rs` | the equations of a state at rest, and the family of their solutions |
//! | `rest.rs`, `starts.rs` | Newton's method for them, and where it begins |
//! | `continuation.rs` | how an equilibrium changes with the scene |
//! | `equilibrium.rs` | the search for an equilibrium, what is said of one, and why there is none |
//! | `wrench.rs` | the largest wrench that an equilibrium bears |

pub(crate) mod balance;
mod continuation;
pub(crate) mod equilibrium;
pub(crate) mod evaluate;
pub(crate) mod linear;
pub(crate) mod rest;
mod starts;
pub(crate) mod wrench;

pub(crate) use balance::UNKNOWNS;
pub use balance::{Member, RestScene, Unknowns};
pub(crate) use continuation::{End, follow};
pub use equilibrium::{Reason, continued, find, neutral, violations};
pub use evaluate::{Matrix, Terms, contacts, evaluate};
pub use linear::{LinearModel, Problem, Setting};
pub use rest::Rest;
pub use wrench::{Load, largest_multiple};
