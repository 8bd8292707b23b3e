//! The contacts of the run in a lane, in unilateral contact. The work at events is done here for this run alone,
//! with a step of the run's own method, so that its result does not depend on the runs beside it.

use crate::error::Result;
use crate::formulation::{Contact, Evaluation, States, System};
use crate::method::{Stats, Unsolved};
use crate::model::{
    ContactRow, Contacts, Geometry, Mode, Motion, Parameters, Scene, SegmentDrive, Slip, State,
    allowed_residuals,
};
use crate::stepping::lone_steps::LoneSteps;
use crate::stepping::{
    Change, ContactEnd, ContactRun, EventResult, EventStepper, Instant, Limits, Options, Reason,
    SegmentState, Steps, Violation, ViolationSet, watched,
};

struct Segment {
    anchor: f64,
    drive: SegmentDrive,
}

pub struct LaneContact {
    pub run: ContactRun,
    steps: LoneSteps,
    limits: Limits<f64>,
    /// The segment of the run, the segment before it, and whether the last event was in that one.
    segment: Segment,
    earlier: Segment,
    in_earlier: bool,
    /// Before the run has begun: whether its contacts follow from the state, and then whether a closed one approaches.
    unset: Option<bool>,
    /// Whether the run has not begun, and may start from a state that another formulation has left.
    fresh: bool,
    /// The time during which a tip was free, counted up to `counted`.
    free_time: f64,
    counted: f64,
}

/// A state of the run at a time of its segment, or of the segment before it.
#[derive(Clone, Copy)]
pub struct Moment<'a> {
    pub earlier: bool,
    /// The time since the start of the segment, s.
    pub tau: f64,
    /// The length of the step from there, s.
    pub h: f64,
    pub y: &'a States<f64>,
}

impl LaneContact {
    /// Contacts that are restarted before they are used.
    pub fn new(options: &Options, scene: &Scene) -> Self {
        let still = || Segment { anchor: 0.0, drive: SegmentDrive::still() };
        let mut limits = Limits::new(&scene.parameters);
        limits.ends = options.stop_on;
        Self {
            run: ContactRun::new([Contact::touching(); 2]),
            steps: LoneSteps::new(options, scene),
            limits,
            segment: still(),
            earlier: still(),
            in_earlier: false,
            unset: None,
            fresh: false,
            free_time: 0.0,
            counted: 0.0,
        }
    }

    /// Puts the contacts at the start of a run with the same parameters and options, whose equations are kept.
    pub fn restart(&mut self, options: &Options, Scene { parameters, initial, .. }: &Scene) -> Result {
        let (contacts, unset) = match &initial.contact {
            Some(row) => (Contact::of_row(row)?, None),
            None => contacts_at(parameters, initial),
        };
        self.run = ContactRun::new(contacts);
        // A run in equal steps that goes on from another one takes its bits, residuals included.
        self.fresh = initial.grid.is_none() || !matches!(options.steps, Steps::Fixed(_));
        (self.in_earlier, self.unset, self.free_time) = (false, unset, 0.0);
        self.counted = options.summaries.after.max(initial.time);
        Ok(())
    }

    /// The multipliers at the start of a run, in the modes that the inputs of `drive` choose there. The run itself
    /// chooses its modes when it begins.
    pub fn multipliers(options: &Options, scene: &Scene, drive: SegmentDrive, h: f64) -> Result<[f64; 4]> {
        let mut contact = Self::new(options, scene);
        contact.restart(options, scene)?;
        let State { time, motion, .. } = &scene.initial;
        contact.enter(*time, drive);
        let y = contact.steps.system.begin(motion);
        let begun = contact.begin(&Moment { earlier: false, tau: 0.0, h, y: &y });
        Ok(contact.evaluate(0.0, &begun.unwrap_or_else(|end| end.y)).multipliers)
    }

    /// Evaluates a state in the last segment with an event, in the present modes.
    fn evaluate(&self, tau: f64, y: &States<f64>) -> Evaluation<f64> {
        let Segment { drive, .. } = if self.in_earlier { &self.earlier } else { &self.segment };
        let mut drive = drive.clone();
        self.run.put_into(&mut drive.contacts, 0);
        self.steps.system.evaluate(&drive, tau, y)
    }

    /// Begins a segment with these inputs, which starts at `anchor`.
    pub fn enter(&mut self, anchor: f64, drive: SegmentDrive) {
        self.earlier = std::mem::replace(&mut self.segment, Segment { anchor, drive });
    }

