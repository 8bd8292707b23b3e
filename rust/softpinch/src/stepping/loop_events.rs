//! Events of unilateral contact in both loops.
//!
//! In the loop of equal steps a lane in which an event is due repeats its last step alone, up to the event and on from
//! there, while the other lanes take their next step. Its new state replaces the old one. In the adaptive loop a step in
//! which an event is due is taken again with the length that leads to the event. There the run goes on as at the start of
//! a segment, with a cautious first step.

use crate::error::Error;
use crate::formulation::equations::States;
use crate::formulation::scene_equations::SceneEquations;
use crate::formulation::system::System;
use crate::model::scene::Scene;
use crate::number::lanes::{Bits, Lanes, MOST, each};
use crate::stepping::adaptive_lanes::{AdaptiveLanes, StepStart};
use crate::stepping::contact_events::{ContactEnd, Event, Reason};
use crate::stepping::contact_lane::{LaneContact, Moment};
use crate::stepping::equal_lanes::{EqualLanes, Instants};
use crate::stepping::event_stepper::MOST_EVENTS;
use crate::stepping::instant::{column, put};
use crate::stepping::phase::Phase;
use crate::stepping::queue::{RunQueue, Sample};

/// The share of a segment that stands in for the length of a step where none is known yet.
const FIRST: f64 = 1.0 / 1024.0;

/// Applies the impulses at time `t`.
fn strike(
    contact: &mut LaneContact,
    scene: &Scene,
    t: f64,
    at: &Moment<'_>,
) -> Result<States<f64>, Box<ContactEnd>> {
    contact.strike(at, scene.inputs.impulses_at(t).map(|impulse| &impulse.impulse))
}

impl<'a, R: Lanes, Q: RunQueue<'a>> EqualLanes<'_, 'a, R, Q> {
    /// Lets the events of the lanes in `due` happen, and chooses the modes anew in lanes at the start of a
    /// segment, unless these are `certain`. Lanes whose state or modes change are `held`: the instant is evaluated again,
    /// and watched then. Returns the lanes into which another run was loaded because an event ended theirs.
    #[cold]
    #[inline(never)]
    pub(super) fn meet_events(
        &mut self,
        system: &SceneEquations<R>,
        (due, certain, tau): (Bits, Bits, R),
        at: &Instants<'_, R>,
        replacement: &mut States<R>,
    ) -> Result<Bits, Error> {
        let mut loaded = 0;
        let starting = self.batch.phases.at(Phase::Start);
        for lane in each(due | starting) {
            let bit = 1 << lane;
            let Some(before) = self.last(system, lane, false, at) else { continue };
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
                    self.hold(lane, before, (&y, 1), replacement);
                    self.held |= bit;
                }
                Some(Err(end)) => {
                    self.end_at_event(system, lane, &end, before)?;
                    loaded |= bit;
                }
                _ => {}
            }
        }
        self.held |= loaded;
        self.schedule();
        Ok(loaded)
    }

    /// Replaces the state of a lane, which is evaluated again. Until the run has been watched again, after so many
    /// evaluations, its last watched instant is `before`.
    pub(super) fn hold(
        &mut self,
        lane: usize,
        before: Sample,
        (y, evaluations): (&States<f64>, u64),
        replacement: &mut States<R>,
    ) {
        put(replacement, lane, y);
        let Some(run) = &mut self.batch.runs[lane] else { return };
        run.saved_instant = Some(before);
        run.place.saved_until = self.clock + evaluations;
        run.place.arrival += 1;
    }

    /// Applies the impulses that are due in a lane. Its state after them is in `replacement`. Returns the lane if
    /// another run was loaded into it because the impulse ended its run.
    pub(super) fn strike(
        &mut self,
        system: &SceneEquations<R>,
        (lane, tau): (usize, f64),
        at: &Instants<'_, R>,
        replacement: &mut States<R>,
    ) -> Result<Bits, Error> {
        let Some(now) = self.now(system, lane, at) else { return Ok(0) };
        let Some(run) = &self.batch.runs[lane] else { return Ok(0) };
        let anchor = run.place.segment.anchor;
        let moment = Moment { earlier: false, tau, h: self.h.lane(lane), y: &column(at.y, lane) };
        match self.batch.act(lane, |contact, scene| strike(contact, scene, anchor, &moment)) {
            Some(Ok(y)) => self.hold(lane, now, (&y, 2), replacement),
            Some(Err(end)) => {
                self.end_at_event(system, lane, &end, now)?;
                return Ok(1 << lane);
            }
            None => {}
        }
        Ok(0)
    }

    /// Ends the run in a lane at an event of its contacts, and loads the next one.
    fn end_at_event(
        &mut self,
        system: &SceneEquations<R>,
        lane: usize,
        end: &ContactEnd,
        before: Sample,
    ) -> Result<(), Error> {
        if let Some((end, last)) = self.batch.contact_end(lane, end, (before, self.h.lane(lane))) {
            self.retire(system, lane, end, &last);
        }
        self.load(lane, self.clock + 1)
    }
}

