//! A jaw: its tip travels along a line and does not turn.

use super::Placed;
use crate::model::source::Source;
use crate::number::real::{Real, signed};

/// The numbers of a jaw.
#[derive(Debug, Clone, Copy)]
pub struct Jaw<R> {
    /// The tip's centre at the coordinate zero: -X_0 inwards and Y_0 upwards.
    start: [R; 2],
    /// gamma, the direction of travel, upwards from the direction to the middle of the hand.
    direction: R,
    /// phi_0.
    angle: R,
}

impl<R: Real> Jaw<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            start: [
                source.number(|p| p.fingers[i].half_thickness - p.fingers[i].root_offset),
                source.number(|p| p.mechanisms[i].height),
            ],
            direction: source.number(|p| p.mechanisms[i].direction),
            angle: source.number(|p| p.mechanisms[i].angle),
        }
    }

    /// The acceleration along its travel of a place of the frame that has the tip's: `acceleration` is that of the frame
    /// along the hand's axes, with gravity, and `turning` has omega and its rate.
    #[inline(always)]
    pub(in crate::model) fn drawn(
        &self,
        i: usize,
        acceleration: [R; 2],
        turning: Option<[R; 2]>,
        travel: R,
    ) -> R {
        let Placed { centre: [inwards, y], way: [along, up], .. } = self.placed(travel);
        let (x, along) = (signed(i, inwards), signed(i, along));
        let mut drawn = acceleration[0].dot2(along, acceleration[1], up);
        if let Some([omega, omega_rate]) = turning {
            drawn = omega_rate.mul_add(x.dot2(up, -y, along), drawn);
            drawn = (omega * omega).neg_mul_add(x.dot2(along, y, up), drawn);
        }
        drawn
    }

    /// The height of the tip's centre, m.
    #[inline(always)]
    pub(in crate::model::contact) fn height(&self, travel: R) -> R {
        travel.mul_add(self.direction.sin_cos().0, self.start[1])
    }

    #[inline(always)]
    pub(super) fn placed(&self, travel: R) -> Placed<R> {
        let (sin, cos) = self.direction.sin_cos();
        let (zero, [x, y]) = (R::zero(), self.start);
        Placed {
            centre: [travel.mul_add(cos, x), travel.mul_add(sin, y)],
            way: [cos, sin],
            bend: [zero; 2],
            angle: self.angle,
            turn: zero,
            lever: -sin,
        }
    }
}
