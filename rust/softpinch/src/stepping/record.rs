//! A finished run, and its recording, which keeps only the quantities that were asked for, row by row.

use crate::error::{Error, Result};
use crate::method::Stats;
use crate::model::{BILATERAL_WORKS, CONTACT_WORKS, ContactRow, Energies, RELAXATIONS, WORKS};
use crate::stepping::{COUNT, Change, Instant, Status, VIOLATIONS};

/// The contacts of bilateral contact.
const STICKING: ContactRow = [1.0, 1.0, 0.0, 0.0];

/// Largest recording, in numbers: 16 GiB.
pub(super) const MOST_VALUES: f64 = 2_147_483_648.0;

/// An empty vector with room for `entries`, a number that comes from a user. The error says that no machine
/// has so much memory, or that this one has not; `what` names the numbers in it.
pub fn reserved<T>(what: &'static str, entries: usize) -> Result<Vec<T>> {
    let needed = entries as f64 * (size_of::<T>() as f64 / size_of::<f64>() as f64);
    let refused = |advice| Error::TooLarge { what, needed, limit: MOST_VALUES, advice };
    if needed > MOST_VALUES {
        return Err(refused("ask for fewer"));
    }
    let mut room = Vec::new();
    room.try_reserve_exact(entries)
        .map_err(|_| refused("this machine has no room for them at present, ask for fewer"))?;
    Ok(room)
}

/// What the rows of a run have because of its method and its contacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Layout {
    /// Whether a row with a state also has the point at which the method's Jacobian was taken.
    pub keeps_jacobian: bool,
    /// Whether contacts can slip and open.
    pub unilateral: bool,
    /// Whether the hand moves.
    pub moves: bool,
    /// Length of the state of the run's discrete controller; 0 if it has none.
    pub controller: usize,
    /// Number of states of Maxwell branches.
    pub relaxation: usize,
}

impl Layout {
    /// Number of columns of the point at which the method's Jacobian was taken.
    pub fn point(self) -> usize {
        if self.keeps_jacobian { 21 + self.relaxation } else { 0 }
    }

    /// Number of columns of the energy ledger.
    pub fn energies(self) -> usize {
        3 + match (self.moves, self.unilateral) {
            (true, _) => WORKS,
            (false, true) => CONTACT_WORKS,
            (false, false) => BILATERAL_WORKS,
        }
    }
}

/// The quantities that a run records.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Selection {
    /// q, p and memories.
    pub state: bool,
    /// lambda.
    pub multipliers: bool,
    /// C^H and C^N.
    pub residuals: bool,
    /// The energy ledger. If it is recorded, the state carries its integrals.
    pub energy: bool,
    /// The torques on the fingers.
    pub torque: bool,
    /// The modes of the contacts.
    pub contact: bool,
}

impl Selection {
    /// Number of values in a row, including its time.
    pub fn width(&self, layout: Layout) -> u64 {
        1 + (22 + layout.relaxation + layout.controller) as u64 * u64::from(self.state)
            + layout.point() as u64 * u64::from(self.state)
            + 4 * u64::from(self.multipliers)
            + 4 * u64::from(self.residuals)
            + layout.energies() as u64 * u64::from(self.energy)
            + 2 * u64::from(self.torque)
            + 4 * u64::from(self.has_contacts(layout))
    }

    /// Whether a row has the contacts. A row with a state needs them in unilateral contact.
    fn has_contacts(&self, layout: Layout) -> bool {
        self.contact || self.state && layout.unilateral
    }
}

/// Finds whether a quantity is selected.
pub type Quantity = fn(&mut Selection) -> &mut bool;

/// The quantities that can be recorded, by their public names.
pub const RECORDABLE: [(&str, Quantity); 6] = [
    ("state", |selection| &mut selection.state),
    ("multipliers", |selection| &mut selection.multipliers),
    ("residuals", |selection| &mut selection.residuals),
    ("energy", |selection| &mut selection.energy),
    ("torque", |selection| &mut selection.torque),
    ("contact", |selection| &mut selection.contact),
];

impl FromIterator<Quantity> for Selection {
    fn from_iter<I: IntoIterator<Item = Quantity>>(quantities: I) -> Self {
        let mut selection = Self::default();
        for quantity in quantities {
            *quantity(&mut selection) = true;
        }
        selection
    }
}

/// The rows of a run. Quantities that were not selected stay empty.
#[derive(Debug, Clone, Default)]
#[allow(missing_docs)] // of what is named as everywhere
pub struct Recording {
    pub selection: Selection,
    pub layout: Layout,
    /// Time of each row.
    pub t: Vec<f64>,
    /// Start of the segment of each row.
    pub grid_anchor: Vec<f64>,
    /// Steps from the start of the segment to each row.
    pub grid_step: Vec<u64>,
    pub q: Vec<[f64; 9]>,
    pub p: Vec<[f64; 9]>,
    pub memory: Vec<[f64; 2]>,
    /// The point of the Jacobian in use, NaN if there is none. Empty for methods that keep no Jacobian.
    pub linearized: Vec<f64>,
    /// The states of Maxwell branches, row by row.
    pub relaxation: Vec<f64>,
    pub multipliers: Vec<[f64; 4]>,
    pub residuals: Vec<[f64; 4]>,
    /// Energies and works, row by row: 7 numbers in bilateral contact, 10 in unilateral contact, 11 if the hand moves.
    pub energy: Vec<f64>,
    pub torque: Vec<[f64; 2]>,
    pub contact: Vec<ContactRow>,
    /// The states of the run's discrete controller, row by row.
    pub controller: Vec<f64>,
}

