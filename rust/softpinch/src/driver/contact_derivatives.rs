//! Derivatives through the events of unilateral contact.
//!
//! The run without derivatives says what happens in a step: which events are due after which time, and what they do. The
//! numbers with derivatives do the same. At an event the condition of the mode that ends is zero, so the derivative of its
//! time is minus that of the condition, over the rate of the condition along the step (implicit function theorem). From there
//! on the time is a number with derivatives, until the step ends at a time that is fixed: the state jumps by the saltation
//! matrix.

use crate::error::{Error, Result};
use crate::formulation::{Evaluation, MAX_COMPONENTS, RunDual, RunDualEquations, States, System};
use crate::method::{RunDualMethod, Step, Unsolved, values};
use crate::model::{Mode, SegmentDrive};
use crate::number::{LaneTask, Lanes, Real, task};
use crate::stepping::{Cause, Event, EventResult, LaneContact, Limits, Passage};

/// Events closer together than this share of a step are one, whose derivative depends on their order.
const TOGETHER: f64 = 1e-9;
/// A condition whose rate at its event is below this share of its mean rate in the step only grazes zero.
const GRAZING: f64 = 1e-6;
/// A share of a step in which round-off has a part in the mean rate.
const SHORT: f64 = 1e-3;

const COINCIDES: &str = "an event coincides with another one or with a breakpoint";

/// The method of a run with derivatives, and its contacts if they are unilateral.
pub struct Stepper<R> {
    pub method: RunDualMethod<R>,
    pub contact: Option<ContactDerivatives<R>>,
}

pub struct ContactDerivatives<R> {
    pub lane: LaneContact,
    pub limits: Limits<RunDual<R>>,
    /// The time of the last event or breakpoint, and the end of the segment, since its start, s.
    pub between: [f64; 2],
    /// The times of the changes of modes.
    pub changes: Vec<RunDual<R>>,
}

/// The state at a time of a segment, and its equations.
pub struct Place<'a, R> {
    pub equations: &'a RunDualEquations<R>,
    pub drive: &'a mut SegmentDrive<RunDual<R>>,
    pub tau: RunDual<R>,
    pub y: States<RunDual<R>>,
}

/// The state at the end of a step, and its evaluation.
type End<R> = (States<RunDual<R>>, Evaluation<RunDual<R>>);

