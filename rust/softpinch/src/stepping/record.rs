//! A finished run, and its recording, which keeps only the quantities that were asked for, row by row.

use crate::error::{Error, Result};
use crate::method::Stats;
use crate::model::{ContactRow, Energies, Motion, RELAXATIONS};
use crate::names::{named, set};
use crate::stepping::{COUNT, Change, Instant, Status, VIOLATIONS};

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

named! {
    /// A quantity that a run can record.
    Recordable;
    RECORDABLE = {
        /// q, p and memories.
        State = "state",
        /// lambda.
        Multipliers = "multipliers",
        /// C^H and C^N.
        Residuals = "residuals",
        /// The energy ledger. If it is recorded, the state carries its integrals.
        Energy = "energy",
        /// The torques on the fingers.
        Torque = "torque",
        /// The modes of the contacts.
        Contact = "contact",
    }
}

set! {
    /// The quantities that a run records.
    Selection of Recordable
}

named! {
    /// The numbers of a recording that are of one kind.
    #[allow(missing_docs)] // of what is named as everywhere
    Column;
    COLUMNS = {
        T = "t",
        /// Start of the segment of the row.
        GridAnchor = "grid_anchor",
        /// Steps from the start of the segment to the row, far below 2^53.
        GridStep = "grid_step",
        Q = "q",
        P = "p",
        Memory = "integral",
        /// The point of the Jacobian in use, NaN if there is none, for methods that keep one.
        Linearized = "linearized",
        /// The states of Maxwell branches.
        Relaxation = "relaxation",
        Controller = "controllers",
        Multipliers = "multipliers",
        Residuals = "residuals",
        Energy = "energy",
        Torque = "torque",
        /// The contacts of a run in unilateral contact, from which another one goes on.
        Contacts = "contacts",
        Modes = "contact",
    }
}

/// The rows of a run.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// How many numbers a row has in each column; zero in those that are not recorded.
    pub widths: [usize; COLUMNS.len()],
    /// The numbers of each column, row by row.
    pub columns: [Vec<f64>; COLUMNS.len()],
}

impl Recording {
    /// A recording with room for `rows` rows. The error says that there is no memory for them.
    pub fn with_capacity(widths: [usize; COLUMNS.len()], rows: u64) -> Result<Self> {
        let mut recording = Self { widths, ..Self::default() };
        recording.reserve(rows)?;
        Ok(recording)
    }

    /// The times of the rows.
    pub fn t(&self) -> &[f64] {
        &self.columns[Column::T as usize]
    }

    /// The rows of a column, each of `N` numbers.
    pub fn rows<const N: usize>(&self, column: Column) -> &[[f64; N]] {
        self.columns[column as usize].as_chunks().0
    }

    /// Makes room for one more row, and for the last row after it, if the number of rows is not known beforehand.
    #[inline(always)]
    pub fn make_room(&mut self) -> Result {
        let times = &self.columns[Column::T as usize];
        let rows = times.len();
        if rows + 1 < times.capacity() { Ok(()) } else { self.reserve(2 * rows as u64 + 64) }
    }

    fn reserve(&mut self, rows: u64) -> Result {
        let needed = rows as f64 * self.widths.iter().sum::<usize>() as f64;
        let (what, advice) = ("the recording, in numbers,", "raise every= or record less");
        let too_large = || Error::TooLarge { what, needed, limit: MOST_VALUES, advice };
        if needed > MOST_VALUES {
            return Err(too_large());
        }
        let more = usize::try_from(rows).map_err(|_| too_large())?.saturating_sub(self.t().len());
        let mut columns = self.columns.iter_mut().zip(self.widths);
        columns.try_for_each(|(own, width)| {
            own.try_reserve_exact(more.saturating_mul(width)).map_err(|_| too_large())
        })
    }

    /// Adds a row, with the state of the run's discrete controller. `energies` is called only if they are recorded.
    #[inline(always)]
    pub fn push(&mut self, instant: &Instant, controller: &[f64], energies: impl FnOnce() -> Energies) {
        let Instant { motion: Motion { q, p, memory, relaxation }, multipliers, residuals, torque, .. } =
            instant;
        let mut put = |column: Column, numbers: &[f64]| {
            let width = self.widths[column as usize].min(numbers.len());
            self.columns[column as usize].extend_from_slice(&numbers[..width]);
        };
        put(Column::T, &[instant.t]);
        put(Column::GridAnchor, &[instant.grid.0]);
        put(Column::GridStep, &[instant.grid.1 as f64]);
        put(Column::Q, &q.row());
        put(Column::P, &p.row());
        put(Column::Memory, memory);
        put(Column::Linearized, &instant.linearized.unwrap_or([f64::NAN; 21 + RELAXATIONS]));
        put(Column::Relaxation, relaxation);
        put(Column::Controller, controller);
        put(Column::Multipliers, multipliers);
        put(Column::Residuals, residuals);
        put(Column::Torque, torque);
        let [right, left, ..] = instant.contact.unwrap_or(STICKING);
        put(Column::Contacts, &instant.contact.unwrap_or(STICKING));
        // The absolute value of a code is that of the mode, but a grazing contact that slides has one more.
        put(Column::Modes, &[right, left].map(|code| code.abs().min(3.0)));
        let width = self.widths[Column::Energy as usize];
        if width > 0 {
            let Energies { kinetic, elastic, gravity } = energies();
            let column = &mut self.columns[Column::Energy as usize];
            column.extend_from_slice(&[kinetic, elastic, gravity]);
            column.extend_from_slice(&instant.works[..width - 3]);
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
    /// Number of states of Maxwell branches.
    pub branches: usize,
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
    /// Counts of the work. Steps and segments are those of this run. The other counts are those of its loop so far,
    /// which are the run's own if it is the only one.
    pub stats: Stats,
}

impl Run {
    /// The violations that the monitors have seen, with their first times.
    pub fn violations(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let times = VIOLATIONS.map(|(name, _)| name).into_iter().zip(self.first_times);
        times.filter(|(_, first)| !first.is_nan())
    }
}
