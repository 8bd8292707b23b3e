//! The steps of a run with unilateral contact between its events. An event is located on the method's own
//! step, which is repeated with a shorter length, so that the method keeps its order across events.

use crate::formulation::contact_equations::ContactEquations;
use crate::formulation::equations::{States, Terms};
use crate::formulation::scene_equations::{InputAt, SceneEquations};
use crate::formulation::system::System;
use crate::model::contact::Side;
use crate::model::drive::{Input, SegmentDrive};
use crate::model::geometry::Geometry;
use crate::model::motion::Motion;
use crate::number::lanes::{LaneTask, Lanes};
use crate::number::simd::level::Instructions;
use crate::stepping::contact_events::{ContactEnd, ContactRun, EventResult, Reason};
use crate::stepping::lone_steps::LoneMethod;
use crate::stepping::monitor::Limits;

/// A state within a segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct SegmentState {
    /// Time since the start of the segment, s.
    pub(super) tau: f64,
    /// The state.
    pub(super) y: States<f64>,
}

impl SegmentState {
    pub(super) fn end(&self, reason: Reason) -> Box<ContactEnd> {
        Box::new(ContactEnd { reason, tau: self.tau, y: self.y })
    }
}

/// One run within a step.
pub(super) struct EventStepper<'a> {
    /// The instructions of the code that computes, which is called. The search itself only compares numbers.
    pub(super) instructions: Instructions,
    /// The equations.
    pub(super) system: &'a SceneEquations<f64>,
    pub(super) equations: ContactEquations<'a>,
    /// Takes the steps.
    pub(super) method: &'a mut LoneMethod,
    /// The limits of the scene.
    pub(super) limits: &'a Limits<f64>,
    /// The contacts.
    pub(super) run: &'a mut ContactRun,
    /// The inputs of the segment, with the modes of the contacts.
    pub(super) drive: &'a mut SegmentDrive,
    /// The length of the run's own step.
    pub(super) h: f64,
}

/// Computes the geometry of a motion.
struct GeometryOf<'a>(&'a [Side<f64>; 2], &'a Motion<f64>);

impl LaneTask<f64> for GeometryOf<'_> {
    type Output = Geometry<f64>;

    #[inline(always)]
    fn run(self) -> Geometry<f64> {
        Geometry::new(self.0, &self.1.q, &self.1.p)
    }
}

impl EventStepper<'_> {
    pub(super) fn step_from(&mut self, from: &SegmentState, h: f64) -> EventResult<States<f64>> {
        let step = self.method.step(self.system, self.drive, (from.tau, &from.y), h);
        step.map_err(|unsolved| from.end(Reason::Unsolved(unsolved)))
    }

    /// The inputs of an instant.
    pub(super) fn input(&self, tau: f64) -> Input<f64> {
        f64::call(self.instructions, InputAt(self.drive, tau))
    }

    /// The geometry of a motion.
    pub(super) fn geometry(&self, motion: &Motion<f64>) -> Geometry<f64> {
        f64::call(self.instructions, GeometryOf(self.equations.sides(), motion))
    }

    /// The terms and the motion of a state.
    pub(super) fn terms_at(&self, tau: f64, y: &States<f64>) -> (Terms<f64>, Motion<f64>) {
        let input = self.input(tau);
        let motion = self.equations.motion(&input, y);
        (self.equations.terms(&input, &self.drive.contacts, &motion), motion)
    }

    /// The motion of a state.
    pub(super) fn motion(&self, place: &SegmentState) -> Motion<f64> {
        self.equations.motion(&self.input(place.tau), &place.y)
    }

    /// Writes a motion into a state, whose works stay.
    pub(super) fn store(&self, place: &mut SegmentState, motion: &Motion<f64>) {
        let states = self.system.size().states;
        place.y[..states].copy_from_slice(&self.equations.begin(motion)[..states]);
    }

    /// Adds to a work of the ledger, if it is carried.
    pub(super) fn book(&self, place: &mut SegmentState, which: usize, amount: f64) {
        if self.system.size().works > 0 {
            place.y[self.system.size().states + which] += amount;
        }
    }

    /// The energy of a motion, if the ledger is carried.
    pub(super) fn energy(&self, motion: &Motion<f64>) -> f64 {
        if self.system.size().works == 0 {
            return 0.0;
        }
        self.system.energies(&self.run.held(self.equations.tilts(&motion.q)), motion).total()
    }
}
