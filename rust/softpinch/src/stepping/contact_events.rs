//! The events that end the modes of unilateral contact. Each has a value that is positive while the mode may
//! go on.

use crate::formulation::equations::States;
use crate::formulation::mode_selection::{Contact, contacts_in};
use crate::formulation::unilateral::ContactTerms;
use crate::method::traits::Unsolved;
use crate::model::contact_modes::{Contacts, Mode};
use crate::model::geometry::index::{D_N, D_T, X, Y};
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
    /// The object is lost: a closed contact left its face, a free tip met the end of the face, or neither tip is
    /// beside its face.
    Lost,
}

/// The causes of a change of mode by their public names.
pub const CAUSES: [(&str, Cause); 8] = [
    ("input", Cause::Input),
    ("cone", Cause::Cone),
    ("stop", Cause::Stop),
    ("release", Cause::Release),
    ("share", Cause::Share),
    ("impact", Cause::Impact),
    ("relaxed", Cause::Relaxed),
    ("other", Cause::Other),
];

impl Cause {
    /// The public name of the cause.
    #[must_use]
    pub fn name(self) -> &'static str {
        CAUSES.iter().find(|(_, cause)| *cause == self).map_or("", |&(name, _)| name)
    }
}

/// A change of a contact's mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Time, s.
    pub time: f64,
    /// 0 for the right finger, 1 for the left one.
    pub finger: usize,
    /// The mode before.
    pub before: Mode,
    /// The mode after.
    pub after: Mode,
    /// What ended the mode before.
    pub cause: Cause,
}

/// Why a run ends at an event of its contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// The object is lost.
    Lost,
    /// More than [`MOST_EVENTS`](crate::stepping::event_stepper::MOST_EVENTS) events within one step.
    Chattering,
    /// No mode of the contacts is admissible.
    NoMode,
    /// The equations of a step were not solved.
    Unsolved(Unsolved),
    /// A number overflowed.
    NotFinite,
}

/// The end of a run at an event of its contacts.
#[derive(Debug, Clone, Copy)]
pub struct ContactEnd {
    /// Why the run ends.
    pub reason: Reason,
    /// The time since the start of the segment, s.
    pub tau: f64,
    /// The state at this time.
    pub y: States<f64>,
}

/// The contacts of one run, and the changes of their modes.
#[derive(Debug, Clone)]
pub struct ContactRun {
    /// Both contacts.
    pub contacts: [Contact; 2],
    /// The start of the segment to which times refer, s.
    pub anchor: f64,
    /// The changes of modes since the list was emptied.
    pub changes: Vec<Change>,
}

impl ContactRun {
    /// The contacts at the start of a run.
    #[must_use]
    pub fn new(contacts: [Contact; 2]) -> Self {
        Self { contacts, anchor: 0.0, changes: Vec::new() }
    }

    /// The modes of both contacts.
    #[must_use]
    pub fn modes(&self) -> [Mode; 2] {
        self.contacts.map(|contact| contact.mode)
    }

    /// The contacts as the energies of a motion need them: free where they are not closed.
    pub(super) fn held(&self, q: &[f64; 9]) -> Contacts<f64> {
        let modes = self.contacts.map(|contact| if contact.closed { Mode::Stick } else { Mode::Free });
        contacts_in(modes, &self.contacts, q)
    }
}

/// An event of one contact, which is due where its value is negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// 0 for the right finger, 1 for the left one.
    pub finger: usize,
    /// What happens.
    pub cause: Cause,
}

/// The events of both contacts that are due at an instant, with their values.
pub(super) fn due(
    modes: [Mode; 2],
    half_height: f64,
    terms: &ContactTerms<f64>,
    motion: &Motion<f64>,
) -> Vec<(Event, f64)> {
    let mut found = Vec::new();
    for finger in 0..2 {
        for (cause, value) in values(modes, half_height, finger, terms, motion).into_iter().flatten() {
            if value < 0.0 {
                found.push((Event { finger, cause }, value));
            }
        }
    }
    found
}

/// A gap, a slip velocity or a share that is zero when its mode begins may fail by this share of its terms, by
/// round-off.
const ROUND_OFF: f64 = 16.0 * f64::EPSILON;

/// The values of the events of one contact: each is positive while the modes may go on.
pub(super) fn values(
    modes: [Mode; 2],
    half_height: f64,
    i: usize,
    terms: &ContactTerms<f64>,
    motion: &Motion<f64>,
) -> [Option<(Cause, f64)>; 4] {
    let (along, across) = (terms.response.multipliers[i], terms.response.multipliers[2 + i]);
    let residuals = terms.geometry.residuals();
    let share = terms.response.share[i];
    let places = terms.geometry.places().map(f64::abs);
    let Motion { q, p, .. } = motion;
    let d_n = q[D_N + i];
    let gap = residuals[i] + ROUND_OFF * (q[X].abs() + q[Y].abs() + d_n.abs());
    let slack = ROUND_OFF * (p[X].abs() + p[Y].abs() + p[D_T + i].abs());
    let relaxed = Some((Cause::Relaxed, d_n));
    let on_face = Some((Cause::Lost, half_height - places[i]));
    match modes[i] {
        Mode::Stick => {
            [Some((Cause::Cone, terms.friction[i] * along - across.abs())), None, relaxed, on_face]
        }
        Mode::Slip(direction) => [
            Some((Cause::Stop, direction.sign() * residuals[2 + i] + slack)),
            Some((Cause::Release, along)),
            relaxed,
            on_face,
        ],
        Mode::Graze => [Some((Cause::Share, share.min(1.0 - share) + ROUND_OFF)), None, relaxed, on_face],
        Mode::Free => {
            let both_free = modes == [Mode::Free; 2];
            [
                Some((Cause::Impact, gap.max(places[i] - half_height))),
                None,
                // A surface that has come to rest stays at rest.
                relaxed.filter(|_| d_n != 0.0),
                both_free.then_some((Cause::Lost, half_height - places[0].min(places[1]))),
            ]
        }
    }
}
