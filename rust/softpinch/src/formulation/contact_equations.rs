//! The equations of unilateral contact as the search for events uses them: for one run.

use crate::formulation::equations::Solved;
use crate::formulation::impact::{Impact, impact};
use crate::formulation::{ContactJump, Csm, Equations, Terms};
use crate::model::{Any, Contacts, Coordinates, Geometry, Input, Motion, Plant, SegmentFrame};
use crate::number::{LaneTask, Real, inlined, task};

/// The equations of one run with unilateral contact, whatever its parts.
#[derive(Debug, Clone, Copy)]
pub struct ContactEquations<'a> {
    csm: &'a Csm<f64>,
    friction: [f64; 2],
    /// The motion of the hand in the segment, if it moves.
    frame: Option<SegmentFrame<f64>>,
}

task! {
    ['a]
    TermsAt<'a>(at: &'a ContactEquations<'a>, input: &'a Input<f64>, contacts: &'a Contacts<f64>,
        motion: &'a Motion<f64>)
    for f64 => Terms<f64> = {
        let (plant, Motion { q, p, .. }) = (at.plant(), motion);
        // A closure would be compiled without the instructions of the lanes.
        let mut moving = None;
        if let Some(frame) = &at.frame {
            moving = Some(plant.loads(&frame.at(input.tau), &input.force, q.object, p.object));
        }
        let (applied, geometry) = ((input, moving.as_ref()), Geometry::of(&plant.sides, q, p));
        let Solved { forces, response, .. } = at.solved(plant.driven, applied, contacts, motion, &geometry);
        let swept = geometry.phi_times(&response.acceleration);
        Terms { geometry, forces, response, swept }
    }
}
task! {
    ['a]
    Collision<'a>(at: &'a ContactEquations<'a>, geometry: &'a Geometry<f64>, p: &'a Coordinates, closed: [bool; 2],
        impulse: [f64; 3])
    for f64 => Impact = impact(geometry, at.plant(), p, (closed, at.friction), impulse)
}
task! {
    ['a]
    Jump<'a>(equations: ContactEquations<'a>, jump: ContactJump, motion: &'a mut Motion<f64>)
    for f64 => () = jump.apply(&equations, motion, &[0.0; 3])
}

impl Equations<f64> for ContactEquations<'_> {
    type Parts = Any;

    inlined! {
        opens(&self) -> bool = true;
        friction(&self) -> Option<[f64; 2]> = Some(self.friction);
        bias(&self, geometry: &Geometry<f64>) -> [f64; 4] = self.csm.gamma(geometry);
        plant(&self) -> &Plant<f64> = &self.csm.plant;
    }
}

impl Terms<f64> {
    /// The acceleration with which the gap of contact i closes, m/s^2.
    pub fn falls(&self, i: usize) -> f64 {
        -(self.swept[i] + self.geometry.bias()[i])
    }
}

impl<'a> ContactEquations<'a> {
    /// The equations of a run, in a segment with this motion of the hand.
    pub(crate) fn new(csm: &'a Csm<f64>, friction: [f64; 2], frame: Option<SegmentFrame<f64>>) -> Self {
        Self { csm, friction, frame }
    }

    pub fn terms(&self, input: &Input<f64>, contacts: &Contacts<f64>, motion: &Motion<f64>) -> Terms<f64> {
        f64::outlined(TermsAt { at: self, input, contacts, motion })
    }

    /// The velocities `p` after an impact of the contacts that are `closed`, with an impulse on the object.
    pub fn impact(
        &self,
        geometry: &Geometry<f64>,
        p: &Coordinates,
        closed: [bool; 2],
        impulse: [f64; 3],
    ) -> Impact {
        f64::outlined(Collision { at: self, geometry, p, closed, impulse })
    }

    /// Lets a part of an event other than an impact happen to a motion.
    pub fn jump(&self, jump: ContactJump, motion: &mut Motion<f64>) {
        f64::outlined(Jump { equations: *self, jump, motion });
    }

    /// theta_p of both tips.
    pub fn tilts(&self, q: &Coordinates) -> [f64; 2] {
        std::array::from_fn(|i| self.plant().sides[i].tilt::<Any>(i, q).0)
    }
}
