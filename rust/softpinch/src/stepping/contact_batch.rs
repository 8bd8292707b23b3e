//! The work of both step loops on the contacts of the runs in their lanes, in unilateral contact.

use crate::formulation::equations::Evaluation;
use crate::model::contact_modes::{ContactRow, Mode};
use crate::model::scene::Scene;
use crate::number::lanes::{Bits, Lanes};
use crate::stepping::batch::LaneBatch;
use crate::stepping::contact_events::{ContactEnd, EventResult, Reason};
use crate::stepping::contact_lane::LaneContact;
use crate::stepping::ending::{self, End};
use crate::stepping::instant::Instant;
use crate::stepping::monitor::{VIOLATIONS, Violation};
use crate::stepping::queue::RunQueue;

impl<'a, R: Lanes, P, Q: RunQueue<'a>> LaneBatch<'a, R, P, Q> {
    /// The lanes in which an event of unilateral contact is due.
    #[inline(always)]
    pub fn due(&self, now: &Evaluation<R>) -> Bits {
        self.limits.due(now, &self.drive.contacts) & self.active()
    }

    /// The violations of unilateral contact at an instant, with those that events have shown before it.
    #[inline(always)]
    pub(super) fn violated(&mut self, now: &Evaluation<R>, watched: Bits) -> [Bits; VIOLATIONS.len()] {
        let mut found = self.limits.violated(now, Some(&self.drive.contacts));
        for (found, occurred) in found.iter_mut().zip(&mut self.occurred) {
            *found |= *occurred & watched;
            *occurred &= !watched;
        }
        found
    }

    /// The sum of |v| over both contacts where they slip or graze.
    #[inline(always)]
    pub(super) fn slip_speed(&self, residuals: &[R; 4]) -> R {
        let mut sum = R::zero();
        if self.unilateral {
            let contacts = &self.drive.contacts;
            for i in 0..2 {
                let moves = contacts.slip(i) | contacts.graze[i];
                sum = sum + R::select(moves, residuals[2 + i].abs(), R::zero());
            }
        }
        sum
    }

    /// The contacts of the run in a lane in the form of results, in unilateral contact.
    #[inline(always)]
    pub fn contact_row(&self, lane: usize) -> Option<ContactRow> {
        if !self.unilateral {
            return None;
        }
        self.runs[lane].as_ref()?.contact.as_ref().map(|contact| contact.row())
    }

    /// Lets `work` act on the contacts of the run in a lane, and notes what it changes; `None` if there are none.
    pub(super) fn act<T>(
        &mut self,
        lane: usize,
        work: impl FnOnce(&mut LaneContact, &Scene) -> EventResult<T>,
    ) -> Option<EventResult<T>> {
        let run = self.runs[lane].as_mut()?;
        let found = work(run.contact.as_mut()?, &run.scene);
        self.note_changes(lane);
        Some(found)
    }

    fn note_changes(&mut self, lane: usize) {
        let Some(run) = &mut self.runs[lane] else { return };
        let Some(contact) = &mut run.contact else { return };
        let (changes, work) = contact.take_changes();
        contact.run.put_into(&mut self.drive.contacts, lane);
        self.stats.evaluations += work.evaluations;
        self.stats.jacobians += work.jacobians;
        self.stats.factorisations += work.factorisations;
        self.stats.iterations += work.iterations;
        let bit = 1 << lane;
        for change in &changes {
            let violation = match change.after {
                Mode::Slip(_) => Violation::Slipping,
                Mode::Free => Violation::Opened,
                Mode::Stick | Mode::Graze => continue,
            } as usize;
            self.occurred[violation] |= bit;
            if self.noted[violation] & bit == 0 {
                self.noted[violation] |= bit;
                run.first_times[violation] = change.time;
            }
        }
        for change in &changes {
            self.queue.note_contacts(change.time, &contact.run.contacts, Some(change));
        }
    }

    /// The end of the run in a lane at an event of its contacts, and its last instant. `before` is the last
    /// watched instant, `h` the length of the step.
    pub fn contact_end(
        &self,
        lane: usize,
        end: &ContactEnd,
        (before, h): (Instant, f64),
    ) -> Option<(End, Instant)> {
        let run = self.runs[lane].as_ref()?;
        let contact = run.contact.as_ref()?;
        let modes = contact.run.modes();
        let (reason, last) = match end.reason {
            Reason::Unsolved(_) | Reason::NotFinite => (end.reason, before),
            reason => match contact.last(end) {
                // The row at an impulse has the state before it. A run that ends as it starts has not been
                // evaluated before.
                last if last.t == before.t && before.is_finite() => (reason, before),
                last if last.is_finite() => (reason, last),
                _ => (Reason::NotFinite, before),
            },
        };
        Some((ending::contact(&run.scene, &last, reason, modes, h), last))
    }
}
