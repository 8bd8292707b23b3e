//! Derivatives through the events of unilateral contact.
//!
//! The run without derivatives says what happens in a step: which events are due after which time, and what they do. The
//! numbers with derivatives do the same. At an event the condition e of the mode that ends is zero, so the derivative of the
//! event's time is minus that of e, over the rate of e along the step (implicit function theorem). From there on the time is
//! a number with derivatives as well, until the step ends at a time that is fixed. So a state jumps by the saltation matrix.

use crate::error::{Error, Result};
use crate::formulation::{Contact, Evaluation, MAX_COMPONENTS, RunDual, RunDualEquations, States, System};
use crate::method::{RunDualMethod, Step, Unsolved, values};
use crate::model::{Mode, Scene, SegmentDrive, Source};
use crate::number::{Instructions, LaneTask, Lanes, Real, task};
use crate::stepping::{Event, EventResult, LaneContact, Limits, Moment, Options, Passage};

/// Events closer together than this share of a step are one, whose derivative depends on their order.
const TOGETHER: f64 = 1e-9;
/// A condition whose rate at its event is below this share of its mean rate in the step only grazes zero.
const GRAZING: f64 = 1e-6;
/// A share of a step in which the mean rate says nothing.
const SHORT: f64 = 1e-3;

/// The contacts of a run with derivatives.
pub struct ContactDerivatives<R> {
    instructions: Instructions,
    lane: LaneContact,
    limits: Limits<RunDual<R>>,
    /// The time of the last event or breakpoint, and the end of the segment, since its start, s.
    last: f64,
    end: f64,
    /// The length of the first step of the segment, s.
    h: f64,
    /// The times of the changes of modes, with their derivatives.
    pub changes: Vec<RunDual<R>>,
}

/// A time of a segment and the state there.
type Instant<'a, R> = (RunDual<R>, &'a States<RunDual<R>>);

/// The equations and the method of a run.
pub type Stepper<'a, R> = (&'a RunDualEquations<R>, &'a mut RunDualMethod<R>);

impl<R: Lanes> ContactDerivatives<R> {
    #[inline(always)]
    pub fn new(
        instructions: Instructions,
        options: &Options,
        scene: &Scene,
        source: &impl Source<RunDual<R>>,
    ) -> Result<Self> {
        let mut lane = LaneContact::new(instructions, options, scene);
        lane.restart(options, scene)?;
        Ok(Self {
            instructions,
            lane,
            limits: Limits::new(source),
            last: 0.0,
            end: 0.0,
            h: 0.0,
            changes: Vec::new(),
        })
    }

    /// Begins a segment of the run with the inputs `plain` and chooses the modes. Returns whether these change.
    #[inline(always)]
    pub fn enter(
        &mut self,
        stepper: Stepper<'_, R>,
        (plain, drive): (SegmentDrive, &mut SegmentDrive<RunDual<R>>),
        ([anchor, end], tau, h): ([f64; 2], f64, f64),
        y: &mut States<RunDual<R>>,
    ) -> Result<bool> {
        let modes = self.lane.run.modes();
        self.lane.enter(anchor, plain);
        (self.last, self.end, self.h) = (tau, end - anchor, h);
        let (from, at) = (&y.clone(), RunDual::constant(tau));
        self.follow(stepper, drive, (at, from), (0.0, y, &[RunDual::zero(); 3]), |lane, y| {
            lane.begin(&Moment { earlier: false, tau, h, y }).map(drop)
        })?;
        Ok(modes != self.lane.run.modes())
    }

    /// Applies an impulse to the object.
    #[inline(always)]
    pub fn strike(
        &mut self,
        stepper: Stepper<'_, R>,
        drive: &mut SegmentDrive<RunDual<R>>,
        tau: RunDual<R>,
        y: &mut States<RunDual<R>>,
        impulse: &[RunDual<R>; 3],
    ) -> Result {
        let plain = impulse.map(|component| component.lane(0));
        let (h, from) = (self.h, &y.clone());
        self.follow(stepper, drive, (tau, from), (0.0, y, impulse), |lane, y| {
            let at = Moment { earlier: false, tau: tau.lane(0), h, y };
            lane.change(&at, |stepper, place| stepper.strike(place, &plain)).map(drop)
        })
    }

