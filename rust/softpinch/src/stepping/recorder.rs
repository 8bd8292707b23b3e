//! The recording of one run, for a step loop of one lane.

use std::borrow::Cow;

use crate::error::Error;
use crate::formulation::mode_selection::Contact;
use crate::method::traits::Stats;
use crate::model::contact_modes::Mode;
use crate::model::controller_state::ControllerState;
use crate::model::energy::{Energies, LedgerRow};
use crate::model::motion::Linearized;
use crate::model::scene::Scene;
use crate::stepping::contact_events::Change;
use crate::stepping::contact_lane::LaneContact;
use crate::stepping::ending::arrival;
use crate::stepping::intervals::{Intervals, of_changes};
use crate::stepping::monitor::{VIOLATIONS, Violation, ViolationSet};
use crate::stepping::queue::{Finished, RunQueue, Taken};
use crate::stepping::record::{Instant, Recording};
use crate::stepping::sample::Sample;
use crate::stepping::status::Status;
use crate::stepping::summary::COUNT;

/// A finished run.
#[derive(Debug, Clone)]
pub struct Run {
    /// The recorded rows.
    pub recording: Recording,
    /// The last instant, whether or not it was recorded.
    pub last: Instant,
    /// The point of the Jacobian that the next step would have used, for methods that keep one.
    pub linearized: Option<Linearized>,
    /// The state of its discrete controller at the last instant, if it has one.
    pub controller: Option<Vec<f64>>,
    /// The energies at the start of the run, if the ledger was carried.
    pub initial_energies: Option<Energies>,
    /// The status with which it ended.
    pub status: Status,
    /// The status in words, with the numbers.
    pub message: String,
    /// The violations that the monitors have seen, with their first times.
    pub violations: Vec<(&'static str, f64)>,
    /// The intervals of time during which each of these violations was seen, s: the first and the last of
    /// consecutive watched instants that show it.
    pub violation_intervals: Vec<(&'static str, Vec<[f64; 2]>)>,
    /// The changes of the contacts' modes, in unilateral contact.
    pub contact_changes: Vec<Change>,
    /// Whether the grasp held: the run reached its end, and from `summaries.after` on no tip pulled and, if
    /// the scene has friction, none needed more.
    pub holds: bool,
    /// The summaries, in the order of [`SUMMARIES`](crate::stepping::summary::SUMMARIES).
    pub summaries: [f64; COUNT],
    /// Counts of the work that was done.
    pub stats: Stats,
}

/// The instants that are recorded.
pub enum Due<'a> {
    /// None.
    Never,
    /// The start of the run, and then one instant after every so many steps.
    Steps {
        /// Number of steps between rows.
        every: u64,
        /// Number of steps until the next row.
        left: u64,
    },
    /// The instants that were asked for.
    Times(&'a [f64]),
}

/// One run and its recording.
pub struct Recorder<'a> {
    scene: Option<&'a Scene>,
    due: Due<'a>,
    interrupted: &'a dyn Fn() -> bool,
    /// The time of the last row.
    last_row: f64,
    intervals: Intervals,
    /// The contacts of an earlier run with the same parameters; after the run, its own.
    pub contact: Option<Box<LaneContact>>,
    /// The state of the run's discrete controller at the next row.
    controller: Vec<f64>,
    /// The time and the modes at the start of a run with unilateral contact.
    start: Option<(f64, [Mode; 2])>,
    /// The run as far as it has been computed.
    pub run: Run,
}

impl<'a> Recorder<'a> {
    /// A recorder before its run.
    pub fn new(
        scene: &'a Scene,
        recording: Recording,
        due: Due<'a>,
        interrupted: &'a dyn Fn() -> bool,
    ) -> Self {
        let run = Run {
            recording,
            last: Instant::start(&scene.initial),
            linearized: None,
            controller: None,
            initial_energies: None,
            status: Status::Interrupted,
            message: String::new(),
            violations: Vec::new(),
            violation_intervals: Vec::new(),
            contact_changes: Vec::new(),
            holds: false,
            summaries: [f64::NAN; COUNT],
            stats: Stats::default(),
        };
        Self {
            scene: Some(scene),
            due,
            interrupted,
            last_row: f64::NAN,
            intervals: Intervals::new(),
            contact: None,
            controller: Vec::new(),
            start: None,
            run,
        }
    }

