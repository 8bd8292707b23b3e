//! A jaw: its tip travels along a line and does not turn.

use super::{Placed, turned};
use crate::model::Source;
use crate::number::{Real, signed};

#[derive(Debug, Clone, Copy)]
pub struct Jaw<R> {
    /// The tip's centre at the coordinate zero: -X_0 inwards and Y_0 upwards.
    start: [R; 2],
    /// Sine and cosine of gamma, the direction of travel, upwards from the direction to the middle of the hand.
    direction: [R; 2],
    /// phi_0, its sine and its cosine.
    angle: [R; 3],
}

impl<R: Real> Jaw<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            start: [
                source.number(|p| p.fingers[i].half_thickness - p.fingers[i].root_offset),
                source.number(|p| p.mechanisms[i].height),
            ],
            direction: source.number(|p| p.mechanisms[i].direction).sin_cos().into(),
            angle: turned(source.number(|p| p.mechanisms[i].angle)),
        }
    }

    /// The force along the travel of a jaw of this mass in a frame with `acceleration` along the hand's axes, gravity
    /// included, and with omega and its rate: the factor of the travel, and a constant.
    #[inline(always)]
    pub(in crate::model) fn drawn(
        &self,
        i: usize,
        mass: R,
        acceleration: [R; 2],
        turning: Option<[R; 2]>,
    ) -> (R, R) {
        let [up, inwards] = self.direction;
        let (along, [x, y]) = (signed(i, inwards), self.start);
        let (mut factor, mut drawn) = (R::zero(), acceleration[0].dot2(along, acceleration[1], up));
        if let Some([omega, omega_rate]) = turning {
            drawn = signed(i, omega_rate).mul_add(x.dot2(up, -y, inwards), drawn);
            drawn = (omega * omega).neg_mul_add(x.dot2(inwards, y, up), drawn);
            factor = mass * omega * omega;
        }
        (factor, -(mass * drawn))
    }

    #[inline(always)]
    pub(super) fn placed(&self, travel: R) -> Placed<R> {
        let [sin, cos] = self.direction;
        let (zero, [x, y]) = (R::zero(), self.start);
        Placed {
            centre: [travel.mul_add(cos, x), travel.mul_add(sin, y)],
            way: [cos, sin],
            bend: [zero; 2],
            angle: self.angle,
            turn: zero,
            gravity: [travel, zero],
        }
    }
}
