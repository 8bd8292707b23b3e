//! The changes of the contacts' modes: what happens at an event, and the choice of the next modes.

use crate::formulation::mode_selection::{Chosen, choose, contacts_in, tilt};
use crate::model::contact_modes::{Mode, Slip};
use crate::model::drive::{Drive, SegmentDrive};
use crate::model::energy::work;
use crate::model::geometry::Geometry;
use crate::model::geometry::index::{D_N, D_T};
use crate::model::motion::Motion;
use crate::stepping::contact_events::{Cause, Change, ContactEnd, ContactRun, Event, Reason};
use crate::stepping::event_stepper::{EventStepper, Place};

/// The share of a step after which the choice of modes is checked on a border.
const MOMENT: f64 = 1.0 / 8192.0;
/// A state is on its constraints up to this share of its largest numbers.
const ON_CONSTRAINTS: f64 = 1e-12;
/// A contact that an impact opens for less than this share of a step stays closed.
const SETTLED: f64 = 1.0 / (1u64 << 20) as f64;

impl EventStepper<'_> {
    /// Chooses the modes at a breakpoint or after an impulse.
    pub(super) fn begin(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        h: f64,
        place: &mut Place,
    ) -> Result<(), Box<ContactEnd>> {
        self.rechoose(run, drive, place, h, [Cause::Input; 2])
    }

    /// Puts the state from which a run starts on the constraints of its closed contacts, with an impact if they
    /// approach each other, and chooses the modes.
    pub(super) fn start(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        h: f64,
        place: &mut Place,
        approaches: bool,
    ) -> Result<(), Box<ContactEnd>> {
        let mut motion = self.motion(drive, place);
        let before = self.energy(run, &motion);
        let sides = self.equations.sides();
        for i in 0..2 {
            if run.contacts[i].closed {
                motion.q[D_N + i] -= Geometry::new(sides, &motion.q, &motion.p).residuals()[i];
            }
        }
        for i in 0..2 {
            // A surface is never stretched.
            if !run.contacts[i].closed && motion.q[D_N + i] < 0.0 {
                for k in [D_N + i, D_T + i] {
                    (motion.q[k], motion.p[k]) = (0.0, 0.0);
                }
            }
        }
        self.book(place, work::CONSTRAINT, self.energy(run, &motion) - before);
        if approaches {
            self.collide(run, place, &mut motion, [0.0; 3]);
        }
        self.store(place, &motion);
        self.begin(run, drive, h, place)
    }

    /// Puts a state that another formulation has left on the constraints of its closed contacts, unless it is there up to
    /// round-off.
    pub(super) fn put_on_constraints(&mut self, run: &ContactRun, drive: &SegmentDrive, place: &mut Place) {
        let mut motion = self.motion(drive, place);
        let (before, from) = (self.energy(run, &motion), motion);
        self.absorb(run, &mut motion);
        let moved = |a: &[f64; 9], b: &[f64; 9]| {
            let size = a.iter().fold(0.0, |size: f64, value| size.max(value.abs()));
            (0..9).any(|k| (a[k] - b[k]).abs() > ON_CONSTRAINTS * size)
        };
        if moved(&from.q, &motion.q) || moved(&from.p, &motion.p) {
            self.book(place, work::CONSTRAINT, self.energy(run, &motion) - before);
            self.store(place, &motion);
        }
    }

    /// Applies an impulse to the object, and chooses the modes.
    pub(super) fn strike(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        h: f64,
        place: &mut Place,
        impulse: [f64; 3],
    ) -> Result<(), Box<ContactEnd>> {
        let mut motion = self.motion(drive, place);
        self.collide(run, place, &mut motion, impulse);
        self.store(place, &motion);
        self.begin(run, drive, h, place)
    }

    /// Lets an event happen: velocities jump where it is an impact, and the modes are chosen anew.
    pub(super) fn happen(
        &mut self,
        run: &mut ContactRun,
        drive: &mut SegmentDrive,
        place: &mut Place,
        h: f64,
        Event { finger: i, cause }: Event,
    ) -> Result<(), Box<ContactEnd>> {
        let mut motion = self.motion(drive, place);
        let left = run.contacts[i].mode;
        let mut causes = [Cause::Other; 2];
        causes[i] = cause;
        match cause {
            Cause::Lost => return Err(place.end(Reason::Lost)),
            Cause::Impact => {
                let mut touching = run.contacts.map(|contact| contact.closed);
                touching[i] = true;
                self.meet(run, place, &mut motion, i)?;
                self.settle(run, drive, place, (h, touching), &mut motion);
            }
            Cause::Relaxed => {
                let masses = self.equations.masses();
                for k in [D_N + i, D_T + i] {
                    self.book(place, work::IMPACT, 0.5 * masses[k] * motion.p[k] * motion.p[k]);
                    (motion.q[k], motion.p[k]) = (0.0, 0.0);
                }
                open(run, &motion, i, cause, run.anchor + place.tau);
            }
            Cause::Stop => {
                run.contacts[i].slip = None;
                run.contacts[i].left = Some(left);
            }
            _ => run.contacts[i].left = Some(left),
        }
        self.store(place, &motion);
        self.rechoose(run, drive, place, h, causes)?;
        for contact in &mut run.contacts {
            contact.left = None;
        }
        Ok(())
    }

    /// A free tip meets the face. At the located event its gap is zero up to round-off; the surface takes the
    /// rest.
    fn meet(
        &self,
        run: &mut ContactRun,
        place: &mut Place,
        motion: &mut Motion<f64>,
        i: usize,
    ) -> Result<(), Box<ContactEnd>> {
        let sides = self.equations.sides();
        let geometry = Geometry::new(sides, &motion.q, &motion.p);
        let gap = geometry.residuals()[i];
        if geometry.places()[i].abs() - self.half_height > gap {
            // The tip is already behind the face and now comes beside it: it meets the face's end.
            return Err(place.end(Reason::Lost));
        }
        let frozen = self.energy(run, motion);
        motion.q[D_N + i] -= gap;
        let moved = self.energy(run, motion);
        run.contacts[i].closed = true;
        let live = self.energy(run, motion);
        self.book(place, work::CONSTRAINT, moved - frozen);
        self.book(place, work::RELAXATION, live - moved);
        let approach = Geometry::new(sides, &motion.q, &motion.p).constraint_velocity()[i];
        if approach < 0.0 {
            self.collide(run, place, motion, [0.0; 3]);
        } else {
            // By round-off the tip meets the face that it is leaving. It has not left then.
            run.contacts[i].slip = slip_of(geometry.residuals()[2 + i]);
        }
        Ok(())
    }

    /// Closes those of the contacts that were `touching` before an impact which it has opened for less than a
    /// moment: contacts that open each other in turn, ever more briefly, come to rest so.
    fn settle(
        &self,
        run: &mut ContactRun,
        drive: &SegmentDrive,
        place: &mut Place,
        (h, touching): (f64, [bool; 2]),
        motion: &mut Motion<f64>,
    ) {
        if run.contacts.iter().zip(touching).all(|(contact, touching)| contact.closed || !touching) {
            return;
        }
        let before = self.energy(run, motion);
        let modes = run.contacts.map(|contact| if contact.closed { Mode::Stick } else { Mode::Free });
        let contacts = contacts_in(modes, &run.contacts, &motion.q);
        let terms = self.equations.terms(&drive.at(place.tau), &contacts, motion);
        let rates = terms.geometry.constraint_velocity();
        let (swept, bias) = (terms.geometry.phi_times(&terms.response.acceleration), terms.geometry.bias());
        for i in 0..2 {
            // The time aloft is 2 g-dot / |g-dot-dot|.
            let aloft = 2.0 * rates[i] < SETTLED * h * -(swept[i] + bias[i]);
            if touching[i] && !run.contacts[i].closed && aloft {
                motion.p[D_N + i] -= rates[i];
                run.contacts[i].closed = true;
                run.contacts[i].slip = slip_of(rates[2 + i]);
            }
        }
        self.book(place, work::CONSTRAINT, self.energy(run, motion) - before);
    }

    /// The impact law for all closed contacts, with an impulse on the object.
    fn collide(&self, run: &mut ContactRun, place: &mut Place, motion: &mut Motion<f64>, impulse: [f64; 3]) {
        let geometry = Geometry::new(self.equations.sides(), &motion.q, &motion.p);
        let closed = run.contacts.map(|contact| contact.closed);
        let found = self.equations.impact(&geometry, &motion.p, closed, impulse);
        motion.p = found.p;
        self.book(place, work::IMPACT, found.loss);
        self.book(place, work::EXTERNAL, found.work);
        self.book(place, work::CONTROL, found.driving);
        // A contact that is not closed is free in the impact, too.
        for (i, mode) in found.modes.into_iter().enumerate() {
            let contact = &mut run.contacts[i];
            if contact.closed && !mode.is_closed() {
                contact.frozen_tilt = tilt(&motion.q, i);
            }
            (contact.closed, contact.slip) = (mode.is_closed(), mode.slip());
        }
    }

    /// Puts the residuals of closed contacts into the tips' surfaces, so that gaps and slips start at zero.
    fn absorb(&self, run: &ContactRun, motion: &mut Motion<f64>) {
        let sides = self.equations.sides();
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
    ) -> Result<(), Box<ContactEnd>> {
        let before = *place;
        let mut motion = self.motion(drive, place);
        let energy = self.energy(run, &motion);
        self.absorb(run, &mut motion);
        self.book(place, work::CONSTRAINT, self.energy(run, &motion) - energy);
        self.store(place, &motion);
        let mut chosen = self.choice(run, drive, place, h, &motion);
        let stops = chosen.is_none() && run.contacts.iter().any(|contact| contact.slip.is_some());
        if stops {
            // Beyond the critical friction: an impact without collision stops the slip.
            self.collide(run, place, &mut motion, [0.0; 3]);
            self.store(place, &motion);
            chosen = self.choice(run, drive, place, h, &motion);
        }
        let Chosen { modes, returned } = chosen.ok_or_else(|| place.end(Reason::NoMode))?;
        if modes == run.modes() && !(returned || stops) {
            // Nothing begins or ends, so the residuals stay where they are.
            *place = before;
        }
        let time = run.anchor + place.tau;
        for i in 0..2 {
            let (before, after) = (run.contacts[i].mode, modes[i]);
            // A tip that meets the face and leaves it at once is free before and after.
            if after == Mode::Free {
                open(run, &motion, i, causes[i], time);
            }
            if after == Mode::Free {
                continue;
            }
            if before != after {
                run.changes.push(Change { time, finger: i, before, after, cause: causes[i] });
            }
            // A slip that an impact has stopped may begin again in the same direction.
            let contact = &mut run.contacts[i];
            (contact.mode, contact.closed) = (after, true);
            if after != Mode::Graze {
                contact.slip = after.slip();
            }
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
    ) -> Option<Chosen> {
        let equations = self.equations;
        let input = drive.at(place.tau);
        let moment = MOMENT * h;
        choose(equations, &input, motion, &run.contacts, |contacts| {
            let trial = drive.with_contacts(*contacts);
            let y = (self.step)(&trial, place.tau, moment, &place.y).ok()?;
            let input = trial.at(place.tau + moment);
            Some(equations.terms(&input, contacts, &equations.motion(&input, &y)))
        })
    }

    fn motion(&self, drive: &SegmentDrive, place: &Place) -> Motion<f64> {
        self.equations.motion(&drive.at(place.tau), &place.y)
    }

    /// Writes a motion into a state, whose works stay.
    fn store(&self, place: &mut Place, motion: &Motion<f64>) {
        let states = self.size.states;
        place.y[..states].copy_from_slice(&self.equations.begin(motion)[..states]);
    }

    /// Adds to a work of the ledger, if it is carried.
    fn book(&self, place: &mut Place, which: usize, amount: f64) {
        if self.size.works > 0 {
            place.y[self.size.states + which] += amount;
        }
    }

    /// The energy of a motion, if the ledger is carried.
    fn energy(&self, run: &ContactRun, motion: &Motion<f64>) -> f64 {
        if self.size.works > 0 { self.equations.energy(&run.held(&motion.q), motion) } else { 0.0 }
    }
}

/// The direction of a slip velocity.
fn slip_of(v: f64) -> Option<Slip> {
    match v {
        v if v > 0.0 => Some(Slip::Up),
        v if v < 0.0 => Some(Slip::Down),
        _ => None,
    }
}

/// Makes a contact free at its present tilt.
fn open(run: &mut ContactRun, motion: &Motion<f64>, i: usize, cause: Cause, time: f64) {
    let contact = &mut run.contacts[i];
    if contact.mode == Mode::Free && !contact.closed {
        return;
    }
    if contact.mode != Mode::Free {
        run.changes.push(Change { time, finger: i, before: contact.mode, after: Mode::Free, cause });
    }
    contact.frozen_tilt = tilt(&motion.q, i);
    (contact.mode, contact.closed, contact.slip) = (Mode::Free, false, None);
}