    fn push(&mut self, watched: &Sample, ledger: impl FnOnce(&Sample) -> LedgerRow) {
        self.run.recording.push(&watched.instant, || ledger(watched));
        self.run.recording.push_linearized(watched.linearized);
        self.run.recording.push_controller(&self.controller);
        self.last_row = watched.instant.t;
    }
}

impl<'a> RunQueue<'a> for Recorder<'a> {
    fn take(&mut self) -> Result<Option<Taken<'a>>, Error> {
        let Self { scene, contact, .. } = self;
        let taken = |scene| Taken { number: 0, scene: Cow::Borrowed(scene), contact: contact.take() };
        Ok(scene.take().map(taken))
    }

    fn stops(&mut self) -> bool {
        (self.interrupted)()
    }

    #[inline(always)]
    fn is_due(&mut self, t: f64, inside: bool) -> bool {
        if self.intervals.is_refused() {
            return true;
        }
        match &mut self.due {
            // Events may follow each other faster than the clock resolves.
            Due::Never => false,
            Due::Steps { .. } if inside || t == self.last_row => false,
            Due::Steps { every, left } => {
                let due = *left == 0;
                if due {
                    *left = *every;
                }
                *left -= 1;
                due
            }
            Due::Times(times) => match *times {
                [first, rest @ ..] if *first == t => {
                    *times = rest;
                    true
                }
                _ => false,
            },
        }
    }

    #[inline(always)]
    fn next_time(&self) -> f64 {
        match self.due {
            Due::Never | Due::Steps { .. } => f64::INFINITY,
            Due::Times(times) => times.first().copied().unwrap_or(f64::INFINITY),
        }
    }

    #[inline(always)]
    fn note(&mut self, t: f64, found: ViolationSet) {
        self.intervals.note(t, found);
    }

    fn note_contacts(&mut self, t: f64, contacts: &[Contact; 2], change: Option<&Change>) {
        if change.is_none() {
            self.start = Some((t, contacts.map(|contact| contact.mode)));
        }
        if let Some(change) = change
            && self.intervals.has_room(&mut self.run.contact_changes)
        {
            self.run.contact_changes.push(*change);
        }
    }

    fn keep_controller(&mut self, state: &ControllerState) {
        self.controller.clear();
        self.controller.extend(state.row());
    }

    fn record(&mut self, watched: &Sample, ledger: impl FnOnce(&Sample) -> LedgerRow) -> Result<(), Error> {
        if let Some(error) = self.intervals.refusal() {
            return Err(error);
        }
        self.run.recording.make_room()?;
        self.push(watched, ledger);
        Ok(())
    }

    fn finish(&mut self, finished: Finished, ledger: impl FnOnce(&Sample) -> LedgerRow) {
        let Finished {
            status,
            message,
            last,
            initial_energies,
            first_times,
            holds,
            summaries,
            stats,
            controller,
            contact,
            ..
        } = finished;
        self.contact = contact;
        if let Some(state) = &controller {
            self.controller.clone_from(state);
        }
        let records = !matches!(self.due, Due::Never);
        if records && self.last_row != last.instant.t {
            self.push(&last, ledger);
        }
        let seen = |k: &usize| !first_times[*k].is_nan();
        let mut intervals = self.intervals.finish();
        let run = &mut self.run;
        if let Some((from, modes)) = self.start {
            // Events know the times of slipping and opening better than the instants that were watched.
            let (changes, end) = (&run.contact_changes, last.instant.t);
            let of = |shows: fn(Mode) -> bool| of_changes(modes, changes, end, from, shows);
            intervals[Violation::Slipping as usize] = of(|mode| mode.slip().is_some());
            intervals[Violation::Opened as usize] = of(|mode| mode == Mode::Free);
        }
        (run.last, run.linearized, run.initial_energies, run.status) =
            (last.instant, last.linearized, initial_energies, status);
        run.message = match status {
            Status::Completed if records => arrival(last.instant.t),
            _ => message,
        };
        let found = || (0..VIOLATIONS.len()).filter(seen);
        run.violations = found().map(|k| (VIOLATIONS[k].0, first_times[k])).collect();
        run.violation_intervals =
            found().map(|k| (VIOLATIONS[k].0, std::mem::take(&mut intervals[k]))).collect();
        (run.holds, run.summaries, run.stats, run.controller) = (holds, summaries, stats, controller);
    }
}
