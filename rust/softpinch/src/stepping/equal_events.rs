//! What takes lanes out of the vector code of the loop of equal steps: events of contact, impulses, and ends of runs.
//!
//! A lane in which an event is due repeats its last step alone, up to the event and on from there, while the other lanes
//! take their next step. Its new state replaces the old one.

use crate::error::Result;
use crate::formulation::{SceneEquations, States, System};
use crate::number::{Bits, Lanes, each};
use crate::stepping::{
    ContactEnd, EqualLanes, Instant, Instants, Moment, POLL, Phase, Seen, all_finite, column, completed,
    interruption, overflow,
};

impl<R: Lanes> EqualLanes<'_, R> {
    /// Lets events happen and controllers measure, which `held` lanes do instead of a step. Returns the lanes into which
    /// another run was loaded because an event ended theirs.
    #[inline(always)]
    pub fn hold_lanes(&mut self, tau: R, at: &Instants<'_, R>, replacement: &mut States<R>) -> Result<Bits> {
        let mut loaded = 0;
        self.held = 0;
        let due = if self.batch.unilateral { self.batch.due(at.now, self.stepped) } else { 0 };
        if due | self.batch.phases.at(Phase::Start) != 0 {
            let certain = self.batch.limits.modes_certain(at.now, &self.batch.drive.contacts);
            loaded = self.meet_events((due, certain, tau), at, replacement)?;
        }
        let sampling = self.batch.phases.at(Phase::Sample) & !self.held;
        if sampling != 0 {
            // A lane that is not finite is watched, and ends.
            let sampling = sampling & all_finite(at.now, R::zero());
            self.take_samples(sampling, at.now);
            at.system.size().each(|n| replacement[n] = R::select(sampling, at.y[n], replacement[n]));
        }
        Ok(loaded)
    }

    /// Lets the events of the lanes in `due` happen, and chooses the modes anew in lanes at the start of a
    /// segment, unless these are `certain`. Lanes whose state or modes change are `held`: the instant is evaluated again,
    /// and watched then. Returns the lanes into which another run was loaded because an event ended theirs.
    #[cold]
    #[inline(never)]
    fn meet_events(
        &mut self,
        (due, certain, tau): (Bits, Bits, R),
        at: &Instants<'_, R>,
        replacement: &mut States<R>,
    ) -> Result<Bits> {
        let mut loaded = 0;
        let starting = self.batch.phases.at(Phase::Start);
        for lane in each(due | starting) {
            let bit = 1 << lane;
            let Some(before) = self.last(lane, false, at) else { continue };
            let (arrived, h) = (column(at.y, lane), self.h.lane(lane));
            let (starts, certain) = (starting & bit != 0, certain & bit != 0);
            let Some(run) = &self.batch.runs[lane] else { continue };
            if starts {
                self.batch.phases.set(bit, run.place.phase_at_start(&run.scene));
            }
            let step = (self.stepped & bit != 0).then(|| run.place.last_step(self.clock));
            let anchor = run.place.segment.anchor;
            let found = self.batch.act(lane, |contact, _| {
                let row = contact.row();
                let chooses = starts && (!certain || contact.is_unset());
                let mut y = arrived;
                if let Some((segment, step)) = step {
                    let (earlier, tau) = (segment.anchor != anchor, segment.tau(step - 1));
                    let from = Moment { earlier, tau, h: segment.h, y: &column(at.y_before, lane) };
                    y = contact.advance(&from, &arrived)?;
                }
                // The modes may also have changed in the step.
                if chooses || starts && contact.row() != row {
                    y = contact.begin(&Moment { earlier: false, tau: tau.lane(lane), h, y: &y })?;
                }
                Ok((y, y != arrived || contact.row() != row))
            });
            match found {
                Some(Ok((y, true))) => {
                    self.batch.steps_back(bit);
                    self.hold(lane, before, (&y, 1), replacement);
                    self.held |= bit;
                }
                Some(Err(end)) => {
                    self.end_at_event(at.system, lane, &end, before)?;
                    loaded |= bit;
                }
                _ => {}
            }
        }
        self.held |= loaded;
        self.schedule();
        Ok(loaded)
    }

    /// Ends the run in a lane at an event of its contacts, and loads the next one.
    fn end_at_event(
        &mut self,
        system: &SceneEquations<R>,
        lane: usize,
        end: &ContactEnd,
        before: Instant,
    ) -> Result {
        if let Some((end, last)) = self.batch.contact_end(lane, end, (before, self.h.lane(lane))) {
            self.retire(system, lane, end, &last);
        }
        self.load(lane, self.clock + 1)
    }

    /// Here lanes leave the vector code: instead of a step, a run ends and the next one begins, or impulses
    /// are applied. Returns the lanes that do not take the step, and those among them into which another run
    /// was loaded. The states after impulses are in `replacement`.
    #[cold]
    #[inline(never)]
    pub fn end_runs_and_apply_impulses(
        &mut self,
        (seen, leaving, tau): (&Seen, Bits, R),
        at: &Instants<'_, R>,
        replacement: &mut States<R>,
    ) -> Result<(Bits, Bits)> {
        let mut leaving = leaving;
        for lane in each(leaving) {
            let finite = seen.finite >> lane & 1 != 0;
            let Some(last) = self.last(lane, finite, at) else { continue };
            let violation = || self.batch.violation(lane, seen, &last);
            let end = if finite { violation().unwrap_or_else(completed) } else { overflow(last.t) };
            self.retire(at.system, lane, end, &last);
        }
        if (self.clock + 1).is_multiple_of(POLL) && (self.batch.queue.stops)() {
            for lane in each(self.batch.active()) {
                let watched = self.watched_now() >> lane & 1 != 0;
                let Some(last) = self.last(lane, watched, at) else { continue };
                let Some(run) = &self.batch.runs[lane] else { continue };
                let end = interruption(run.place.now(self.clock).0);
                self.retire(at.system, lane, end, &last);
                leaving |= 1 << lane;
            }
        }
        for lane in each(leaving) {
            self.load(lane, self.clock + 1)?;
        }
        let struck = self.batch.phases.at(Phase::Struck);
        self.batch.phases.set(struck, Phase::Step);
        let jumping = self.batch.phases.at(Phase::Impulse) & !(leaving | self.held);
        for lane in each(jumping) {
            let Some(now) = self.now(lane, at) else { continue };
            let Some(run) = &self.batch.runs[lane] else { continue };
            let (mut y, anchor) = (*at.y, run.place.segment.anchor);
            match self.batch.strike(at.system, lane, (anchor, tau, self.h.lane(lane)), &mut y) {
                // The instant after the impulses is evaluated but not watched again. The next step starts from it.
                Ok(_) => self.hold(lane, now, (&column(&y, lane), 2), replacement),
                Err(end) => {
                    self.end_at_event(at.system, lane, &end, now)?;
                    leaving |= 1 << lane;
                }
            }
        }
        self.batch.phases.set(jumping & !leaving, Phase::Struck);
        self.schedule();
        Ok((leaving | jumping, leaving))
    }
}
