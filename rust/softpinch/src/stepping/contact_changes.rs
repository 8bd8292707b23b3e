//! The changes of the contacts' modes: a step with all its events, what happens at an event, and the choice of the next modes.

use crate::formulation::{Chosen, ContactJump, Equations, States, choose, contacts_in};
use crate::model::{Coordinates, Mode, Motion, Slip, each_coordinate, work};
use crate::stepping::event_search::SLIVER;
use crate::stepping::{
    Cause, Change, Event, EventResult, EventStepper, Loss, MOST_EVENTS, Passage, Reason, SegmentState,
    Violation,
};

/// The share of a step after which the choice of modes is checked on a border.
const MOMENT: f64 = 1.0 / 8192.0;
/// A state is on its constraints up to this share of its largest numbers.
const ON_CONSTRAINTS: f64 = 1e-12;
/// Flights of contacts that open each other in turn are summed where they are lower than this share of the gap's terms: some
/// 1e-11 m, a tenth of an atom.
const LOW: f64 = 1e-10;
/// A tip bounces no more where the height of its flight is below this many units of round-off of the gap.
const BOUNCE: f64 = 1024.0 * f64::EPSILON;
/// At the start the surface of a tip takes an overlap with the face beyond this share of the tip's radius, although
/// the contact opens. Less is round-off.
const OVERLAP: f64 = 1e-6;

