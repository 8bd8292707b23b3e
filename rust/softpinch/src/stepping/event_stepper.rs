//! The steps of a run with unilateral contact between its events. An event is located on the method's own
//! step, which is repeated with a shorter length, so that the method keeps its order across events.

use crate::formulation::contact_equations::ContactEquations;
use crate::formulation::equations::States;
use crate::formulation::system::Size;
use crate::formulation::unilateral::ContactTerms;
use crate::model::drive::{Drive, SegmentDrive};
use crate::model::motion::Motion;
use crate::stepping::contact_events::{ContactEnd, ContactRun, Event, Reason, due, values};

/// Largest number of events within one step of the run.
pub const MOST_EVENTS: usize = 64;
/// Largest number of repeated steps that locate one event. Most take about ten.
const MOST_TRIALS: usize = 60;
/// Where a condition is zero when its mode begins, such as the gap, it is looked at after this share of the step;
/// if it fails there, after this share of that time, and so on, at most so many times.
const EARLY: f64 = 1.0 / 1024.0;
const EARLIEST: u32 = 4;
/// A rest of a step below this share of it is taken without a look at its events: round-off could make them up.
/// The next step finds them.
const SLIVER: f64 = 1.0 / (1u64 << 40) as f64;
/// An event is located to this share of the step.
const RESOLUTION: f64 = 1.0 / (1u64 << 50) as f64;

/// A state within a segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Time since the start of the segment, s.
    pub(super) tau: f64,
    /// The state.
    pub(super) y: States<f64>,
}

impl Place {
    pub(super) fn end(&self, reason: Reason) -> Box<ContactEnd> {
        Box::new(ContactEnd { reason, tau: self.tau, y: self.y })
    }
}

/// Takes a step of the method from time `tau` of the segment over `h`. The error says why it is not solved.
pub(super) type StepOf<'a> =
    dyn FnMut(&SegmentDrive, f64, f64, &States<f64>) -> Result<States<f64>, Reason> + 'a;

/// Takes the steps of one run between its events.
pub(super) struct EventStepper<'a> {
    /// The equations.
    pub(super) equations: &'a dyn ContactEquations,
    /// The numbers of components of the states.
    pub(super) size: Size,
    /// Half the height of the faces.
    pub(super) half_height: f64,
    /// Takes a step of the method.
    pub(super) step: &'a mut StepOf<'a>,
}

impl EventStepper<'_> {
    /// The state at the end of a step, after all events in it. `arrived` is the state without any. The modes of the
    /// drive are those at the end.
    pub(super) fn advance(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        h: f64,
        (from, arrived): (Place, States<f64>),
    ) -> Result<States<f64>, Box<ContactEnd>> {
        let (mut place, mut rest, mut arrived) = (from, h, arrived);
        let end = place.tau + h;
        for _ in 0..=MOST_EVENTS {
            let Some((length, event)) = self.earliest(run, drive, &place, (rest, &arrived))? else {
                return Ok(arrived);
            };
            let y = self.step_from(drive, &place, length)?;
            place = Place { tau: if length < rest { place.tau + length } else { end }, y };
            self.happen(run, drive, &mut place, h, event)?;
            rest = end - place.tau;
            if rest <= 0.0 {
                return Ok(place.y);
            }
            arrived = self.step_from(drive, &place, rest)?;
            if rest <= SLIVER * h {
                return Ok(arrived);
            }
        }
        Err(place.end(Reason::Chattering))
    }

    fn step_from(
        &mut self,
        drive: &SegmentDrive,
        from: &Place,
        h: f64,
    ) -> Result<States<f64>, Box<ContactEnd>> {
        (self.step)(drive, from.tau, h, &from.y).map_err(|reason| from.end(reason))
    }

    /// The terms and the motion of a state.
    fn look(&self, drive: &SegmentDrive, tau: f64, y: &States<f64>) -> (ContactTerms<f64>, Motion<f64>) {
        let input = drive.at(tau);
        let motion = self.equations.motion(&input, y);
        (self.equations.terms(&input, &drive.contacts, &motion), motion)
    }

    /// The earliest event in a step of length `h` that ends at `arrived`, and the length of the step that leads
    /// to it; `None` if no event is due at the end.
    pub(super) fn earliest(
        &mut self,
        run: &ContactRun,
        drive: &SegmentDrive,
        from: &Place,
        (h, arrived): (f64, &States<f64>),
    ) -> Result<Option<(f64, Event)>, Box<ContactEnd>> {
        let (terms, motion) = self.look(drive, from.tau + h, arrived);
        if terms.response.acceleration.iter().any(|a| !a.is_finite()) {
            return Err(from.end(Reason::NotFinite));
        }
        let mut earliest: Option<(f64, Event)> = None;
        for (event, at_end) in due(run.modes(), self.half_height, &terms, &motion) {
            let length = self.locate(run, drive, from, h, (event, at_end))?;
            if earliest.is_none_or(|(least, _)| length < least) {
                earliest = Some((length, event));
            }
        }
        Ok(earliest)
    }

    /// The length of the step at whose end an event is just due, by the Illinois method (Dowell and Jarratt, "A
    /// modified regula falsi method for computing the root of an equation", 1971).
    fn locate(
        &mut self,
        run: &ContactRun,
        drive: &SegmentDrive,
        from: &Place,
        h: f64,
        (event, at_end): (Event, f64),
    ) -> Result<f64, Box<ContactEnd>> {
        let (mut low, mut at_low) = (0.0, self.value(run, drive, (from.tau, &from.y), event));
        let (mut high, mut at_high) = (h, at_end);
        for _ in 0..EARLIEST {
            if at_low > 0.0 {
                break;
            }
            low = EARLY * high;
            at_low = self.value_after(run, drive, from, low, event)?;
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
            let value = self.value_after(run, drive, from, length, event)?;
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

    fn value_after(
        &mut self,
        run: &ContactRun,
        drive: &SegmentDrive,
        from: &Place,
        length: f64,
        event: Event,
    ) -> Result<f64, Box<ContactEnd>> {
        let y = self.step_from(drive, from, length)?;
        Ok(self.value(run, drive, (from.tau + length, &y), event))
    }

    fn value(
        &self,
        run: &ContactRun,
        drive: &SegmentDrive,
        (tau, y): (f64, &States<f64>),
        event: Event,
    ) -> f64 {
        let (terms, motion) = self.look(drive, tau, y);
        values(run.modes(), self.half_height, event.finger, &terms, &motion)
            .into_iter()
            .flatten()
            .find(|(cause, _)| *cause == event.cause)
            .map_or(1.0, |(_, value)| value)
    }
}
