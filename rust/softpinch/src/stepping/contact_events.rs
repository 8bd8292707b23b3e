//! The events that end the modes of unilateral contact, and the changes of the modes.

use crate::formulation::{Contact, ContactJump, contacts_in};
use crate::model::{Contacts, Mode};
use crate::names::named;
use crate::number::Lanes;

named! {
    /// What ends a mode.
    Cause;
    /// No change of a mode has the last three, which end the run.
    CAUSES = {
        /// The start of the run, a breakpoint of an input, or an impulse: the modes were chosen anew.
        Input = "input",
        /// A sticking contact reached the border of the friction cone.
        Cone = "cone",
        /// A slip stopped.
        Stop = "stop",
        /// lambda^H of a slipping contact reached zero.
        Release = "release",
        /// The part psi of a grazing contact reached zero or one.
        Share = "share",
        /// A free tip met the face.
        Impact = "impact",
        /// The surface of a tip was no longer compressed.
        Relaxed = "relaxed",
        /// An event of the other contact.
        Other = "other",
        /// The object is lost: a closed contact left its face, a free tip met its end, or neither tip is beside it.
        Lost = "lost",
        /// A closed tip was pressed flat, or tilted by 90 degrees, and the run was to end there.
        Crushed = "crushed",
        Folded = "folded",
    }
}

/// A change of a contact's mode.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(missing_docs)] // of fields that their types explain
pub struct Change {
    pub time: f64,
    /// 0 for the right finger, 1 for the left one.
    pub finger: usize,
    pub before: Mode,
    pub after: Mode,
    pub cause: Cause,
}

/// What happens to a run at its events, as numbers with derivatives follow it.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Passage {
    /// A step of this length leads to an event.
    Step(f64, Event),
    Jump(ContactJump),
    /// From here on the contacts are these, after so many changes of modes.
    Modes([Contact; 2], usize),
    /// What happens has no derivative.
    Undefined(&'static str),
}

/// The contacts of one run, and the changes of their modes.
#[derive(Debug, Clone)]
pub(crate) struct ContactRun {
    pub contacts: [Contact; 2],
    /// The start of the segment to which times refer, s.
    pub anchor: f64,
    /// The changes of modes since the list was emptied.
    pub changes: Vec<Change>,
    pub log: Vec<Passage>,
}

impl ContactRun {
    pub fn new(contacts: [Contact; 2]) -> Self {
        Self { contacts, anchor: 0.0, changes: Vec::new(), log: Vec::new() }
    }

    pub fn modes(&self) -> [Mode; 2] {
        self.contacts.map(|contact| contact.mode)
    }

    pub fn put_into<R: Lanes>(&self, contacts: &mut Contacts<R>, lane: usize) {
        let [right, left] = &self.contacts;
        contacts.set(lane, [right.mode, left.mode], [right.frozen_tilt, left.frozen_tilt]);
    }

    /// The contacts as the energies of a motion need them: free where they are not closed.
    pub(super) fn held(&self, tilts: [f64; 2]) -> Contacts<f64> {
        let modes = self.contacts.map(|contact| if contact.closed { Mode::Stick } else { Mode::Free });
        contacts_in(modes, &self.contacts, tilts)
    }
}

/// An event of one contact, which is due where its value is negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Event {
    pub finger: usize,
    pub cause: Cause,
}
