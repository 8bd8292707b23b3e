//! The recording of one run, for a step loop of one lane.

use std::borrow::Cow;

use crate::error::Result;
use crate::formulation::Contact;
use crate::method::Stats;
use crate::model::{ControllerState, Energies, Mode, Scene};
use crate::stepping::intervals::{Intervals, of_changes};
use crate::stepping::{
    COUNT, Change, Finished, Instant, LaneContact, Recording, Run, RunQueue, Status, Taken, VIOLATIONS,
    Violation, ViolationSet, arrival,
};

/// The instants that are recorded.
pub enum Due<'a> {
    Never,
    /// The start of the run, and then one instant after every so many steps.
    Steps {
        every: u64,
        /// Number of steps until the next row.
        left: u64,
    },
    Times(&'a [f64]),
}

pub struct Recorder<'a> {
    scene: Option<&'a Scene>,
    due: Due<'a>,
    interrupted: &'a dyn Fn() -> bool,
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
    pub fn new(
        scene: &'a Scene,
        recording: Recording,
        due: Due<'a>,
        interrupted: &'a dyn Fn() -> bool,
    ) -> Self {
        let run = Run {
            recording,
            last: Instant::start(&scene.initial),
            controller: None,
            initial_energies: None,
            status: Status::Interrupted,
            message: String::new(),
            first_times: [f64::NAN; VIOLATIONS.len()],
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
            intervals: Intervals::default(),
            contact: None,
            controller: Vec::new(),
            start: None,
            run,
        }
    }

    fn push(&mut self, watched: &Instant, energies: impl FnOnce() -> Energies) {
        self.run.recording.push(watched, &self.controller, energies);
        self.last_row = watched.t;
    }
}

