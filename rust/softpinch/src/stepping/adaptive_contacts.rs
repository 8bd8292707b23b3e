//! Events of unilateral contact in the adaptive loop. A step in which an event is due is taken again with the
//! length that leads to the event. There the run goes on as at the start of a segment, with a cautious first step.

use crate::formulation::equations::States;
use crate::formulation::system::System;
use crate::number::lanes::{Bits, Lanes, MOST, each};
use crate::stepping::adaptive_lanes::{AdaptiveLanes, Here};
use crate::stepping::contact_events::{ContactEnd, Event, Reason};
use crate::stepping::contact_lane::Moment;
use crate::stepping::event_stepper::MOST_EVENTS;
use crate::stepping::instant::{column, put};
use crate::stepping::queue::RunQueue;

/// The share of a segment that stands in for the length of a step where none is known yet.
const FIRST: f64 = 1.0 / 1024.0;

/// The events of the runs in all lanes.
pub(super) struct AdaptiveEvents {
    /// Lanes whose next attempt ends at their event.
    pub(super) located: Bits,
    /// Lanes whose last step has ended at their event.
    pub(super) reached: Bits,
    /// The event, and the length of the step in which it was found.
    events: [Option<(Event, f64)>; MOST],
    /// Number of steps in a row that ended at an event.
    in_a_row: [usize; MOST],
}

impl AdaptiveEvents {
    /// No events.
    pub(super) fn new() -> Self {
        Self { located: 0, reached: 0, events: [None; MOST], in_a_row: [0; MOST] }
    }

    /// Notes the lanes whose steps are taken. A step that does not end at an event interrupts a row of events.
    #[inline(always)]
    pub(super) fn settle(&mut self, taken: Bits) {
        for lane in each(taken & !self.reached) {
            self.in_a_row[lane] = 0;
        }
    }

    /// Forgets the events of lanes.
    pub(super) fn forget(&mut self, lanes: Bits) {
        self.located &= !lanes;
        self.reached &= !lanes;
        for lane in each(lanes) {
            self.in_a_row[lane] = 0;
        }
    }
}

impl<'a, R: Lanes, Q: RunQueue<'a>> AdaptiveLanes<'a, R, Q> {
    /// Looks for events in the steps of length `h` to `arrived` in the lanes of `due`. Returns the lanes that do
    /// not take this step: they take a shorter one that ends at the event, or their run has ended.
    #[cold]
    #[inline(never)]
    pub(super) fn find_events(
        &mut self,
        system: &impl System<R>,
        due: Bits,
        here: &Here<R>,
        (h, arrived): (R, &States<R>),
    ) -> Bits {
        let mut retakes = 0;
        for lane in each(due) {
            let bit = 1 << lane;
            let h = h.lane(lane);
            let y = column(&here.y, lane);
            let from = Moment { earlier: false, tau: self.places.tau.lane(lane), h, y: &y };
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let Some(contact) = &mut run.contact else { continue };
            match contact.earliest(&from, &column(arrived, lane)) {
                Ok(None) => {}
                Ok(Some((length, event))) => {
                    self.events.events[lane] = Some((event, h));
                    if length < h {
                        self.places.h.set(lane, length);
                        self.events.located |= bit;
                        retakes |= bit;
                    } else {
                        self.events.reached |= bit;
                    }
                }
                Err(end) => {
                    self.end_at_event(system, lane, here, (&end, h));
                    retakes |= bit;
                }
            }
            self.batch.note_changes(lane);
        }
        retakes
    }

    /// Lets the events happen at which steps have just ended.
    #[cold]
    pub(super) fn meet_events(&mut self, system: &impl System<R>, here: &mut Here<R>) {
        let reached = std::mem::take(&mut self.events.reached);
        for lane in each(reached & self.entering) {
            let Some((event, h)) = self.events.events[lane].take() else { continue };
            let y = column(&here.y, lane);
            let tau = self.places.tau.lane(lane);
            self.events.in_a_row[lane] += 1;
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let Some(contact) = &mut run.contact else { continue };
            let found = if self.events.in_a_row[lane] > MOST_EVENTS {
                Err(Box::new(ContactEnd { reason: Reason::Chattering, tau, y }))
            } else {
                contact.happen(&Moment { earlier: false, tau, h, y: &y }, event)
            };
            self.take_up(system, lane, here, (found, h));
        }
    }

    /// Chooses the modes in the lanes of `begins`, which begin a segment.
    #[cold]
    pub(super) fn choose_modes(&mut self, system: &impl System<R>, begins: Bits, here: &mut Here<R>) {
        for lane in each(begins & self.entering) {
            let length = self.places.length.lane(lane);
            let last = self.places.h.lane(lane);
            let h = if last > 0.0 { last.min(length) } else { FIRST * length };
            let y = column(&here.y, lane);
            let Some(run) = &mut self.batch.runs[lane] else { continue };
            let Some(contact) = &mut run.contact else { continue };
            let found = contact.begin(&Moment { earlier: false, tau: 0.0, h, y: &y });
            self.take_up(system, lane, here, (found, h));
        }
    }

    /// Applies the impulses at the start of a segment. Returns whether there were any; `None` if one of them ends
    /// the run.
    #[cold]
    pub(super) fn strike(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        here: &mut Here<R>,
    ) -> Option<bool> {
        let run = self.batch.runs[lane].as_mut()?;
        let contact = run.contact.as_mut()?;
        let anchor = self.places.from.lane(lane);
        let mut impulses = run.scene.inputs.impulses_at(anchor).map(|impulse| &impulse.impulse).peekable();
        if impulses.peek().is_none() {
            return Some(false);
        }
        let y = column(&here.y, lane);
        let h = FIRST * self.places.length.lane(lane);
        let found = contact.strike(&Moment { earlier: false, tau: 0.0, h, y: &y }, impulses);
        self.take_up(system, lane, here, (found, h)).then_some(true)
    }

    /// Goes on from the state after an event, or ends the run there. Returns whether it goes on.
    fn take_up(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        here: &mut Here<R>,
        (found, h): (Result<States<f64>, Box<ContactEnd>>, f64),
    ) -> bool {
        self.batch.note_changes(lane);
        match found {
            Ok(y) => {
                put(&mut here.y, lane, &y);
                true
            }
            Err(end) => {
                self.end_at_event(system, lane, here, (&end, h));
                self.entering &= !(1 << lane);
                false
            }
        }
    }

    /// Ends the run in a lane at an event of its contacts.
    fn end_at_event(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        here: &Here<R>,
        (end, h): (&ContactEnd, f64),
    ) {
        let Some(before) = self.last(system, lane, here) else { return };
        if let Some((end, last)) = self.batch.contact_end(lane, end, (before, h)) {
            self.retire(system, lane, end, &last);
        }
    }
}