    /// Lets the events of a step of length `h` happen, which arrives at `next` without them. The contacts go on from there,
    /// unless it is a `row` inside a step of the run.
    #[inline(always)]
    pub fn advance(
        &mut self,
        stepper: Stepper<'_, R>,
        drive: &mut SegmentDrive<RunDual<R>>,
        from: Instant<'_, R>,
        (h, next, row): (f64, &mut States<RunDual<R>>, bool),
    ) -> Result {
        let (before, last, changes) = (self.lane.run.clone(), self.last, self.changes.len());
        let plain = values(next);
        let found = self.follow(stepper, drive, from, (h, next, &[RunDual::zero(); 3]), |lane, y| {
            lane.advance(&Moment { earlier: false, tau: from.0.lane(0), h, y }, &plain).map(drop)
        });
        if row {
            (self.lane.run, self.last) = (before, last);
            self.changes.truncate(changes);
        }
        found
    }

    /// Lets the run without derivatives do `work`, and follows what happens in it.
    #[inline(always)]
    fn follow(
        &mut self,
        stepper: Stepper<'_, R>,
        drive: &mut SegmentDrive<RunDual<R>>,
        (tau, y): Instant<'_, R>,
        (h, next, impulse): (f64, &mut States<RunDual<R>>, &[RunDual<R>; 3]),
        work: impl FnOnce(&mut LaneContact, &States<f64>) -> EventResult,
    ) -> Result {
        self.lane.run.log = Some(Vec::new());
        let ended = work(&mut self.lane, &values(y)).is_err();
        let mut log = self.lane.run.log.take().unwrap_or_default();
        while ended && !matches!(log.last(), None | Some(Passage::Modes(..))) {
            // The event at which the run ends happens after its last row.
            log.pop();
        }
        if !log.is_empty() {
            let instructions = self.instructions;
            *next =
                R::call(instructions, Pass { contact: self, stepper, drive, tau, y, h, impulse, log: &log })?;
        }
        Ok(())
    }

    #[inline(always)]
    fn pass(
        &mut self,
        (equations, method): Stepper<'_, R>,
        drive: &mut SegmentDrive<RunDual<R>>,
        (start, y): Instant<'_, R>,
        (h, impulse): (f64, &[RunDual<R>; 3]),
        log: &[Passage],
    ) -> Result<States<RunDual<R>>> {
        let (mut tau, mut y, system, anchor) = (start, *y, &equations.system, self.lane.run.anchor);
        for &passage in log {
            let time = anchor + tau.lane(0);
            let undefined = |why| Error::NoEventDerivative { time, why };
            match passage {
                Passage::Step(length, event) => {
                    let by;
                    (by, y) = self.reach((equations, &mut *method), drive, (tau, &y), (length, h), event)?;
                    tau = tau + by;
                    let now = tau.lane(0);
                    let close = |other: f64| (now - other).abs() <= TOGETHER * h;
                    if close(self.last) || close(self.end) {
                        return Err(undefined("an event coincides with another one or with a breakpoint"));
                    }
                    self.last = now;
                }
                Passage::Jump(jump) => system.apply((drive, tau), &mut y, jump, impulse),
                Passage::Modes(contacts, changes) => {
                    hold(system, drive, (tau, &y), &contacts);
                    self.changes.resize(changes, RunDual::constant(anchor) + tau);
                }
                Passage::Undefined(why) => return Err(undefined(why)),
            }
        }
        let rest = start + RunDual::constant(h) - tau;
        Ok(if h > 0.0 { step((equations, method), drive, (tau, &y), rest)?.0 } else { y })
    }

