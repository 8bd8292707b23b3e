//! The events of unilateral contact, and impulses, in the lanes of both loops.

use crate::formulation::{Evaluation, InputAt, SceneEquations, States};
use crate::model::{Mode, Scene};
use crate::number::{Bits, Lanes};
use crate::stepping::ending;
use crate::stepping::{
    ContactEnd, End, EventResult, Instant, LaneBatch, LaneContact, Moment, Reason, VIOLATIONS, Violation,
    column, put,
};

impl<R: Lanes, P> LaneBatch<'_, R, P> {
    /// The lanes in which an event of unilateral contact is due at the end of the steps of the lanes in `taken`. A tip that
    /// has come beyond the end of its side may have met the side before, within the step.
    #[inline(always)]
    pub fn due(&mut self, now: &Evaluation<R>, taken: Bits) -> Bits {
        let taken = taken & self.active();
        let mut found = self.limits.due(now, &self.drive.contacts) & taken;
        for (i, known) in self.beyond.iter_mut().enumerate() {
            let beyond = self.limits.beyond(now, &self.drive.contacts, i);
            found |= beyond & !*known & taken;
            *known = beyond & taken | *known & !taken;
        }
        found
    }

    /// Forgets which tips are beyond the ends of their sides in the lane of `bit`, whose step is taken again.
    pub(super) fn steps_back(&mut self, bit: Bits) {
        self.beyond = self.beyond.map(|known| known & !bit);
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
        self.stats.add(&work);
        let bit = 1 << lane;
        for change in &changes {
            if R::WIDTH == 1 {
                let recorder = &mut self.queue.recorder;
                recorder.intervals.keep_change(&mut recorder.changes, *change);
            }
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
    }

    /// Applies the impulses at time `t` to the state of a lane, `tau` after the start of its segment and before a step of
    /// length `h`. Returns whether there were any. In unilateral contact they may end the run.
    pub(super) fn strike(
        &mut self,
        system: &SceneEquations<R>,
        lane: usize,
        (t, tau, h): (f64, R, f64),
        y: &mut States<R>,
    ) -> EventResult<bool> {
        let Some(run) = &self.runs[lane] else { return Ok(false) };
        if run.scene.inputs.impulses_at(t).next().is_none() {
            return Ok(false);
        }
        if self.unilateral {
            let at = Moment { earlier: false, tau: tau.lane(lane), h, y: &column(y, lane) };
            if let Some(struck) = self.act(lane, |contact, scene| contact.strike(&at, (scene, t))) {
                put(y, lane, &struck?);
            }
            return Ok(true);
        }
        let input = R::outlined(InputAt { drive: &self.drive, tau });
        for impulse in run.scene.inputs.impulses_at(t) {
            let mut jumped = *y;
            system.jump(&input, &mut jumped, &impulse.map(R::constant));
            put(y, lane, &column(&jumped, lane));
        }
        Ok(true)
    }

    /// The end of the run in a lane at an event of its contacts, and its last instant. `before` is the last
    /// watched instant, `h` the length of the step.
    pub fn contact_end(
        &mut self,
        lane: usize,
        end: &ContactEnd,
        (before, h): (Instant, f64),
    ) -> Option<(End, Instant)> {
        let run = self.runs[lane].as_mut()?;
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
        if let Reason::Broken(violation) = reason {
            let shown = contact.shown(end, violation);
            for (_, violation) in VIOLATIONS {
                if shown.contains(violation) && self.noted[violation as usize] >> lane & 1 == 0 {
                    run.first_times[violation as usize] = last.t;
                }
            }
            if R::WIDTH == 1 {
                self.queue.recorder.intervals.note(last.t, shown);
            }
        }
        Some((ending::contact(&run.scene, &last, reason, modes, h), last))
    }
}