task! {
    ['w, R: Lanes]
    Pass<'w, R>(stepper: &'w mut Stepper<R>, place: Place<'w, R>, h: f64, impulse: &'w [RunDual<R>; 3],
        log: &'w [Passage])
    for R => Result<States<RunDual<R>>> = stepper.pass(place, (h, impulse), log)
}

impl<R: Lanes> Stepper<R> {
    /// Lets the contacts do `work` in a step of length `h`, with an impulse on the object, and follows it to the end of the
    /// step. `None` if nothing happens.
    #[inline(always)]
    pub fn follow(
        &mut self,
        place: Place<'_, R>,
        (h, impulse): (f64, &[RunDual<R>; 3]),
        work: impl FnOnce(&mut LaneContact, &States<f64>) -> EventResult<States<f64>>,
    ) -> Result<Option<States<RunDual<R>>>> {
        let Some(contact) = &mut self.contact else { return Ok(None) };
        let ended = work(&mut contact.lane, &values(&place.y)).is_err();
        let mut log = contact.lane.run.log.clone();
        while ended && !matches!(log.last(), None | Some(Passage::Modes(..))) {
            // The event at which the run ends happens after its last row.
            log.pop();
        }
        if log.is_empty() {
            return Ok(None);
        }
        R::outlined(Pass { stepper: self, place, h, impulse, log: &log }).map(Some)
    }

    #[inline(always)]
    fn pass(
        &mut self,
        mut place: Place<'_, R>,
        (h, impulse): (f64, &[RunDual<R>; 3]),
        log: &[Passage],
    ) -> Result<States<RunDual<R>>> {
        let end = place.tau + RunDual::constant(h);
        let mut begins = false;
        for &passage in log {
            let mut why = None;
            match passage {
                Passage::Step(length, event) => {
                    begins = event.cause == Cause::Cone;
                    why = self.reach(&mut place, (length, h), event)?;
                }
                Passage::Jump(jump) => {
                    place.equations.system.apply((place.drive, place.tau), &mut place.y, jump, impulse);
                }
                Passage::Modes(contacts, changes) => {
                    // A tip that opens freezes its tilt.
                    let tilt = place.equations.system.evaluate(place.drive, place.tau, &place.y).tilt;
                    let held = &mut place.drive.contacts;
                    let [right, left] = contacts;
                    let (kept, tilts) = (held.frozen_tilt, [right.frozen_tilt, left.frozen_tilt]);
                    for lane in 0..R::WIDTH {
                        held.set(lane, [right.mode, left.mode], tilts);
                    }
                    for i in 0..2 {
                        if contacts[i].mode == Mode::Free {
                            let same = kept[i].lane(0) == tilts[i];
                            held.frozen_tilt[i].slope = if same { kept[i].slope } else { tilt[i].slope };
                        }
                    }
                    if let Some(contact) = &mut self.contact {
                        // Where a slip begins forces do not jump, so no other mode ends because of it.
                        if begins && changes > contact.changes.len() + 1 {
                            why = Some(COINCIDES);
                        } else {
                            let anchor = RunDual::constant(contact.lane.run.anchor);
                            contact.changes.resize(changes, anchor + place.tau);
                        }
                    }
                }
                Passage::Undefined(reason) => why = Some(reason),
            }
            if let (Some(why), Some(contact)) = (why, &self.contact) {
                return Err(Error::NoEventDerivative {
                    time: contact.lane.run.anchor + place.tau.lane(0),
                    why,
                });
            }
        }
        let rest = end - place.tau;
        Ok(if h > 0.0 { self.step(&place, rest)?.0 } else { place.y })
    }

    /// Takes the step that leads to an event, with the derivative of its length. Returns why there is none.
    #[inline(always)]
    fn reach(
        &mut self,
        place: &mut Place<'_, R>,
        (length, h): (f64, f64),
        event: Event,
    ) -> Result<Option<&'static str>> {
        let (mut by, mut y, mut found) = (RunDual::constant(length), place.y, [RunDual::<R>::zero(); 3]);
        // A tip that just touches at the start is relaxed but for round-off.
        let rests = event.cause == Cause::Relaxed && length <= TOGETHER * h;
        let mut now = place.equations.system.evaluate(place.drive, place.tau, &y);
        // Derivatives are linear in that of the length, so two of them give the one at which the condition stays zero.
        for trial in 0..3 {
            let Some(contact) = &self.contact else { return Ok(None) };
            found[trial] = contact.limits.event_value(&now, &place.drive.contacts, event);
            let [_, held, moving] = found;
            for k in 0..by.slope.len() {
                by.slope[k] = match trial {
                    1 => R::constant(1.0),
                    2 if !rests => -(held.slope[k] / (moving.slope[k] - held.slope[k])),
                    _ => R::zero(),
                };
            }
            (y, now) = self.step(place, by)?;
        }
        let rate = found[2].direction(0) - found[1].direction(0);
        (place.tau, place.y) = (place.tau + by, y);
        let Some(contact) = &mut self.contact else { return Ok(None) };
        let t = place.tau.lane(0);
        let [last, end] = contact.between;
        let together = (t - last).min(end - t) <= TOGETHER * h;
        contact.between[0] = t;
        let falls = -rate * length > GRAZING * found[0].lane(0) || length < SHORT * h;
        Ok(match () {
            () if rests => None,
            () if together => Some(COINCIDES),
            () if !(rate < 0.0 && falls) => Some("an event only just happens"),
            () => None,
        })
    }

    /// A step of the method, and the evaluation at its end.
    #[inline(always)]
    fn step(&mut self, Place { equations, drive, tau, y }: &Place<'_, R>, h: RunDual<R>) -> Result<End<R>> {
        let (system, tau) = (&equations.system, *tau);
        let rate = &system.evaluate(drive, tau, y).rate;
        let mut next = [RunDual::zero(); MAX_COMPONENTS];
        let step = Step { system, drive, tau, h, y, rate, allowed: None };
        let attempt = self.method.step(equations, &step, &mut next);
        attempt
            .map_err(|Unsolved { correction, .. }| Error::NoDerivative { time: tau.lane(0), correction })?;
        system.correct(drive, tau + h, &mut next);
        Ok((next, system.evaluate(drive, tau + h, &next)))
    }
}