    /// The step that leads to an event, with the derivative of its length, and the state there.
    #[inline(always)]
    fn reach(
        &self,
        (equations, method): Stepper<'_, R>,
        drive: &SegmentDrive<RunDual<R>>,
        from: Instant<'_, R>,
        (length, h): (f64, f64),
        event: Event,
    ) -> Result<(RunDual<R>, States<RunDual<R>>)> {
        let (mut by, mut y, mut found) = (RunDual::constant(length), *from.1, [RunDual::<R>::zero(); 2]);
        let first = equations.system.evaluate(drive, from.0, &y);
        let before = self.limits.event_value(&first, &drive.contacts, event).lane(0);
        // Derivatives are linear in that of the length, so two of them give the one at which the condition stays zero.
        for trial in 0..3 {
            for k in 0..by.slope.len() {
                by.slope[k] = match trial {
                    0 => R::zero(),
                    1 => R::constant(1.0),
                    _ => -(found[0].slope[k] / (found[1].slope[k] - found[0].slope[k])),
                };
            }
            let now;
            (y, now) = step((equations, &mut *method), drive, from, by)?;
            if trial < 2 {
                found[trial] = self.limits.event_value(&now, &drive.contacts, event);
            }
        }
        let rate = found[1].direction(0) - found[0].direction(0);
        // Round-off has a part in the values of conditions that are zero where a step begins.
        let falls = -rate * length > GRAZING * before || length < SHORT * h;
        if !(rate < 0.0 && falls) {
            let time = self.lane.run.anchor + (from.0 + by).lane(0);
            return Err(Error::NoEventDerivative { time, why: "an event only just happens" });
        }
        Ok((by, y))
    }
}

task! {
    /// Follows what happens in a step.
    ['w, R: Lanes]
    Pass<'w, R>(contact: &'w mut ContactDerivatives<R>, stepper: Stepper<'w, R>,
        drive: &'w mut SegmentDrive<RunDual<R>>, tau: RunDual<R>, y: &'w States<RunDual<R>>, h: f64,
        impulse: &'w [RunDual<R>; 3], log: &'w [Passage])
    for R => Result<States<RunDual<R>>> = contact.pass(stepper, drive, (tau, y), (h, impulse), log)
}

/// Puts the modes of the contacts into the inputs of a segment. A tip that opens freezes its tilt in the state `y`.
#[inline(always)]
fn hold<R: Lanes>(
    system: &impl System<RunDual<R>>,
    drive: &mut SegmentDrive<RunDual<R>>,
    (tau, y): Instant<'_, R>,
    contacts: &[Contact; 2],
) {
    let (kept, tilts) = (drive.contacts.frozen_tilt, contacts.map(|contact| contact.frozen_tilt));
    (0..R::WIDTH).for_each(|lane| drive.contacts.set(lane, contacts.map(|contact| contact.mode), tilts));
    if contacts.iter().all(|contact| contact.mode != Mode::Free) {
        return;
    }
    let now = system.evaluate(drive, tau, y).tilt;
    for i in 0..2 {
        let slope = if kept[i].lane(0) == tilts[i] { kept[i].slope } else { now[i].slope };
        drive.contacts.frozen_tilt[i].slope = slope;
    }
}

/// A step of the method, and the evaluation at its end.
#[inline(always)]
fn step<R: Lanes>(
    (equations, method): Stepper<'_, R>,
    drive: &SegmentDrive<RunDual<R>>,
    (tau, y): Instant<'_, R>,
    h: RunDual<R>,
) -> Result<(States<RunDual<R>>, Evaluation<RunDual<R>>)> {
    let system = &equations.system;
    let rate = &system.evaluate(drive, tau, y).rate;
    let mut next = [RunDual::zero(); MAX_COMPONENTS];
    let attempt = method.step(equations, &Step { system, drive, tau, h, y, rate, allowed: None }, &mut next);
    attempt.map_err(|Unsolved { correction, .. }| Error::NoDerivative { time: tau.lane(0), correction })?;
    system.correct(drive, tau + h, &mut next);
    Ok((next, system.evaluate(drive, tau + h, &next)))
}
