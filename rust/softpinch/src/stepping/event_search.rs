//! The steps of a run with unilateral contact between its events, and the search for the events in a step. An event is
//! located on the method's own step, which is repeated with a shorter length, so that the method keeps its order across
//! events.

use crate::formulation::{
    ContactEquations, Equations, Evaluation, InputAt, SceneEquations, States, System, Terms,
};
use crate::model::{Geometry, Input, Motion, SegmentDrive};
use crate::number::Real;
use crate::stepping::contact_events::CAUSES;
use crate::stepping::lone_steps::LoneMethod;
use crate::stepping::monitor::{Condition, Failure, ROUND_OFF};
use crate::stepping::{Cause, ContactEnd, ContactRun, Event, EventResult, Limits, MOST_EVENTS, Reason};

/// Largest number of repeated steps that locate one event. Most take about ten.
const MOST_TRIALS: usize = 60;
/// Where a condition is zero when its mode begins, such as the gap, it is looked at after this share of the step;
/// if it fails there, after this share of that time, and so on, at most so many times.
const EARLY: f64 = 1.0 / 1024.0;
const EARLIEST: i32 = 4;
/// A rest of a step below this share of it is taken without a look at its events: round-off could make them up.
/// The next step finds them.
pub(super) const SLIVER: f64 = 1.0 / (1u64 << 40) as f64;
/// An event is located to this share of the step.
const RESOLUTION: f64 = 1.0 / (1u64 << 50) as f64;

#[derive(Debug, Clone, Copy)]
pub struct SegmentState {
    pub tau: f64,
    pub y: States<f64>,
}

impl SegmentState {
    pub fn end(&self, reason: Reason) -> Box<ContactEnd> {
        Box::new(ContactEnd { reason, tau: self.tau, y: self.y })
    }
}

/// One run within a step.
pub struct EventStepper<'a> {
    pub system: &'a SceneEquations<f64>,
    pub equations: ContactEquations<'a>,
    pub method: &'a mut LoneMethod,
    pub limits: &'a Limits<f64>,
    pub run: &'a mut ContactRun,
    /// The inputs of the segment, with the modes of the contacts.
    pub drive: &'a mut SegmentDrive,
    /// The length of the run's own step.
    pub h: f64,
}

