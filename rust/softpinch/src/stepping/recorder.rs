//! The recording of one run, for a step loop of one lane.

use crate::error::Result;
use crate::model::{Energies, Mode};
use crate::stepping::intervals::{Intervals, of_changes};
use crate::stepping::{Change, Instant, Recording, Run, Status, VIOLATIONS, Violation, arrival};

#[derive(Default)]
pub enum Due<'a> {
    #[default]
    Never,
    /// The start of the run, and then one instant after every so many steps.
    Steps {
        every: u64,
        /// Number of steps until the next row.
        left: u64,
    },
    Times(&'a [f64]),
}

#[derive(Default)]
pub struct Recorder<'a> {
    recording: Recording,
    due: Due<'a>,
    last_row: Option<f64>,
    pub intervals: Intervals,
    pub changes: Vec<Change>,
    /// The state of the run's discrete controller at the next row.
    pub controller: Vec<f64>,
    /// The time and the modes at the start of a run with unilateral contact.
    pub start: Option<(f64, [Mode; 2])>,
}

impl<'a> Recorder<'a> {
    pub fn new(recording: Recording, due: Due<'a>) -> Self {
        Self { recording, due, ..Self::default() }
    }

    fn push(&mut self, watched: &Instant, energies: impl FnOnce() -> Energies) {
        self.recording.push(watched, &self.controller, energies);
        self.last_row = Some(watched.t);
    }

    #[inline(always)]
    pub fn is_due(&mut self, t: f64, inside: bool) -> bool {
        if self.intervals.refusal.is_some() {
            return true;
        }
        match &mut self.due {
            // Events may follow each other faster than the clock resolves.
            Due::Never => false,
            Due::Steps { .. } if inside || self.last_row == Some(t) => false,
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
    pub fn next_time(&self) -> f64 {
        match self.due {
            Due::Never | Due::Steps { .. } => f64::INFINITY,
            Due::Times(times) => times.first().copied().unwrap_or(f64::INFINITY),
        }
    }

    /// Records an instant. The error says that there is no memory for it.
    pub fn record(&mut self, watched: &Instant, energies: impl FnOnce() -> Energies) -> Result {
        if let Some(error) = self.intervals.refusal.take() {
            return Err(error);
        }
        self.recording.make_room()?;
        self.push(watched, energies);
        Ok(())
    }

    /// A run that has ended, with its recording. `energies` computes those of its last instant.
    pub fn finish(&mut self, run: Run, energies: impl FnOnce() -> Energies) -> Run {
        if let Some(state) = &run.controller {
            self.controller.clone_from(state);
        }
        let records = !matches!(self.due, Due::Never);
        let end = run.last.t;
        if records && self.last_row != Some(end) {
            self.push(&run.last, energies);
        }
        let mut intervals = self.intervals.finish();
        let contact_changes = std::mem::take(&mut self.changes);
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
        let recording = std::mem::take(&mut self.recording);
        Run { recording, message, violation_intervals, contact_changes, ..run }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::method::traits::Stats;
    use crate::model::inputs::Inputs;
    use crate::model::motion::Motion;
    use crate::model::parameters::Parameters;
    use crate::model::scene::Scene;
    use crate::model::start::{State, contact};
    use crate::stepping::COUNT;
    use crate::stepping::record::{COLUMNS, Column};

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
        let widths = COLUMNS.map(|(_, column)| match column {
            Column::T => 1,
            Column::Q => 9,
            _ => 0,
        });
        let recording = Recording::with_capacity(widths, 0).expect("there is room");
        let mut recorder = Recorder::new(recording, due);
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
            branches: 0,
            status: Status::Completed,
            message: String::new(),
            first_times: [f64::NAN; VIOLATIONS.len()],
            violation_intervals: Vec::new(),
            contact_changes: Vec::new(),
            holds: true,
            summaries: [0.0; COUNT],
            stats: Stats::default(),
        };
        recorder.finish(run, unused)
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
