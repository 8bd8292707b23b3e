//! The steps of a run with unilateral contact between its events. An event is located on the method's own
//! step, which is repeated with a shorter length, so that the method keeps its order across events.

use crate::formulation::equations::States;
use crate::formulation::impact::impact;
use crate::formulation::mode_selection::{choose, contacts_in, tilt};
use crate::formulation::unilateral::{ContactTerms, Unilateral};
use crate::model::contact_modes::Mode;
use crate::model::control::Controller;
use crate::model::drive::{Drive, SegmentDrive};
use crate::model::geometry::Geometry;
use crate::model::geometry::index::{D_N, D_T};
use crate::model::motion::Motion;
use crate::stepping::contact_events::{Cause, Change, ContactEnd, ContactRun, Event, due, values};

/// Largest number of events within one step of the run.
pub const MOST_EVENTS: usize = 64;
/// Largest number of repeated steps that locate one event. Most take about ten.
const MOST_TRIALS: usize = 60;
/// The share of a step at which a condition is looked at that is zero when its mode begins, such as the gap.
const EARLY: f64 = 1.0 / 1024.0;
/// The share of a step after which the choice of modes is checked on a border.
const MOMENT: f64 = 1.0 / 8192.0;
/// An event is located to this share of the step.
const RESOLUTION: f64 = 1.0 / (1u64 << 50) as f64;

/// A state within a segment.
#[derive(Debug, Clone, Copy)]
struct Place {
    tau: f64,
    y: States<f64>,
}

/// Takes the steps of one run between its events.
pub struct EventStepper<'a, K, F> {
    /// The equations.
    pub equations: &'a Unilateral<f64, K>,
    /// Takes a step of the method from time `tau` of the segment over `h`; `None` if it is not solved.
    pub step: F,
}