impl EventStepper<'_> {
    pub fn step_from(&mut self, from: &SegmentState, h: f64) -> EventResult<States<f64>> {
        let step = self.method.step(self.system, self.drive, (from.tau, &from.y), h);
        step.map_err(|unsolved| from.end(Reason::Unsolved(unsolved)))
    }

    pub fn input(&self, tau: f64) -> Input<f64> {
        f64::outlined(InputAt { drive: self.drive, tau })
    }

    pub fn geometry(&self, motion: &Motion<f64>) -> Geometry<f64> {
        Geometry::called(&self.equations.plant().sides, &motion.q, &motion.p)
    }

    pub fn terms_at(&self, tau: f64, y: &States<f64>) -> (Terms<f64>, Motion<f64>) {
        let input = self.input(tau);
        let motion = self.equations.unpack(self.equations.plant().driven, &input, y);
        (self.equations.terms(&input, &self.drive.contacts, &motion), motion)
    }

    pub fn motion(&self, place: &SegmentState) -> Motion<f64> {
        self.equations.unpack(self.equations.plant().driven, &self.input(place.tau), &place.y)
    }

    /// Writes a motion into a state, whose works stay.
    pub fn store(&self, place: &mut SegmentState, motion: &Motion<f64>) {
        let (states, driven) = (self.system.size().states, self.equations.plant().driven);
        place.y[..states].copy_from_slice(&self.equations.begin(driven, motion)[..states]);
    }

    /// Adds to a work of the ledger, if it is carried.
    pub fn book(&self, place: &mut SegmentState, which: usize, amount: f64) {
        if self.system.size().works > 0 {
            place.y[self.system.size().states + which] += amount;
        }
    }

    pub fn energy(&self, motion: &Motion<f64>) -> f64 {
        if self.system.size().works == 0 {
            return 0.0;
        }
        self.system.energies(&self.run.held(self.equations.tilts(&motion.q)), motion).total()
    }

    /// The earliest event in a step of length `h` that ends at `arrived`, and the length of the step that leads
    /// to it; `None` if no event is due at the end.
    ///
    /// At the event that is found, another one may be due that is over at the end of the step: lambda^H of a slipping
    /// tip turns negative, and then positive again once the tip's surface is stretched. So the shorter step is looked at in its
    /// turn.
    pub fn earliest(
        &mut self,
        from: &SegmentState,
        (h, arrived): (f64, &States<f64>),
    ) -> EventResult<Option<(f64, Event)>> {
        let (mut last, mut y) = (h, *arrived);
        if let Some(length) = self.corner(from, (h, arrived))? {
            (last, y) = (length, self.step_from(from, length)?);
        }
        let mut located: Vec<(f64, Event)> = Vec::new();
        let mut earliest: Option<(f64, Event)> = None;
        for _ in 0..MOST_EVENTS {
            let end = earliest.map_or(last, |(length, _)| length);
            let (terms, motion) = self.terms_at(from.tau + end, &y);
            if terms.response.acceleration.row().iter().any(|a| !a.is_finite()) {
                return Err(from.end(Reason::NotFinite));
            }
            for (event, at_end) in self.values(&terms, &motion).filter(|&(_, value)| value < 0.0) {
                if located.iter().any(|&(length, known)| known == event && length <= end) {
                    continue;
                }
                let length = self.locate(from, (end, h), (event, at_end))?;
                located.push((length, event));
                if earliest.is_none_or(|(least, _)| length < least) {
                    earliest = Some((length, event));
                }
            }
            match earliest {
                Some((length, _)) if length < end => y = self.step_from(from, length)?,
                _ => break,
            }
        }
        Ok(earliest)
    }

    /// The length of a step that ends where a free tip passes the end of its side, if that tip is behind the side there: then
    /// it has met the side, although no impact is due at the end of the step of length `h` to `arrived`, beyond the side.
    fn corner(&mut self, from: &SegmentState, (h, arrived): (f64, &States<f64>)) -> EventResult<Option<f64>> {
        for i in 0..2 {
            if self.run.contacts[i].closed {
                continue;
            }
            // Whether the tip is behind its side, and beyond its end.
            let quadrant = |stepper: &Self, tau: f64, y: &States<f64>| {
                let geometry = stepper.geometry(&stepper.motion(&SegmentState { tau, y: *y }));
                let height = geometry.contact_heights()[i].abs();
                (geometry.residuals()[i] < 0.0, height >= stepper.limits.half_height[i])
            };
            let [before, after] = [(from.tau, &from.y), (from.tau + h, arrived)];
            if quadrant(self, before.0, before.1) != (false, false) || !quadrant(self, after.0, after.1).1 {
                continue;
            }
            let (mut low, mut high, mut meets) = (0.0, h, false);
            while high - low > SLIVER * h {
                let middle = 0.5 * (low + high);
                let y = self.step_from(from, middle)?;
                let (behind, beyond) = quadrant(self, from.tau + middle, &y);
                if beyond {
                    high = middle;
                } else {
                    (low, meets) = (middle, behind);
                }
            }
            if meets {
                return Ok(Some(low));
            }
        }
        Ok(None)
    }

    /// The length of the step at whose end an event is just due, by the Illinois method (Dowell and Jarratt, "A
    /// modified regula falsi method for computing the root of an equation", 1971). It is due in the step of length
    /// `end`; the resolution is a share of `h`, because an implicit step may be too short to be solved.
    fn locate(
        &mut self,
        from: &SegmentState,
        (end, h): (f64, f64),
        (event, at_end): (Event, f64),
    ) -> EventResult<f64> {
        let shortest = EARLY.powi(EARLIEST) * h;
        let (mut low, mut at_low) = (0.0, self.value(from.tau, &from.y, event));
        let (mut high, mut at_high) = (end, at_end);
        for _ in 0..EARLIEST {
            if at_low > 0.0 || EARLY * high < shortest {
                break;
            }
            low = EARLY * high;
            at_low = self.value_after(from, low, event)?;
            if at_low <= 0.0 {
                (high, at_high) = (low, at_low);
            }
        }
        if at_low <= 0.0 {
            return Ok(high);
        }
        let mut last = None;
        for _ in 0..MOST_TRIALS {
            if high - low <= RESOLUTION * h {
                break;
            }
            let secant = low + (high - low) * (at_low / (at_low - at_high));
            // A secant that leaves the bracket by round-off would repeat one of its ends.
            let length = if secant > low && secant < high { secant } else { 0.5 * (low + high) };
            if length <= low || length >= high {
                break;
            }
            let value = self.value_after(from, length, event)?;
            let below = value > 0.0;
            if below {
                (low, at_low) = (length, value);
            } else {
                (high, at_high) = (length, value);
                if value == 0.0 {
                    break;
                }
            }
            // An end that stays twice counts half, so that the secant moves to its other side.
            if last == Some(below) {
                if below {
                    at_high *= 0.5;
                } else {
                    at_low *= 0.5;
                }
            }
            last = Some(below);
        }
        Ok(high)
    }

    fn value_after(&mut self, from: &SegmentState, length: f64, event: Event) -> EventResult<f64> {
        let y = self.step_from(from, length)?;
        Ok(self.value(from.tau + length, &y, event))
    }

    fn value(&self, tau: f64, y: &States<f64>, event: Event) -> f64 {
        let (terms, motion) = self.terms_at(tau, y);
        self.values(&terms, &motion).find(|&(other, _)| other == event).map_or(1.0, |(_, value)| value)
    }

    /// The values of the events that the contacts can have in their modes.
    fn values(&self, terms: &Terms<f64>, motion: &Motion<f64>) -> impl Iterator<Item = (Event, f64)> + use<> {
        let Terms { geometry, response, .. } = terms;
        let state = Evaluation::of_contacts(motion, &response.multipliers, geometry, response.share);
        let graze = self.drive.contacts.graze.map(|lanes| lanes & 1 != 0);
        let mut values = [[None; CAUSES.len()]; 2];
        let size = response.acceleration.object[0].abs() + response.acceleration.object[1].abs();
        for (finger, own) in values.iter_mut().enumerate() {
            // The part psi is an acceleration over that which the couple makes.
            let round_off = ROUND_OFF * (1.0 + size / response.couple_effect(finger, graze));
            self.limits.conditions(&state, Some(&self.drive.contacts), finger, true, |condition| {
                let Condition { failure: Failure::Event(cause), lanes, value, .. } = condition else {
                    return;
                };
                let value = if cause == Cause::Share { value + round_off } else { value };
                own[cause as usize] = (lanes & 1 != 0).then_some((Event { finger, cause }, value));
            });
        }
        values.into_iter().flatten().flatten()
    }
}