impl EventStepper<'_> {
    /// Chooses the modes at a breakpoint or after an impulse.
    pub fn begin(&mut self, place: &mut SegmentState) -> EventResult {
        self.rechoose(place, [Cause::Input; 2])
    }

    /// Puts the state from which a run starts on the constraints of its closed contacts, with an impact if they
    /// approach each other, and chooses the modes. Surfaces of contacts that open take an overlap too.
    pub fn start(&mut self, place: &mut SegmentState, approaches: bool) -> EventResult {
        let mut motion = self.motion(place);
        let before = self.energy(&motion);
        let overlap = self.equations.plant().sides.map(|side| OVERLAP * side.radius);
        for i in 0..2 {
            let geometry = self.geometry(&motion);
            let (gap, beside) =
                (geometry.residuals()[i], geometry.contact_heights()[i].abs() <= self.limits.half_height[i]);
            if self.run.contacts[i].closed || (beside && gap < -overlap[i]) {
                self.jump(&mut motion, ContactJump::Meet(i));
            }
        }
        for i in 0..2 {
            // A surface is never stretched.
            if !self.run.contacts[i].closed && motion.q.compression[i] < 0.0 {
                self.jump(&mut motion, ContactJump::Relax(i));
            }
        }
        self.book(place, work::CONSTRAINT, self.energy(&motion) - before);
        if approaches {
            self.collide(place, &mut motion, &[0.0; 3]);
        }
        self.store(place, &motion);
        self.begin(place)
    }

    /// Puts a state of another formulation on the constraints of its closed contacts, unless it is there up to round-off.
    pub fn put_on_constraints(&mut self, place: &mut SegmentState) {
        let mut motion = self.motion(place);
        let (before, from) = (self.energy(&motion), motion);
        self.absorb(&mut motion);
        let moved = |a: &Coordinates, b: &Coordinates| {
            let (a, b) = (a.row(), b.row());
            let size = a.iter().fold(0.0, |size: f64, value| size.max(value.abs()));
            (0..9).any(|k| (a[k] - b[k]).abs() > ON_CONSTRAINTS * size)
        };
        if moved(&from.q, &motion.q) || moved(&from.p, &motion.p) {
            self.book(place, work::CONSTRAINT, self.energy(&motion) - before);
            self.store(place, &motion);
        } else {
            self.run.log.pop();
        }
    }

    /// Applies an impulse to the object, and chooses the modes.
    pub fn strike(&mut self, place: &mut SegmentState, impulse: &[f64; 3]) -> EventResult {
        let mut motion = self.motion(place);
        self.collide(place, &mut motion, impulse);
        self.store(place, &motion);
        self.begin(place)
    }

    /// The state at the end of a step, after all events in it. `arrived` is the state without any. The modes of the
    /// drive are those at the end.
    pub fn advance(&mut self, from: SegmentState, arrived: &States<f64>) -> EventResult<States<f64>> {
        let (mut place, mut rest, mut arrived) = (from, self.h, *arrived);
        let end = place.tau + self.h;
        for _ in 0..=MOST_EVENTS {
            let Some((length, event)) = self.earliest(&place, (rest, &arrived))? else {
                return Ok(arrived);
            };
            let y = self.step_from(&place, length)?;
            place = SegmentState { tau: if length < rest { place.tau + length } else { end }, y };
            self.run.log.push(Passage::Step(length, event));
            self.happen(&mut place, event)?;
            rest = end - place.tau;
            if rest <= 0.0 {
                return Ok(place.y);
            }
            arrived = self.step_from(&place, rest)?;
            if rest <= SLIVER * self.h {
                return Ok(arrived);
            }
        }
        Err(place.end(Reason::Chattering))
    }

    /// Lets an event happen: velocities jump where it is an impact, and the modes are chosen anew.
    pub fn happen(&mut self, place: &mut SegmentState, Event { finger: i, cause }: Event) -> EventResult {
        let mut motion = self.motion(place);
        let left = self.run.contacts[i].mode;
        let mut causes = [Cause::Other; 2];
        causes[i] = cause;
        match cause {
            Cause::Lost => {
                let loss = if left == Mode::Free { Loss::Apart } else { Loss::OffFace(i) };
                return Err(place.end(Reason::Lost(loss)));
            }
            Cause::Crushed => return Err(place.end(Reason::Broken(Violation::Crushed))),
            Cause::Folded => return Err(place.end(Reason::Broken(Violation::Folded))),
            Cause::Impact => {
                let approach = -self.geometry(&motion).constraint_velocity()[i];
                let touched = self.run.contacts[1 - i].closed;
                self.meet(place, &mut motion, i)?;
                let [own, other] = [i, 1 - i].map(|k| self.run.contacts[k].closed);
                if own && touched && !other {
                    self.settle(place, (i, approach), &mut motion);
                }
            }
            Cause::Relaxed => {
                let (masses, p) = (&self.equations.plant().masses, &motion.p);
                for (mass, rate) in [(masses.compression[i], p.compression[i]), (masses.shear[i], p.shear[i])]
                {
                    self.book(place, work::IMPACT, 0.5 * mass * rate * rate);
                }
                self.jump(&mut motion, ContactJump::Relax(i));
                self.open(place.tau, &motion, i, cause);
            }
            Cause::Stop => {
                self.run.contacts[i].slip = None;
                self.run.contacts[i].left = Some(left);
            }
            _ => self.run.contacts[i].left = Some(left),
        }
        self.store(place, &motion);
        self.rechoose(place, causes)?;
        for contact in &mut self.run.contacts {
            contact.left = None;
        }
        Ok(())
    }

    /// A free tip meets the face. At the located event its gap is zero up to round-off; the surface takes the rest.
    fn meet(&mut self, place: &mut SegmentState, motion: &mut Motion<f64>, i: usize) -> EventResult {
        let geometry = self.geometry(motion);
        let gap = geometry.residuals()[i];
        if geometry.contact_heights()[i].abs() - self.limits.half_height[i] > gap {
            // The tip is already behind the face and now comes beside it: it meets the face's end.
            return Err(place.end(Reason::Lost(Loss::MetEnd(i))));
        }
        let (frozen, low) = (self.energy(motion), self.is_low(place, motion, i));
        self.jump(motion, ContactJump::Meet(i));
        let moved = self.energy(motion);
        self.run.contacts[i].closed = true;
        let live = self.energy(motion);
        self.book(place, work::CONSTRAINT, moved - frozen);
        self.book(place, work::RELAXATION, live - moved);
        if !low {
            self.collide(place, motion, &[0.0; 3]);
            return Ok(());
        }
        self.run.log.push(Passage::Undefined("a tip just touches its face"));
        self.run.contacts[i].slip = Slip::of(geometry.residuals()[2 + i], 0.0);
        let held = self.run.contacts.map(|contact| match contact.slip {
            _ if !contact.closed => Mode::Free,
            slip => slip.map_or(Mode::Stick, Mode::Slip),
        });
        self.jump(motion, ContactJump::Impact(held));
        self.book(place, work::IMPACT, live - self.energy(motion));
        Ok(())
    }

    /// Whether a free tip meets the face with less than the speed of a fall from a height near round-off. A tip that another
    /// contact throws off again and again, ever lower, comes to rest so: the impulses, of any sign, are those of the flights
    /// and impacts that would follow. By round-off a tip may also meet the face that it is leaving; it has not left then.
    fn is_low(&self, place: &SegmentState, motion: &Motion<f64>, i: usize) -> bool {
        let terms = self.equations.terms(&self.input(place.tau), &self.drive.contacts, motion);
        let speed = terms.geometry.constraint_velocity()[i];
        speed >= 0.0 || speed * speed <= 2.0 * terms.falls(i) * self.scale(motion, i) * BOUNCE
    }

    /// The size of the numbers of which the gap of contact i is the difference, m.
    fn scale(&self, motion: &Motion<f64>, i: usize) -> f64 {
        let [x, y, _] = motion.q.object;
        x.abs() + y.abs() + motion.q.compression[i].abs()
    }

    /// The impact of contact i, which met its face with the speed `approach`, has opened the other contact j, which touched
    /// its face. If j in turn opens i as it falls back, the flights become shorter by the same factor each time, infinitely
    /// many in a finite time, after which both are closed. Once they are low, the rest of them is summed here: while contact
    /// k flies, the acceleration is that of k free, and the impulses, of any sign, end the velocities of both gaps.
    fn settle(&mut self, place: &mut SegmentState, (i, approach): (usize, f64), motion: &mut Motion<f64>) {
        let (j, now, tilts) = (1 - i, self.run.contacts, self.equations.tilts(&motion.q));
        let (before, input) = (self.energy(motion), self.input(place.tau));
        let velocity = |motion: &Motion<f64>| self.geometry(motion).constraint_velocity();
        let rates = velocity(motion);
        let sticks = [0, 1].map(|k| if k == j { now[j].mode == Mode::Stick } else { now[i].slip.is_none() });
        let slips = [0, 1].map(|k| if sticks[k] { None } else { Slip::of(rates[2 + k], 0.0) });
        let held = slips.map(|slip| slip.map_or(Mode::Stick, Mode::Slip));
        let only = |free: Option<usize>| [0, 1].map(|k| if free == Some(k) { Mode::Free } else { held[k] });
        let flight =
            |free: Option<usize>| self.equations.terms(&input, &contacts_in(only(free), &now, tilts), motion);
        let (in_j, scale) = (flight(Some(j)), self.scale(motion, j));
        let (speed, falls_j) = (rates[j], in_j.falls(j));
        // Most flights are higher, or do not fall back.
        if speed * speed >= 2.0 * falls_j * LOW * scale {
            return;
        }
        let (in_i, in_none, mut settled) = (flight(Some(i)), flight(None), *motion);
        let falls_i = in_i.falls(i);
        self.equations.jump(ContactJump::Impact(only(Some(i))), &mut settled);
        // The speed with which contact i opens when j has met its face.
        let back = -velocity(&settled)[i];
        let rest = 1.0 - back / approach;
        // The sum has the order of the flights only if both slip, and none opens by itself in the flight of the other one.
        let presses = in_i.response.multipliers[j] > 0.0 && in_j.response.multipliers[i] > 0.0;
        let exact = !(sticks[i] || sticks[j]) && presses;
        let falls_back = [back, rest, falls_i, falls_j].iter().all(|&number| number > 0.0);
        if !(falls_back && (exact || speed * speed < 2.0 * falls_j * BOUNCE * scale)) {
            return;
        }
        let [t_i, t_j] = [back / falls_i, speed / falls_j].map(|time| 2.0 * time / rest);
        let p = motion.p;
        let [of_i, of_j, both] = [in_i, in_j, in_none].map(|terms| terms.response.acceleration);
        settled.p = each_coordinate!([p, of_i, of_j, both] => p + t_i * (of_i - both) + t_j * (of_j - both));
        self.equations.jump(ContactJump::Impact(held), &mut settled);
        let after = velocity(&settled);
        if (0..2).all(|k| sticks[k] || Slip::of(after[2 + k], 0.0) == slips[k]) {
            *motion = settled;
            self.run.log.push(Passage::Undefined("the contacts open each other in turn"));
            (self.run.contacts[j].closed, self.run.contacts[j].slip) = (true, slips[j]);
            self.book(place, work::IMPACT, before - self.energy(motion));
        }
    }

    /// The impact law for all closed contacts, with an impulse on the object.
    fn collide(&mut self, place: &mut SegmentState, motion: &mut Motion<f64>, impulse: &[f64; 3]) {
        let geometry = self.geometry(motion);
        let closed = self.run.contacts.map(|contact| contact.closed);
        let tilts = self.equations.tilts(&motion.q);
        let found = self.equations.impact(&geometry, &motion.p, closed, *impulse);
        motion.p = found.p;
        self.run.log.push(Passage::Jump(ContactJump::Impact(found.modes)));
        self.book(place, work::IMPACT, found.loss);
        self.book(place, work::EXTERNAL, found.work);
        self.book(place, work::CONTROL, found.driving);
        // A contact that is not closed is free in the impact, too.
        for (i, mode) in found.modes.into_iter().enumerate() {
            let contact = &mut self.run.contacts[i];
            if contact.closed && !mode.is_closed() {
                contact.frozen_tilt = tilts[i];
            }
            (contact.closed, contact.slip) = (mode.is_closed(), mode.slip());
        }
    }

    /// Puts the residuals of closed contacts into the tips' surfaces, so that gaps and slips start at zero.
    fn absorb(&mut self, motion: &mut Motion<f64>) {
        let contacts = self.run.contacts.map(|contact| (contact.closed, contact.slip.is_some()));
        self.jump(motion, ContactJump::Absorb(contacts));
    }

    fn rechoose(&mut self, place: &mut SegmentState, causes: [Cause; 2]) -> EventResult {
        let before = *place;
        let mut motion = self.motion(place);
        let energy = self.energy(&motion);
        // Nothing holds the surface of a tip that grazes along the face: one that stuck before may slip by now.
        let rates = self.geometry(&motion).constraint_velocity();
        for (i, contact) in self.run.contacts.iter_mut().enumerate() {
            if contact.mode == Mode::Graze && contact.slip.is_none() {
                contact.slip = Slip::of(rates[2 + i], 0.0);
            }
        }
        self.absorb(&mut motion);
        self.book(place, work::CONSTRAINT, self.energy(&motion) - energy);
        self.store(place, &motion);
        let mut chosen = self.choice(place, &motion);
        let stops = chosen.is_none() && self.run.contacts.iter().any(|contact| contact.slip.is_some());
        if stops {
            // Beyond the critical friction: an impact without collision stops the slip.
            self.collide(place, &mut motion, &[0.0; 3]);
            self.store(place, &motion);
            chosen = self.choice(place, &motion);
        }
        let Some(Chosen { modes, returned }) = chosen else {
            let (terms, _) = self.terms_at(place.tau, &place.y);
            let finite = terms.response.acceleration.row().iter().all(|a| a.is_finite());
            return Err(place.end(if finite { Reason::NoMode } else { Reason::NotFinite }));
        };
        if modes == self.run.modes() && !(returned || stops) {
            // Nothing begins or ends, so the residuals stay where they are.
            *place = before;
            self.run.log.pop();
        }
        let time = self.run.anchor + place.tau;
        for i in 0..2 {
            let (before, after) = (self.run.contacts[i].mode, modes[i]);
            // A tip that meets the face and leaves it at once is free before and after.
            if after == Mode::Free {
                self.open(place.tau, &motion, i, causes[i]);
                continue;
            }
            if before != after {
                self.run.changes.push(Change { time, finger: i, before, after, cause: causes[i] });
            }
            // A slip that an impact has stopped may begin again in the same direction.
            let contact = &mut self.run.contacts[i];
            (contact.mode, contact.closed) = (after, true);
            if after != Mode::Graze {
                contact.slip = after.slip();
            }
        }
        self.drive.contacts = contacts_in(modes, &self.run.contacts, self.equations.tilts(&motion.q));
        self.run.log.push(Passage::Modes(self.run.contacts, self.run.changes.len()));
        Ok(())
    }

    /// Lets a jump happen to a motion, and notes it for its derivatives.
    fn jump(&mut self, motion: &mut Motion<f64>, jump: ContactJump) {
        self.run.log.push(Passage::Jump(jump));
        self.equations.jump(jump, motion);
    }

    fn choice(&mut self, place: &SegmentState, motion: &Motion<f64>) -> Option<Chosen> {
        let moment = MOMENT * self.h;
        let (equations, input, now) = (self.equations, self.input(place.tau), self.run.contacts);
        choose(equations, &input, motion, &now, |contacts| {
            let before = std::mem::replace(&mut self.drive.contacts, *contacts);
            let step = self.step_from(place, moment);
            let terms = step.ok().map(|y| self.terms_at(place.tau + moment, &y).0);
            self.drive.contacts = before;
            terms
        })
    }

    fn open(&mut self, tau: f64, motion: &Motion<f64>, i: usize, cause: Cause) {
        let (time, tilts) = (self.run.anchor + tau, self.equations.tilts(&motion.q));
        let contact = &mut self.run.contacts[i];
        let before = std::mem::replace(&mut contact.mode, Mode::Free);
        if before != Mode::Free {
            self.run.changes.push(Change { time, finger: i, before, after: Mode::Free, cause });
        } else if !contact.closed {
            return;
        }
        contact.frozen_tilt = tilts[i];
        (contact.closed, contact.slip) = (false, None);
    }
}
