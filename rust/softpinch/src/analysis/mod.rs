//! A scene at one state: every term of (24), the linearised motion; and where a scene comes to rest.

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