impl<K: Controller<f64>, F> EventStepper<'_, K, F>
where
    F: FnMut(&SegmentDrive, f64, f64, &States<f64>) -> Option<States<f64>>,
{
    /// Chooses the modes at the start of a run, at a breakpoint, or after an impulse.
    pub fn begin(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        (tau, h): (f64, f64),
        y: &mut States<f64>,
    ) -> Result<(), ContactEnd> {
        let mut place = Place { tau, y: *y };
        self.rechoose(run, drive, &mut place, h, [Cause::Input; 2])?;
        *y = place.y;
        Ok(())
    }

    /// The state at the end of a step, after all events in it. The modes of the drive are those at the end.
    pub fn advance(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        (tau, h): (f64, f64),
        y: &States<f64>,
    ) -> Result<States<f64>, ContactEnd> {
        let mut place = Place { tau, y: *y };
        let end = tau + h;
        for _ in 0..=MOST_EVENTS {
            let rest = end - place.tau;
            if rest <= 0.0 {
                return Ok(place.y);
            }
            let arrived = (self.step)(drive, place.tau, rest, &place.y).ok_or(ContactEnd::NotSolved)?;
            let (terms, motion) = self.look(drive, end, &arrived);
            if terms.response.acceleration.iter().any(|a| !a.is_finite()) {
                return Err(ContactEnd::NotSolved);
            }
            let due = due(run, &terms, &motion);
            let Some((length, event)) = self.earliest(run, drive, &place, rest, &due)? else {
                return Ok(arrived);
            };
            let y = (self.step)(drive, place.tau, length, &place.y).ok_or(ContactEnd::NotSolved)?;
            place = Place { tau: if length < rest { place.tau + length } else { end }, y };
            self.happen(run, drive, &mut place, h, event)?;
        }
        Err(ContactEnd::Chattering)
    }

    /// The terms and the motion of a state.
    fn look(&self, drive: &SegmentDrive, tau: f64, y: &States<f64>) -> (ContactTerms<f64>, Motion<f64>) {
        let input = drive.at(tau);
        let motion = self.equations.motion(&input, y);
        (self.equations.terms(&input, &drive.contacts, &motion), motion)
    }

    /// The earliest of the events that are due at the end of a step of length `h`, and the length of the step
    /// that leads to it.
    fn earliest(
        &mut self,
        run: &ContactRun,
        drive: &SegmentDrive,
        from: &Place,
        h: f64,
        due: &[(Event, f64)],
    ) -> Result<Option<(f64, Event)>, ContactEnd> {
        let mut earliest: Option<(f64, Event)> = None;
        for &(event, at_end) in due {
            let length = self.locate(run, drive, from, h, (event, at_end))?;
            if earliest.is_none_or(|(least, _)| length < least) {
                earliest = Some((length, event));
            }
        }
        Ok(earliest)
    }

    /// The length of the step at whose end an event is just due, by the Illinois method (a secant that keeps its
    /// bracket).
    fn locate(
        &mut self,
        run: &ContactRun,
        drive: &SegmentDrive,
        from: &Place,
        h: f64,
        (event, at_end): (Event, f64),
    ) -> Result<f64, ContactEnd> {
        let (mut low, mut at_low) = (0.0, self.value(run, drive, from.tau, &from.y, event));
        let (mut high, mut at_high) = (h, at_end);
        if at_low <= 0.0 {
            low = EARLY * h;
            at_low = self.value_after(run, drive, from, low, event)?;
            if at_low <= 0.0 {
                return Ok(low);
            }
        }
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
            if value > 0.0 {
                (low, at_low, at_high) = (length, value, 0.5 * at_high);
            } else {
                (high, at_high, at_low) = (length, value, 0.5 * at_low);
                if value == 0.0 {
                    break;
                }
            }
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
    ) -> Result<f64, ContactEnd> {
        let y = (self.step)(drive, from.tau, length, &from.y).ok_or(ContactEnd::NotSolved)?;
        Ok(self.value(run, drive, from.tau + length, &y, event))
    }

    fn value(&self, run: &ContactRun, drive: &SegmentDrive, tau: f64, y: &States<f64>, event: Event) -> f64 {
        let (terms, motion) = self.look(drive, tau, y);
        values(run.contacts[event.finger].mode, event.finger, &terms, &motion)
            .into_iter()
            .flatten()
            .find(|(cause, _)| *cause == event.cause)
            .map_or(1.0, |(_, value)| value)
    }

    /// Lets an event happen: velocities jump where it is an impact, and the modes are chosen anew.
    fn happen(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        place: &mut Place,
        h: f64,
        Event { finger: i, cause }: Event,
    ) -> Result<(), ContactEnd> {
        let input = drive.at(place.tau);
        let mut motion = self.equations.motion(&input, &place.y);
        let left = run.contacts[i].mode;
        let mut causes = [Cause::Other; 2];
        causes[i] = cause;
        match cause {
            Cause::Impact => {
                // The gap is zero up to the location of the event; the surface takes the rest.
                let sides = &self.equations.plant().sides;
                motion.q[D_N + i] -= Geometry::new(sides, &motion.q, &motion.p).residuals()[i];
                run.contacts[i].closed = true;
                self.collide(run, &mut motion);
            }
            Cause::Relaxed => {
                let masses = self.equations.plant().masses;
                for k in [D_N + i, D_T + i] {
                    run.stop_loss += 0.5 * masses[k] * motion.p[k] * motion.p[k];
                    (motion.q[k], motion.p[k]) = (0.0, 0.0);
                }
                self.open(run, &mut motion, i, cause, place.tau);
            }
            Cause::Stop => {
                run.contacts[i].slip = None;
                run.contacts[i].left = Some(left);
            }
            _ => run.contacts[i].left = Some(left),
        }
        place.y = self.equations.begin(&motion);
        self.rechoose(run, drive, place, h, causes)?;
        for contact in &mut run.contacts {
            contact.left = None;
        }
        Ok(())
    }

    /// The impact law for all closed contacts.
    fn collide(&self, run: &mut ContactRun, motion: &mut Motion<f64>) {
        let plant = self.equations.plant();
        let geometry = Geometry::new(&plant.sides, &motion.q, &motion.p);
        let closed = run.contacts.map(|contact| contact.closed);
        let found = impact(&geometry, plant, &motion.p, (closed, self.equations.friction()), [0.0; 3]);
        motion.p = found.p;
        run.impact_loss += found.loss;
        // A contact that is not closed is free in the impact, too.
        for (contact, mode) in run.contacts.iter_mut().zip(found.modes) {
            (contact.closed, contact.slip) = (mode.is_closed(), mode.slip());
        }
    }

    /// Makes a contact free at its present tilt.
    fn open(&self, run: &mut ContactRun, motion: &mut Motion<f64>, i: usize, cause: Cause, tau: f64) {
        let contact = &mut run.contacts[i];
        if contact.mode == Mode::Free {
            return;
        }
        run.changes.push(Change { tau, finger: i, before: contact.mode, after: Mode::Free, cause });
        contact.frozen_tilt = tilt(&motion.q, i);
        (contact.mode, contact.closed, contact.slip) = (Mode::Free, false, None);
    }

    /// Puts the residuals of closed contacts into the tips' surfaces, so that gaps and slips start at zero.
    fn absorb(&self, run: &ContactRun, motion: &mut Motion<f64>) {
        let sides = &self.equations.plant().sides;
        for i in 0..2 {
            if !run.contacts[i].closed {
                continue;
            }
            motion.q[D_N + i] -= Geometry::new(sides, &motion.q, &motion.p).residuals()[i];
            let velocity = Geometry::new(sides, &motion.q, &motion.p).constraint_velocity();
            motion.p[D_N + i] -= velocity[i];
            if run.contacts[i].slip.is_none() {
                motion.p[D_T + i] -= velocity[2 + i];
            }
        }
    }

    /// Chooses the modes.
    fn rechoose(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        place: &mut Place,
        h: f64,
        causes: [Cause; 2],
    ) -> Result<(), ContactEnd> {
        let input = drive.at(place.tau);
        let mut motion = self.equations.motion(&input, &place.y);
        let before = *place;
        self.absorb(run, &mut motion);
        place.y = self.equations.begin(&motion);
        let mut modes = self.choice(run, drive, place, h, &motion);
        let returned = run.contacts.iter().any(|contact| contact.left.is_some()) && modes.is_none();
        if returned {
            // Without the residuals the event was not due yet. The mode goes on, and finds it again.
            for contact in &mut run.contacts {
                contact.left = None;
            }
            modes = self.choice(run, drive, place, h, &motion);
        }
        if modes.is_none() && run.contacts.iter().any(|contact| contact.slip.is_some()) {
            // Beyond the critical friction: an impact without collision stops the slip.
            self.collide(run, &mut motion);
            place.y = self.equations.begin(&motion);
            modes = self.choice(run, drive, place, h, &motion);
        }
        let modes = modes.ok_or(ContactEnd::NoMode)?;
        let changes = modes != run.contacts.map(|contact| contact.mode) || returned;
        for i in 0..2 {
            let (before, after) = (run.contacts[i].mode, modes[i]);
            if before == after {
                continue;
            }
            if after == Mode::Free {
                self.open(run, &mut motion, i, causes[i], place.tau);
                continue;
            }
            run.changes.push(Change { tau: place.tau, finger: i, before, after, cause: causes[i] });
            let contact = &mut run.contacts[i];
            (contact.mode, contact.closed) = (after, true);
            if after != Mode::Graze {
                contact.slip = after.slip();
            }
        }
        if changes {
            place.y = self.equations.begin(&motion);
        } else {
            // Nothing begins or ends, so the residuals stay where they are.
            *place = before;
        }
        drive.contacts = contacts_in(modes, &run.contacts, &motion.q);
        Ok(())
    }

    fn choice(
        &mut self,
        run: &ContactRun,
        drive: &SegmentDrive,
        place: &Place,
        h: f64,
        motion: &Motion<f64>,
    ) -> Option<[Mode; 2]> {
        let equations = self.equations;
        let input = drive.at(place.tau);
        let moment = MOMENT * h;
        choose(equations, &input, motion, &run.contacts, |contacts| {
            let trial = drive.with_contacts(*contacts);
            let y = (self.step)(&trial, place.tau, moment, &place.y)?;
            let input = trial.at(place.tau + moment);
            Some(equations.terms(&input, contacts, &equations.motion(&input, &y)))
        })
    }
}
