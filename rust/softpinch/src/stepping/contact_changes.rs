//! The changes of the contacts' modes: what happens at an event, and the choice of the next modes.

use crate::formulation::{Chosen, ContactJump, Equations, choose, contacts_in};
use crate::model::{Coordinates, Mode, Motion, Slip, work};
use crate::stepping::{Cause, Change, Event, EventResult, EventStepper, Loss, Passage, Reason, SegmentState};

/// The share of a step after which the choice of modes is checked on a border.
const MOMENT: f64 = 1.0 / 8192.0;
/// A state is on its constraints up to this share of its largest numbers.
const ON_CONSTRAINTS: f64 = 1e-12;
/// A contact that an impact opens for less than this share of a step stays closed.
const SETTLED: f64 = 1.0 / (1u64 << 20) as f64;
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
        for i in 0..2 {
            let geometry = self.geometry(&motion);
            let (gap, beside) =
                (geometry.residuals()[i], geometry.places()[i].abs() <= self.limits.half_height[i]);
            let radius = self.equations.plant().sides[i].radius;
            if self.run.contacts[i].closed || (beside && gap < -OVERLAP * radius) {
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
            Cause::Impact => {
                let mut touching = self.run.contacts.map(|contact| contact.closed);
                touching[i] = true;
                self.meet(place, &mut motion, i)?;
                self.settle(place, touching, &mut motion);
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
        if geometry.places()[i].abs() - self.limits.half_height[i] > gap {
            // The tip is already behind the face and now comes beside it: it meets the face's end.
            return Err(place.end(Reason::Lost(Loss::MetEnd(i))));
        }
        let frozen = self.energy(motion);
        self.jump(motion, ContactJump::Meet(i));
        let moved = self.energy(motion);
        self.run.contacts[i].closed = true;
        let live = self.energy(motion);
        self.book(place, work::CONSTRAINT, moved - frozen);
        self.book(place, work::RELAXATION, live - moved);
        let approach = self.geometry(motion).constraint_velocity()[i];
        if approach < 0.0 {
            self.collide(place, motion, &[0.0; 3]);
        } else {
            // By round-off the tip meets the face that it is leaving. It has not left then.
            self.run.log.push(Passage::Undefined("a tip just touches its face"));
            self.run.contacts[i].slip = Slip::of(geometry.residuals()[2 + i], 0.0);
        }
        Ok(())
    }

    /// Closes those of the contacts that were `touching` before an impact which it has opened for less than a
    /// moment: contacts that open each other in turn, ever more briefly, come to rest so.
    fn settle(&mut self, place: &mut SegmentState, touching: [bool; 2], motion: &mut Motion<f64>) {
        if self.run.contacts.iter().zip(touching).all(|(contact, touching)| contact.closed || !touching) {
            return;
        }
        let before = self.energy(motion);
        let contacts = self.run.held(self.equations.tilts(&motion.q));
        let terms = self.equations.terms(&self.input(place.tau), &contacts, motion);
        let rates = terms.geometry.constraint_velocity();
        let (swept, bias) = (self.equations.swept(&terms), terms.geometry.bias());
        for i in 0..2 {
            // The time aloft is 2 g-dot / |g-dot-dot|.
            let aloft = 2.0 * rates[i] < SETTLED * self.h * -(swept[i] + bias[i]);
            if touching[i] && !self.run.contacts[i].closed && aloft {
                motion.p.compression[i] -= rates[i];
                self.run.log.push(Passage::Undefined("the contacts open each other in turn"));
                self.run.contacts[i].closed = true;
                self.run.contacts[i].slip = Slip::of(rates[2 + i], 0.0);
            }
        }
        self.book(place, work::CONSTRAINT, self.energy(motion) - before);
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
