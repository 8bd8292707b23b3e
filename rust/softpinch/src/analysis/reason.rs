//! The reasons why a scene has no equilibrium.

use std::fmt::{self, Display, Formatter};

use crate::error::brief;
use crate::stepping::monitor::Violation;
use crate::stepping::status::Status;

/// Why there is no equilibrium; as text, what follows "no equilibrium: ".
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// The tips do not reach the object at these angles of the fingers; the gap in m.
    Apart(f64),
    /// The state near which an equilibrium is sought is outside the range of the model.
    Outside(Violation),
    /// The scene changes slowly, and at this share of the change the equilibrium ends in a fold, or leaves the range of
    /// the model.
    Ends(Way, f64, Option<Violation>),
    /// No start leads to an equilibrium, or not the one that is given.
    NotFound {
        /// Whether a start is given.
        near: bool,
    },
}

/// A slow change of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// The weight and the other forces on the object are put on.
    Load,
    /// The object, which is held in a state, is released.
    Release,
    /// One scene becomes another.
    Change,
}

impl Reason {
    /// The public name of the reason.
    pub fn name(&self) -> &'static str {
        match *self {
            Self::Apart(_) => "apart",
            Self::Outside(violation) | Self::Ends(_, _, Some(violation)) => Status::of(violation).name(),
            Self::Ends(Way::Load, _, None) => "overloaded",
            Self::Ends(..) | Self::NotFound { .. } => "not_found",
        }
    }
}

impl Display for Reason {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Apart(gap) => write!(
                out,
                "at these angles of the fingers the object would have to be {} mm wider, unless it is turned between the tips",
                brief(1e3 * gap)
            ),
            Self::Outside(violation) => {
                write!(out, "in the state near which it is sought a tip is {}", Status::of(violation).name())
            }
            Self::Ends(way, share, violation) => {
                // A share below zero is round-off.
                let percent = (1e6 * share.max(0.0)).round() / 1e4;
                match way {
                    Way::Load => write!(out, "at {percent} % of the load (weight and forces) ")?,
                    Way::Release => write!(
                        out,
                        "if the object is held in this state and released slowly, after {percent} % of the release "
                    )?,
                    Way::Change => write!(out, "after {percent} % of the change ")?,
                }
                match violation {
                    Some(violation) => write!(out, "a tip is {}", Status::of(violation).name()),
                    None => write!(out, "the balance ends"),
                }
            }
            Self::NotFound { near: true } => write!(out, "none was found from this state"),
            Self::NotFound { near: false } => write!(out, "none was found from any start"),
        }
    }
}
