//! The events that end the modes of unilateral contact. Each has a value that is positive while the mode may
//! go on.

use crate::formulation::mode_selection::Contact;
use crate::formulation::unilateral::ContactTerms;
use crate::model::contact_modes::Mode;
use crate::model::geometry::index::D_N;
use crate::model::motion::Motion;

/// What ends a mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The start of the run, a breakpoint of an input, or an impulse: the modes were chosen anew.
    Input,
    /// A sticking contact reached the border of the friction cone.
    Cone,
    /// A slip stopped.
    Stop,
    /// lambda^H of a slipping contact reached zero.
    Release,
    /// The part psi of a grazing contact reached zero or one.
    Share,
    /// A free tip met the face.
    Impact,
    /// The surface of a tip was no longer compressed.
    Relaxed,
    /// An event of the other contact.
    Other,
}

/// A change of a contact's mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Time since the start of the segment, s.
    pub tau: f64,
    /// 0 for the right finger, 1 for the left one.
    pub finger: usize,
    /// The mode before.
    pub before: Mode,
    /// The mode after.
    pub after: Mode,
    /// What ended the mode before.
    pub cause: Cause,
}

/// The end of a run at a contact's event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContactEnd {
    /// More than [`MOST_EVENTS`](crate::stepping::event_stepper::MOST_EVENTS) events within one step.
    Chattering,
    /// No mode of the contacts is admissible.
    NoMode,
    /// A step was not solved, or its numbers are not finite.
    NotSolved,
}

/// The contacts of one run, and what happened to them.
#[derive(Debug, Clone)]
pub struct ContactRun {
    /// Both contacts.
    pub contacts: [Contact; 2],
    /// The changes of modes since the list was emptied.
    pub changes: Vec<Change>,
    /// Kinetic energy that impacts have taken, J.
    pub impact_loss: f64,
    /// Energy that the ends of relaxations have taken, J.
    pub stop_loss: f64,
}

impl ContactRun {
    /// The contacts at the start of a run.
    #[must_use]
    pub fn new(contacts: [Contact; 2]) -> Self {
        Self { contacts, changes: Vec::new(), impact_loss: 0.0, stop_loss: 0.0 }
    }
}

/// An event of one contact, which is due where its value is negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Event {
    pub(super) finger: usize,
    pub(super) cause: Cause,
}

/// The events of both contacts that are due at an instant, with their values.
pub(super) fn due(run: &ContactRun, terms: &ContactTerms<f64>, motion: &Motion<f64>) -> Vec<(Event, f64)> {
    let mut found = Vec::new();
    for finger in 0..2 {
        let own = values(run.contacts[finger].mode, finger, terms, motion);
        for (cause, value) in own.into_iter().flatten() {
            if value < 0.0 {
                found.push((Event { finger, cause }, value));
            }
        }
    }
    found
}

/// The values of a mode's events: each is positive while the mode may go on.
pub(super) fn values(
    mode: Mode,
    i: usize,
    terms: &ContactTerms<f64>,
    motion: &Motion<f64>,
) -> [Option<(Cause, f64)>; 3] {
    let (along, across) = (terms.response.multipliers[i], terms.response.multipliers[2 + i]);
    let residuals = terms.geometry.residuals();
    let share = terms.response.share[i];
    let d_n = motion.q[D_N + i];
    let relaxed = |at_rest: bool| (!(at_rest && d_n == 0.0)).then_some((Cause::Relaxed, d_n));
    match mode {
        Mode::Stick => [Some((Cause::Cone, terms.friction[i] * along - across.abs())), None, relaxed(false)],
        Mode::Slip(direction) => [
            Some((Cause::Stop, direction.sign() * residuals[2 + i])),
            Some((Cause::Release, along)),
            relaxed(false),
        ],
        Mode::Graze => [Some((Cause::Share, share.min(1.0 - share))), None, relaxed(false)],
        Mode::Free => [Some((Cause::Impact, residuals[i])), None, relaxed(true)],
    }
}