    pub(super) fn act<T>(
        &mut self,
        at: &Moment<'_>,
        work: impl FnOnce(&mut EventStepper<'_>, &mut SegmentState) -> EventResult<T>,
    ) -> EventResult<T> {
        let Self { run, steps: LoneSteps { system, method }, limits, .. } = self;
        self.in_earlier = at.earlier;
        let Segment { anchor, drive } = if at.earlier { &mut self.earlier } else { &mut self.segment };
        run.anchor = *anchor;
        run.log.clear();
        run.put_into(&mut drive.contacts, 0);
        method.forget_start();
        let mut place = SegmentState { tau: at.tau, y: *at.y };
        let Some(equations) = system.contact(drive) else { return Err(place.end(Reason::NoMode)) };
        let mut stepper = EventStepper { system, equations, method, limits, run, drive, h: at.h };
        work(&mut stepper, &mut place)
    }

    /// Calls `work` with the stepper at a moment, and returns the state after it.
    pub fn change(
        &mut self,
        at: &Moment<'_>,
        work: impl FnOnce(&mut EventStepper<'_>, &mut SegmentState) -> EventResult,
    ) -> EventResult<States<f64>> {
        self.act(at, |stepper, place| work(stepper, place).map(|()| place.y))
    }

    /// Chooses the modes at the start of the run or at a breakpoint. Returns the state from which the run goes on.
    pub fn begin(&mut self, at: &Moment<'_>) -> EventResult<States<f64>> {
        let (unset, fresh) = (self.unset.take(), std::mem::take(&mut self.fresh));
        let corrects = self.steps.system.corrects;
        self.change(at, |stepper, place| match unset {
            Some(approaches) => stepper.start(place, approaches),
            None => {
                if fresh && corrects {
                    stepper.put_on_constraints(place);
                }
                stepper.begin(place)
            }
        })
    }

    /// Applies the impulses at time `t` to the object.
    pub fn strike(&mut self, at: &Moment<'_>, (scene, t): (&Scene, f64)) -> EventResult<States<f64>> {
        self.change(at, |stepper, place| {
            scene.inputs.impulses_at(t).try_for_each(|impulse| stepper.strike(place, &impulse))
        })
    }

    /// The state at the end of a step, after all events in it. `arrived` is the state without any.
    pub fn advance(&mut self, from: &Moment<'_>, arrived: &States<f64>) -> EventResult<States<f64>> {
        self.act(from, |stepper, place| stepper.advance(*place, arrived))
    }

    /// The instant at the end of a step that is shorter than the run's own, after the events until then. The run does
    /// not change. An event that ends the run is left to the run's own step, which may not see it.
    pub fn inside(&mut self, from: &Moment<'_>) -> Result<Instant, Unsolved> {
        let drive = &mut self.segment.drive;
        self.run.put_into(&mut drive.contacts, 0);
        self.steps.method.forget_start();
        self.in_earlier = from.earlier;
        let run = self.run.clone();
        let y = if from.h > 0.0 {
            let LoneSteps { system, method } = &mut self.steps;
            let arrived = method.step(system, drive, (from.tau, from.y), from.h)?;
            self.advance(from, &arrived).unwrap_or(arrived)
        } else {
            *from.y
        };
        let row = self.last(&ContactEnd { reason: Reason::NoMode, tau: from.tau + from.h, y });
        self.run = run;
        Ok(row)
    }

    pub fn last(&self, end: &ContactEnd) -> Instant {
        let now = self.evaluate(end.tau, &end.y);
        let t = if self.in_earlier { &self.earlier } else { &self.segment }.anchor + end.tau;
        watched(self.steps.system.size(), (0, Some(self.row())), &now, &end.y, t, (t, 0))
    }

    /// The violations at the instant at which this one ends the run.
    pub fn shown(&self, end: &ContactEnd, violation: Violation) -> ViolationSet {
        let mut contacts = Contacts::sticking();
        self.run.put_into(&mut contacts, 0);
        let mut found = self.limits.violated(&self.evaluate(end.tau, &end.y), Some(&contacts));
        found[violation as usize] = 1;
        ViolationSet::of(&found, 0)
    }

    /// Whether the modes are to be chosen from the state at which the run starts.
    pub fn is_unset(&self) -> bool {
        self.unset.is_some()
    }

    pub fn row(&self) -> ContactRow {
        Contact::row(&self.run.contacts)
    }

    pub fn is_closed(&self) -> bool {
        self.run.contacts.iter().all(|contact| contact.closed)
    }

    /// Takes the changes of the modes since the last call, and the work that was done.
    pub fn take_changes(&mut self) -> (Vec<Change>, Stats) {
        let changes = std::mem::take(&mut self.run.changes);
        for (k, change) in changes.iter().enumerate() {
            let was_free = |i: usize| {
                let next = changes[k..].iter().find(|later| later.finger == i);
                next.map_or(self.run.contacts[i].mode, |next| next.before) == Mode::Free
            };
            self.count_until(change.time, was_free(0) || was_free(1));
        }
        (changes, std::mem::take(&mut self.steps.method.stats))
    }

    /// The time during which a tip was free, until `t`, s.
    pub fn free_time(&mut self, t: f64) -> f64 {
        self.count_until(t, !self.is_closed());
        self.free_time
    }

    fn count_until(&mut self, t: f64, free: bool) {
        if t > self.counted {
            self.free_time += if free { t - self.counted } else { 0.0 };
            self.counted = t;
        }
    }
}

/// The contacts that follow from a state, and whether a closed one approaches its face. A contact is closed
/// unless it has a gap or opens, or its surface would have to be stretched; its face slips unless the velocity of the
/// slip is round-off.
fn contacts_at(parameters: &Parameters, State { motion, .. }: &State) -> ([Contact; 2], Option<bool>) {
    let Motion { q, p, .. } = motion;
    let geometry = Geometry::of_scene(parameters, q, p);
    let (gaps, rates) = (geometry.residuals(), geometry.constraint_velocity());
    let allowed = allowed_residuals(parameters, &geometry, q, p);
    let mut approaches = false;
    let contacts = std::array::from_fn(|i| {
        let [place, normal, tangential] = allowed[i];
        let reaches = q.compression[i] - gaps[i] >= -place;
        let closed = reaches && gaps[i] <= place && rates[i] <= normal;
        approaches |= closed && rates[i] < -normal;
        let slip = if closed { Slip::of(rates[2 + i], tangential) } else { None };
        let mode = match slip {
            _ if !closed => Mode::Free,
            Some(direction) => Mode::Slip(direction),
            None => Mode::Stick,
        };
        Contact { mode, closed, slip, frozen_tilt: geometry.contacts[i].tilt, left: None }
    });
    (contacts, Some(approaches))
}