impl<'a> RunQueue<'a> for Recorder<'a> {
    fn take(&mut self) -> Result<Option<Taken<'a>>> {
        let Self { scene, contact, .. } = self;
        let taken = |scene| Taken { number: 0, scene: Cow::Borrowed(scene), contact: contact.take() };
        Ok(scene.take().map(taken))
    }

    fn stops(&mut self) -> bool {
        (self.interrupted)()
    }

    #[inline(always)]
    fn is_due(&mut self, t: f64, inside: bool) -> bool {
        if self.intervals.refusal.is_some() {
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
        if let Some(change) = change {
            self.intervals.keep_change(&mut self.run.contact_changes, *change);
        }
    }

    fn keep_controller(&mut self, state: &ControllerState) {
        self.controller.clear();
        self.controller.extend(state.row());
    }

    fn record(&mut self, watched: &Instant, energies: impl FnOnce() -> Energies) -> Result {
        if let Some(error) = self.intervals.refusal.take() {
            return Err(error);
        }
        self.run.recording.make_room()?;
        self.push(watched, energies);
        Ok(())
    }

    fn finish(&mut self, finished: Finished, energies: impl FnOnce() -> Energies) {
        let Finished { run, contact, .. } = finished;
        self.contact = contact;
        if let Some(state) = &run.controller {
            self.controller.clone_from(state);
        }
        let records = !matches!(self.due, Due::Never);
        let end = run.last.t;
        if records && self.last_row != end {
            self.push(&run.last, energies);
        }
        let mut intervals = self.intervals.finish();
        let contact_changes = std::mem::take(&mut self.run.contact_changes);
        if let Some((from, modes)) = self.start {
            // Events know the times of slipping and opening better than the instants that were watched.
            let of = |shows: fn(Mode) -> bool| of_changes(modes, &contact_changes, end, from, shows);
            intervals[Violation::Slipping as usize] = of(|mode| mode.slip().is_some());
            intervals[Violation::Opened as usize] = of(|mode| mode == Mode::Free);
        }
        let message = match run.status {
            Status::Completed if records => arrival(end),
            _ => run.message,
        };
        let seen = VIOLATIONS.iter().zip(intervals).zip(run.first_times);
        let violation_intervals =
            seen.filter(|(_, first)| !first.is_nan()).map(|(((name, _), own), _)| (*name, own)).collect();
        let recording = std::mem::take(&mut self.run.recording);
        self.run = Run { recording, message, violation_intervals, contact_changes, ..run };
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::inputs::Inputs;
    use crate::model::motion::Motion;
    use crate::model::parameters::Parameters;
    use crate::model::start::{State, contact};
    use crate::stepping::record::{Column, Layout, Recordable};

    fn scene() -> Scene {
        let parameters = Parameters::default();
        let initial = State::at_rest(contact(&parameters).expect("a scene"));
        Scene { parameters, inputs: Inputs::constant_targets([0.0; 2]), initial, check: true, duration: 1.0 }
    }

    fn sample(scene: &Scene, t: f64) -> Instant {
        let motion = Motion { q: [t; 9].into(), ..Motion::zero() };
        Instant { t, motion, ..Instant::start(&scene.initial) }
    }

    fn unused() -> Energies {
        unreachable!("no energy is recorded")
    }

    /// Watches the instants as a step loop does, and ends the run at the last of them.
    fn recorded(due: Due<'_>, instants: &[(f64, bool)]) -> Run {
        let scene = scene();
        let selection = [Recordable::State].into_iter().collect();
        let recording = Recording::with_capacity(selection, Layout::default(), 0).expect("there is room");
        let mut recorder = Recorder::new(&scene, recording, due, &|| false);
        for &(t, inside) in instants {
            if recorder.is_due(t, inside) {
                recorder.record(&sample(&scene, t), unused).expect("there is room");
            }
        }
        let last = sample(&scene, instants.last().map_or(0.0, |&(t, _)| t));
        let run = Run {
            recording: Recording::default(),
            last,
            controller: None,
            initial_energies: None,
            status: Status::Completed,
            message: String::new(),
            first_times: [f64::NAN; VIOLATIONS.len()],
            violation_intervals: Vec::new(),
            contact_changes: Vec::new(),
            holds: true,
            summaries: [0.0; COUNT],
            stats: Stats::default(),
        };
        let finished = Finished { number: 0, run, contact: None };
        recorder.finish(finished, unused);
        recorder.run
    }

    /// The instants of a run, some of which are inside steps. The first and the last are the ends of steps.
    fn instants() -> impl Strategy<Value = Vec<(f64, bool)>> {
        proptest::collection::vec((0.01..1.0f64, any::<bool>()), 1..40).prop_map(|steps| {
            let mut t = 0.0;
            let mut instants = vec![(t, false)];
            for (dt, inside) in steps {
                t += dt;
                instants.push((t, inside));
            }
            instants.push((t + 1.0, false));
            instants
        })
    }

    proptest! {
        #[test]
        fn every_so_many_steps_have_a_row_and_so_has_the_end(all in instants(), every in 1..9usize) {
            let run = recorded(Due::Steps { every: every as u64, left: 0 }, &all);
            let ends: Vec<f64> = all.iter().filter(|(_, inside)| !inside).map(|&(t, _)| t).collect();
            let mut rows: Vec<f64> = ends.iter().copied().step_by(every).collect();
            if rows.last() != ends.last() {
                rows.extend(ends.last());
            }
            prop_assert_eq!(run.recording.rows(Column::Q), &rows.iter().map(|&t| [t; 9]).collect::<Vec<_>>()[..]);
            prop_assert_eq!(run.recording.t(), &rows[..]);
        }

        #[test]
        fn asked_instants_have_rows_and_so_has_the_end(all in instants(), pick in any::<u64>()) {
            let bit = |k: usize| pick >> (k % 64) & 1 != 0;
            let times: Vec<f64> =
                all.iter().enumerate().filter(|&(k, _)| bit(k)).map(|(_, &(t, _))| t).collect();
            let run = recorded(Due::Times(&times), &all);
            let end = all[all.len() - 1].0;
            let rows: Vec<f64> = times.iter().copied().filter(|&t| t != end).chain([end]).collect();
            prop_assert_eq!(run.recording.t(), &rows[..]);
            prop_assert_eq!(run.last.t, end);
        }
    }
}