/// The events of the runs in all lanes of the adaptive loop.
pub(super) struct AdaptiveEvents {
    /// The event at which the next step ends or the last one has ended, and the length of the step in which it was found.
    events: [Option<(Event, f64)>; MOST],
    /// Number of steps in a row that ended at an event.
    in_a_row: [usize; MOST],
}

impl AdaptiveEvents {
    /// No events.
    pub(super) fn new() -> Self {
        Self { events: [None; MOST], in_a_row: [0; MOST] }
    }

    /// Ends the rows of events in these lanes.
    #[inline(always)]
    pub(super) fn settle(&mut self, lanes: Bits) {
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
        start: &StepStart<R>,
        (h, arrived): (R, &States<R>),
    ) -> Bits {
        let mut retakes = 0;
        for lane in each(due) {
            let (bit, h) = (1 << lane, h.lane(lane));
            let y = column(&start.y, lane);
            let from = Moment { earlier: false, tau: self.progress.tau.lane(lane), h, y: &y };
            match self.batch.act(lane, |contact, _| contact.earliest(&from, &column(arrived, lane))) {
                Some(Ok(Some((length, event)))) => {
                    self.events.events[lane] = Some((event, h));
                    if length < h {
                        self.progress.h.set(lane, length);
                        self.batch.phases.set(bit, Phase::Approach);
                        retakes |= bit;
                    } else {
                        self.batch.phases.set(bit, Phase::Event);
                    }
                }
                Some(Err(end)) => {
                    self.end_at_event(system, lane, start, (&end, h));
                    retakes |= bit;
                }
                _ => {}
            }
        }
        retakes
    }

    /// Lets the events happen at which steps have just ended.
    #[cold]
    pub(super) fn meet_events(&mut self, system: &impl System<R>, start: &mut StepStart<R>) {
        for lane in each(self.batch.phases.at(Phase::Event)) {
            let Some((event, h)) = self.events.events[lane].take() else { continue };
            let tau = self.progress.tau.lane(lane);
            self.events.in_a_row[lane] += 1;
            let chatters = self.events.in_a_row[lane] > MOST_EVENTS;
            self.act(system, lane, start, (tau, h), |contact, _, at| {
                if chatters {
                    return Err(Box::new(ContactEnd { reason: Reason::Chattering, tau, y: *at.y }));
                }
                contact.happen(at, event)
            });
        }
    }

    /// Chooses the modes in the lanes of `begins`, which begin a segment.
    #[cold]
    pub(super) fn choose_modes(&mut self, system: &impl System<R>, begins: Bits, start: &mut StepStart<R>) {
        for lane in each(begins & self.entering()) {
            let length = self.progress.length.lane(lane);
            let last = self.progress.h.lane(lane);
            let h = if last > 0.0 { last.min(length) } else { FIRST * length };
            self.act(system, lane, start, (0.0, h), |contact, _, at| contact.begin(at));
        }
    }

    /// Applies the impulses at the start of a segment. Returns whether there were any; `None` if one of them ends
    /// the run.
    #[cold]
    pub(super) fn strike(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        start: &mut StepStart<R>,
    ) -> Option<bool> {
        let anchor = self.progress.from.lane(lane);
        if self.batch.runs[lane].as_ref()?.scene.inputs.impulses_at(anchor).next().is_none() {
            return Some(false);
        }
        let h = FIRST * self.progress.length.lane(lane);
        let strike =
            |contact: &mut LaneContact, scene: &Scene, at: &Moment<'_>| strike(contact, scene, anchor, at);
        self.act(system, lane, start, (0.0, h), strike).then_some(true)
    }

    /// Lets `work` act on the contacts of a lane at the time `tau`, in a step of length `h`, and goes on from the state
    /// after it, or ends the run there. Returns whether it goes on.
    fn act(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        start: &mut StepStart<R>,
        (tau, h): (f64, f64),
        work: impl FnOnce(&mut LaneContact, &Scene, &Moment<'_>) -> Result<States<f64>, Box<ContactEnd>>,
    ) -> bool {
        let y = column(&start.y, lane);
        let at = Moment { earlier: false, tau, h, y: &y };
        match self.batch.act(lane, |contact, scene| work(contact, scene, &at)) {
            Some(Ok(y)) => put(&mut start.y, lane, &y),
            Some(Err(end)) => {
                self.end_at_event(system, lane, start, (&end, h));
                return false;
            }
            None => {}
        }
        true
    }

    /// Ends the run in a lane at an event of its contacts.
    fn end_at_event(
        &mut self,
        system: &impl System<R>,
        lane: usize,
        start: &StepStart<R>,
        (end, h): (&ContactEnd, f64),
    ) {
        let Some(before) = self.last(system, lane, start) else { return };
        if let Some((end, last)) = self.batch.contact_end(lane, end, (before, h)) {
            self.retire(system, lane, end, &last);
        }
    }
}
