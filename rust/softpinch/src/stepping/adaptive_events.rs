//! What takes lanes out of the vector code of the adaptive loop: starts of segments, and events of unilateral contact.
//!
//! A step in which an event is due is taken again with the length that leads to the event. There the run goes on as at the
//! start of a segment, with a cautious first step.

use crate::formulation::{States, System};
use crate::model::Scene;
use crate::number::{Bits, LaneTask, Lanes, each, task};
use crate::stepping::{
    AdaptiveLanes, ContactEnd, EventResult, LaneContact, MOST_EVENTS, Moment, Phase, Reason, StepStart,
    column, completed, merged, put,
};

/// The share of a segment that stands in for the length of a step where none is known yet.
const FIRST: f64 = 1.0 / 1024.0;

impl<R: Lanes> AdaptiveLanes<'_, R> {
    /// Looks for events in the steps of length `h` to `arrived` in the lanes of `due`. Returns the lanes that do
    /// not take this step: they take a shorter one that ends at the event, or their run has ended.
    #[cold]
    #[inline(never)]
    pub fn find_events(&mut self, due: Bits, start: &StepStart<R>, (h, arrived): (R, &States<R>)) -> Bits {
        let mut retakes = 0;
        for lane in each(due) {
            let (bit, h) = (1 << lane, h.lane(lane));
            let (y, arrived) = (column(&start.y, lane), column(arrived, lane));
            let from = Moment { earlier: false, tau: self.progress.tau.lane(lane), h, y: &y };
            let earliest = |contact: &mut LaneContact, _: &Scene| {
                contact.act(&from, |stepper, place| stepper.earliest(place, (h, &arrived)))
            };
            match self.batch.act(lane, earliest) {
                Some(Ok(Some((length, event)))) => {
                    self.batch.steps_back(bit);
                    self.events[lane] = Some((event, h));
                    if length < h {
                        self.progress.h.set(lane, length);
                        self.batch.phases.set(bit, Phase::Approach);
                        retakes |= bit;
                    } else {
                        self.batch.phases.set(bit, Phase::Event);
                    }
                }
                Some(Err(end)) => {
                    self.end_at_event(lane, start, (&end, h));
                    retakes |= bit;
                }
                _ => {}
            }
        }
        retakes
    }

    /// Lets the events happen at which steps have just ended.
    #[cold]
    pub fn meet_events(&mut self, start: &mut StepStart<R>) {
        for lane in each(self.batch.phases.at(Phase::Event)) {
            let Some((event, h)) = self.events[lane].take() else { continue };
            let tau = self.progress.tau.lane(lane);
            self.events_in_a_row[lane] += 1;
            let chatters = self.events_in_a_row[lane] > MOST_EVENTS;
            self.act(lane, start, (tau, h), |contact, at| {
                if chatters {
                    return Err(Box::new(ContactEnd { reason: Reason::Chattering, tau, y: *at.y }));
                }
                contact.change(at, |stepper, place| stepper.happen(place, event))
            });
        }
    }

    #[cold]
    pub fn choose_modes(&mut self, begins: Bits, start: &mut StepStart<R>) {
        for lane in each(begins & self.entering()) {
            let length = self.progress.length.lane(lane);
            let last = self.progress.h.lane(lane);
            let h = if last > 0.0 { last.min(length) } else { FIRST * length };
            self.act(lane, start, (0.0, h), |contact, at| contact.begin(at));
        }
    }

    /// Lets `work` act on the contacts of a lane at the time `tau`, in a step of length `h`, and goes on from the state
    /// after it, or ends the run there.
    fn act(
        &mut self,
        lane: usize,
        start: &mut StepStart<R>,
        (tau, h): (f64, f64),
        work: impl FnOnce(&mut LaneContact, &Moment<'_>) -> EventResult<States<f64>>,
    ) {
        let y = column(&start.y, lane);
        let at = Moment { earlier: false, tau, h, y: &y };
        match self.batch.act(lane, |contact, _| work(contact, &at)) {
            Some(Ok(y)) => put(&mut start.y, lane, &y),
            Some(Err(end)) => self.end_at_event(lane, start, (&end, h)),
            None => {}
        }
    }

    fn end_at_event(&mut self, lane: usize, start: &StepStart<R>, (end, h): (&ContactEnd, f64)) {
        let Some(before) = self.last(lane, start) else { return };
        if let Some((end, last)) = self.batch.contact_end(lane, end, (before, h)) {
            self.retire(start, lane, end, &last);
        }
    }

    /// Lets the discrete controllers measure, in the lanes of `begins` with a sample due at the end of the segment.
    #[inline(always)]
    fn take_samples(&mut self, begins: Bits, start: &StepStart<R>) {
        let mut due = 0;
        for lane in each(begins) {
            let Some(run) = &self.batch.runs[lane] else { continue };
            let t = self.progress.to.lane(lane);
            let samples = run.controller.as_ref().is_some_and(|controller| controller.is_due(t));
            due |= Bits::from(samples) << lane;
        }
        if due == 0 {
            return;
        }
        let now = start.system.evaluate(&self.batch.drive, self.progress.tau, &start.y);
        self.batch.stats.evaluations += 1;
        for lane in each(due) {
            self.batch.take_sample(lane, self.progress.to.lane(lane), &now);
        }
    }

    /// Begins a segment in the lanes that enter one, or goes on in it after an event, and computes the length of the first
    /// step.
    #[inline(always)]
    fn enter(&mut self, start: &mut StepStart<R>) {
        let size = start.system.size();
        let entering = self.entering();
        self.control.restart(entering);
        self.unsolved = None;
        let over = self.progress.to.at_most(self.progress.t);
        let ends = over & self.progress.last;
        let begins = entering & over & !self.progress.last;
        if self.batch.unilateral {
            self.meet_events(start);
        }
        self.take_samples(begins & self.entering(), start);
        for lane in each(begins & self.entering()) {
            let Some(run) = &self.batch.runs[lane] else { continue };
            let from = self.progress.to.lane(lane);
            let to = run.place.segment_end(&run.scene.inputs, from);
            self.progress.enter(lane, (from, to), to == run.place.end);
            self.batch.enter_segment(lane, from, Some(from));
        }
        if self.batch.unilateral {
            self.choose_modes(begins, start);
        }
        let (times, tau) = (self.progress.t, self.progress.tau);
        let mut now = start.system.evaluate(&self.batch.drive, tau, &start.y);
        self.batch.stats.evaluations += 1;
        let seen = self.batch.watch(&start.system, &now, &start.y, times, self.entering());
        let (mut stays, mut jumped): (Bits, Bits) = (0, 0);
        for lane in each(self.entering()) {
            let bit = 1 << lane;
            let t = times.lane(lane);
            if seen.finite & bit == 0 {
                self.stop(lane, start, None);
                continue;
            }
            let instant = self.batch.instant(lane, size, (&now, &start.y), t, (t, 0));
            let due = self.batch.is_due(t, false);
            if !self.goes_on(start, lane, due, &seen, &instant) {
                continue;
            }
            if ends & bit != 0 {
                self.retire(start, lane, completed(), &instant);
                continue;
            }
            let mut jumps = false;
            if begins & bit != 0 {
                let h = FIRST * self.progress.length.lane(lane);
                match self.batch.strike(&start.system, lane, (t, tau, h), &mut start.y) {
                    Ok(struck) => jumps = struck,
                    Err(end) => {
                        self.end_at_event(lane, start, (&end, h));
                        continue;
                    }
                }
            }
            self.saved &= !bit;
            if jumps {
                self.save(lane, Some(instant));
            }
            self.progress.watched.set(lane, t);
            jumped |= Bits::from(jumps) << lane;
            stays |= bit;
        }
        self.batch.phases.set(self.entering(), Phase::Step);
        if stays == 0 {
            return;
        }
        if jumped != 0 {
            now = start.system.evaluate(&self.batch.drive, tau, &start.y);
            self.batch.stats.evaluations += 1;
        }
        start.now = merged(stays, &now, &start.now);
        start.sizes.note(size, &start.y, stays, stays);
        self.batch.stats.evaluations += 1;
        let (equations, states) = ((&start.system, &self.batch.drive), (&start.y, &start.now.rate));
        let rest = self.progress.length - tau;
        let h = start.sizes.first_step(equations, &self.control, states, (stays, tau, rest));
        self.progress.h = R::select(stays, h, self.progress.h);
    }
}

task! {
    /// This is rare, so the code is called, not inlined.
    pub ['b, 'a, R: Lanes] Enter<'b, 'a, R>(lanes: &'b mut AdaptiveLanes<'a, R>, start: &'b mut StepStart<R>)
    for R => () = lanes.enter(start)
}