impl Recording {
    /// A recording with room for `rows` rows. The error says that there is no memory for them.
    pub fn with_capacity(selection: Selection, layout: Layout, rows: u64) -> Result<Self> {
        let mut recording = Self { selection, layout, ..Self::default() };
        recording.reserve(rows)?;
        Ok(recording)
    }

    /// Makes room for one more row, and for the last row after it, if the number of rows is not known beforehand.
    #[inline(always)]
    pub fn make_room(&mut self) -> Result {
        let rows = self.t.len();
        if rows + 1 < self.t.capacity() { Ok(()) } else { self.reserve(2 * rows as u64 + 64) }
    }

    /// Makes room for `rows` rows in all.
    fn reserve(&mut self, rows: u64) -> Result {
        let selection = self.selection;
        let layout = self.layout;
        let width = selection.width(layout);
        let needed = rows as f64 * width as f64;
        let (what, advice) = ("the recording, in numbers,", "raise every= or record less");
        let too_large = || Error::TooLarge { what, needed, limit: MOST_VALUES, advice };
        if needed > MOST_VALUES {
            return Err(too_large());
        }
        let more = usize::try_from(rows).map_err(|_| too_large())?.saturating_sub(self.t.len());
        let room = |wanted: bool| if wanted { more } else { 0 };
        let (for_state, energies) = (room(selection.state), room(selection.energy));
        let rooms = [
            self.t.try_reserve_exact(more),
            self.q.try_reserve_exact(for_state),
            self.p.try_reserve_exact(for_state),
            self.memory.try_reserve_exact(for_state),
            self.grid_anchor.try_reserve_exact(for_state),
            self.grid_step.try_reserve_exact(for_state),
            self.linearized.try_reserve_exact(for_state.saturating_mul(layout.point())),
            self.relaxation.try_reserve_exact(for_state.saturating_mul(layout.relaxation)),
            self.controller.try_reserve_exact(for_state.saturating_mul(layout.controller)),
            self.multipliers.try_reserve_exact(room(selection.multipliers)),
            self.residuals.try_reserve_exact(room(selection.residuals)),
            self.energy.try_reserve_exact(energies.saturating_mul(layout.energies())),
            self.torque.try_reserve_exact(room(selection.torque)),
            self.contact.try_reserve_exact(room(selection.has_contacts(layout))),
        ];
        if rooms.iter().any(Result::is_err) { Err(too_large()) } else { Ok(()) }
    }

    /// Adds a row, with the state of the run's discrete controller. `energies` is called only if they are recorded.
    #[inline(always)]
    pub fn push(&mut self, instant: &Instant, controller: &[f64], energies: impl FnOnce() -> Energies) {
        self.t.push(instant.t);
        if self.selection.state {
            self.q.push(instant.motion.q.row());
            self.p.push(instant.motion.p.row());
            self.memory.push(instant.motion.memory);
            self.grid_anchor.push(instant.grid.0);
            self.grid_step.push(instant.grid.1);
            let point = instant.linearized.unwrap_or([f64::NAN; 21 + RELAXATIONS]);
            self.linearized.extend_from_slice(&point[..self.layout.point()]);
            self.relaxation.extend_from_slice(&instant.motion.relaxation[..self.layout.relaxation]);
            self.controller.extend_from_slice(controller);
        }
        if self.selection.multipliers {
            self.multipliers.push(instant.multipliers);
        }
        if self.selection.residuals {
            self.residuals.push(instant.residuals);
        }
        if self.selection.energy {
            let Energies { kinetic, elastic, gravity } = energies();
            self.energy.extend_from_slice(&[kinetic, elastic, gravity]);
            self.energy.extend_from_slice(&instant.works[..self.layout.energies() - 3]);
        }
        if self.selection.torque {
            self.torque.push(instant.torque);
        }
        if self.selection.has_contacts(self.layout) {
            self.contact.push(instant.contact.unwrap_or(STICKING));
        }
    }
}

/// A finished run.
#[derive(Debug, Clone)]
pub struct Run {
    /// The rows, if the run was recorded.
    pub recording: Recording,
    /// The last instant, whether or not it was recorded.
    pub last: Instant,
    /// The state of its discrete controller at the last instant, if it has one.
    pub controller: Option<Vec<f64>>,
    /// The energies at the start of the run, if the ledger was carried.
    pub initial_energies: Option<Energies>,
    /// The status with which it ended.
    pub status: Status,
    /// The status in words, with the numbers; empty if a run that is not recorded has reached its end.
    pub message: String,
    /// The time at which each of [`VIOLATIONS`] was first seen, s; NaN if it was not.
    pub first_times: [f64; VIOLATIONS.len()],
    /// In a recorded run: the intervals of time during which each of these violations was seen, s: the first and the
    /// last of consecutive watched instants that show it.
    pub violation_intervals: Vec<(&'static str, Vec<[f64; 2]>)>,
    /// In a recorded run: the changes of the contacts' modes, in unilateral contact.
    pub contact_changes: Vec<Change>,
    /// Whether the grasp held: the run reached its end, and from `summaries.after` on no tip pulled and, if
    /// the scene has friction, none needed more.
    pub holds: bool,
    /// The summaries, in the order of [`SUMMARIES`](crate::stepping::summary::SUMMARIES).
    pub summaries: [f64; COUNT],
    /// Counts of the work. Steps and segments are those of this run. The other counts are those of its loop,
    /// which are the run's own in a loop of one lane.
    pub stats: Stats,
}

impl Run {
    /// The violations that the monitors have seen, with their first times.
    pub fn violations(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let times = VIOLATIONS.map(|(name, _)| name).into_iter().zip(self.first_times);
        times.filter(|(_, first)| !first.is_nan())
    }
}
