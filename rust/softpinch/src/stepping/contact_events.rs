//! The events that end the modes of unilateral contact. Each has a value that is positive while the mode may
//! go on.

use crate::formulation::equations::States;
use crate::formulation::mode_selection::{Contact, contacts_in};
use crate::method::traits::Unsolved;
use crate::model::contact_modes::{Contacts, Mode};
use crate::model::geometry::index::{D_N, D_T, X, Y};
use crate::model::motion::Motion;
use crate::names::named;
use crate::number::lanes::{Bits, Lanes};

named! {
    /// What ends a mode.
    Cause;
    /// The causes by their public names. No change of a mode has the last one, which ends the run.
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
        /// The object is lost: a closed contact left its face, a free tip met the end of the face, or neither tip is
        /// beside its face.
        Lost = "lost",
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

/// How the object is lost. A finger is 0 for the right one, 1 for the left one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// The closed contact of this finger left its face.
    OffFace(usize),
    /// The free tip of this finger met the end of the face.
    MetEnd(usize),
    /// Both tips are free, and neither is beside its face.
    Apart,
}

/// Why a run ends at an event of its contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// The object is lost.
    Lost(Loss),
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
    pub(super) fn held(&self, tilts: [f64; 2]) -> Contacts<f64> {
        let modes = self.contacts.map(|contact| if contact.closed { Mode::Stick } else { Mode::Free });
        contacts_in(modes, &self.contacts, tilts)
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

/// Both contacts of the runs in all lanes at one instant, in so far as their modes depend on it.
pub(super) struct ContactState<'a, R> {
    pub(super) motion: &'a Motion<R>,
    pub(super) multipliers: &'a [R; 4],
    pub(super) residuals: [R; 4],
    /// The parts psi of grazing contacts.
    pub(super) share: [R; 2],
    /// The places of the contacts along their faces.
    pub(super) places: [R; 2],
    pub(super) friction: [R; 2],
    pub(super) half_height: R,
}

/// A condition under which the mode of a contact goes on.
pub(super) struct Condition<R> {
    /// What happens if it fails.
    pub(super) cause: Cause,
    /// The lanes whose mode has this condition.
    pub(super) asked: Bits,
    /// The condition fails where its value is negative.
    pub(super) value: R,
}

/// A gap, a slip velocity or a share that is zero when its mode begins may fail by this share of its terms, by
/// round-off.
const ROUND_OFF: f64 = 16.0 * f64::EPSILON;

/// The conditions under which the mode of contact `i` goes on. With `tolerant`, those that are zero when their mode
/// begins hold in spite of round-off.
#[inline(always)]
pub(super) fn conditions<R: Lanes>(
    at: &ContactState<'_, R>,
    contacts: &Contacts<R>,
    i: usize,
    tolerant: bool,
) -> [Condition<R>; 7] {
    let Motion { q, p, .. } = at.motion;
    let round_off = |sizes: [R; 3]| {
        let [a, b, c] = sizes.map(R::abs);
        R::constant(ROUND_OFF) * (a + b + c)
    };
    let (along, across, v) = (at.multipliers[i], at.multipliers[2 + i], at.residuals[2 + i]);
    let (free, graze, slip) = (contacts.free[i], contacts.graze[i], contacts.slip(i));
    let (d_n, places) = (q[D_N + i], at.places.map(R::abs));
    let mut forward = R::select(contacts.down[i], -v, v);
    let mut part = at.share[i].min_in(R::constant(1.0) - at.share[i], R::ALL);
    let mut gap = at.residuals[i];
    if tolerant {
        forward = forward + round_off([p[X], p[Y], p[D_T + i]]);
        part = part + R::constant(ROUND_OFF);
        gap = gap + round_off([q[X], q[Y], d_n]);
    }
    let both_free = contacts.free[0] & contacts.free[1];
    let nearest = R::select(both_free, places[0].min_in(places[1], R::ALL), places[i]);
    let condition = |cause, asked, value| Condition { cause, asked, value };
    [
        condition(Cause::Cone, !(slip | graze | free), at.friction[i] * along - across.abs()),
        condition(Cause::Stop, slip, forward),
        condition(Cause::Release, slip, along),
        condition(Cause::Share, graze, part),
        condition(Cause::Impact, free, gap.max_in(places[i] - at.half_height, R::ALL)),
        // A surface of a free tip that has come to rest stays at rest.
        condition(Cause::Relaxed, !(free & d_n.is_zero()), d_n),
        condition(Cause::Lost, !free | both_free, at.half_height - nearest),
    ]
}
