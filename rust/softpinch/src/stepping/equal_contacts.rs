//! Events of unilateral contact in the loop of equal steps. A lane in which an event is due repeats its last step
//! alone, up to the event and on from there, while the other lanes take their next step. Its new state replaces
//! the old one.

use crate::error::Error;
use crate::formulation::equations::States;
use crate::formulation::system::System;
use crate::model::scene::Scene;
use crate::number::lanes::{Bits, Lanes, each};
use crate::stepping::contact_events::ContactEnd;
use crate::stepping::contact_lane::Moment;
use crate::stepping::equal_lanes::{EqualLanes, Instants};
use crate::stepping::grid::Grid;
use crate::stepping::instant::{column, put};
use crate::stepping::queue::{RunQueue, Watched};

impl<'a, R: Lanes, Q: RunQueue<'a>, G: FnMut(usize, &Scene) -> Result<Grid, Error>> EqualLanes<'a, R, Q, G> {
    /// Lets the events of the lanes in `due` happen, and chooses the modes anew in lanes at the start of a
    /// segment, unless they are `firm`. Lanes whose state or modes change are `held`: the instant is evaluated again, and watched then.
    /// Returns the lanes into which another run was loaded because an event ended theirs.
    #[cold]
    #[inline(never)]
    pub(super) fn meet_events(
        &mut self,
        system: &impl System<R>,
        (due, firm, tau): (Bits, Bits, R),
        at: &Instants<'_, R>,
        replacement: &mut States<R>,
    ) -> Result<Bits, Error> {
        let mut loaded = 0;
        let anew = std::mem::take(&mut self.anew) & self.batch.active;
        for lane in each(due | anew) {
            let bit = 1 << lane;
            let Some(before) = self.last(system, lane, false, at) else { continue };
            let (arrived, h) = (column(at.y, lane), self.h.lane(lane));
            let taken = self.stepped & bit != 0;
            let clock = self.clock;
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let place = &run.place;
            let Some(contact) = &mut run.contact else { continue };
            let row = contact.row();
            let begins = anew & bit != 0 && (firm & bit == 0 || contact.is_unset());
            let mut found = Ok(arrived);
            if taken {
                let (segment, step) = place.last_step(clock);
                let y = &column(at.y_before, lane);
                let earlier = segment.anchor != place.segment.anchor;
                let from = Moment { earlier, tau: segment.tau(step - 1), h: segment.h, y };
                found = contact.advance(&from, &arrived);
            }
            // The modes may also have changed in the step.
            if begins || anew & bit != 0 && contact.row() != row {
                found = found
                    .and_then(|y| contact.begin(&Moment { earlier: false, tau: tau.lane(lane), h, y: &y }));
            }
            match found {
                Ok(y) if y == arrived && contact.row() == row => {}
                Ok(y) => {
                    put(replacement, lane, &y);
                    run.saved_instant = Some(before);
                    run.place.saved_until = clock + 1;
                    run.place.arrival += 1;
                    self.held |= bit;
                }
                Err(end) => {
                    self.end_at_event(system, lane, &end, before)?;
                    loaded |= bit;
                    continue;
                }
            }
            self.batch.note_changes(lane);
        }
        self.held |= loaded;
        self.schedule();
        Ok(loaded)
    }

    /// Applies the impulses that are due in a lane. Its state after them is in `replacement`. Returns the lane if
    /// another run was loaded into it because the impulse ended its run.
    pub(super) fn strike(
        &mut self,
        system: &impl System<R>,
        (lane, tau): (usize, f64),
        at: &Instants<'_, R>,
        replacement: &mut States<R>,
    ) -> Result<Bits, Error> {
        let Some(now) = self.now(system, lane, at) else { return Ok(0) };
        let h = self.h.lane(lane);
        let Some(run) = &mut self.batch.runs[lane] else { return Ok(0) };
        let Some(contact) = &mut run.contact else { return Ok(0) };
        let anchor = run.place.segment.anchor;
        let moment = Moment { earlier: false, tau, h, y: &column(at.y, lane) };
        let impulses = run.scene.inputs.impulses_at(anchor).map(|impulse| &impulse.impulse);
        match contact.strike(&moment, impulses) {
            Ok(y) => {
                put(replacement, lane, &y);
                run.saved_instant = Some(now);
                run.place.saved_until = self.clock + 2;
                run.place.arrival += 1;
                self.batch.note_changes(lane);
                Ok(0)
            }
            Err(end) => {
                self.end_at_event(system, lane, &end, now)?;
                Ok(1 << lane)
            }
        }
    }

    /// Ends the run in a lane at an event of its contacts, and loads the next one.
    fn end_at_event(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        end: &ContactEnd,
        before: Watched,
    ) -> Result<(), Error> {
        self.batch.note_changes(lane);
        if let Some((end, last)) = self.batch.contact_end(lane, end, (before, self.h.lane(lane))) {
            self.retire(system, lane, end, &last);
        }
        self.load(lane, self.clock + 1)
    }
}
