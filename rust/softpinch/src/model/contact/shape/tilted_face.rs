//! A face that is tilted about its middle, as a wedge or a taper has.
//!
//! Its normal is turned by s_i beta from the object's first axis. In the frame that is turned by s_i beta too, the
//! contact is that of a parallel face at the distance b cos beta, where b = W/2 + s_i w. The middle of the face is then
//! b sin beta away from the foot of the perpendicular from the centre of gravity.

use super::{Direction, Frame};
use crate::number::real::{Real, signed};

/// A tilted face.
#[derive(Debug, Clone, Copy)]
pub struct TiltedFace<R> {
    /// beta, positive where the object is wider at its upper end.
    pub(super) tilt: R,
    /// Sine and cosine of s_i beta.
    sin: R,
    cos: R,
    /// From the centre of gravity to the face, along its normal.
    pub(super) distance: R,
    /// The middle of the face along the face, times s_i.
    middle: R,
}

impl<R: Real> TiltedFace<R> {
    /// The face of finger `i` with its middle at `half_width` from the centre of gravity.
    #[inline(always)]
    pub(super) fn new(i: usize, half_width: R, tilt: R) -> Self {
        let (sin, cos) = tilt.sin_cos();
        Self {
            tilt,
            sin: signed(i, sin),
            cos,
            distance: half_width * cos,
            middle: signed(i, half_width * sin),
        }
    }

    /// The frame of the face, and the direction of its normal in the object's frame.
    #[inline(always)]
    pub(super) fn frame(&self, i: usize, object: &Frame<R>) -> (Frame<R>, Direction<R>) {
        let direction = Direction::Turned { cos: self.cos, sin: self.sin };
        let [x, y] = direction.into_side([object.x, object.y]);
        let [u, v] = direction.into_side([object.u, object.v]);
        let frame = Frame {
            sin: object.sin.dot2(self.cos, object.cos, self.sin),
            cos: object.cos.dot2(self.cos, -object.sin, self.sin),
            theta: object.theta + signed(i, self.tilt),
            omega: object.omega,
            x,
            y,
            u,
            v,
        };
        (frame, direction)
    }

    /// The place of a contact from the middle of the face, up to its sign.
    #[inline(always)]
    pub(super) fn place(&self, a: R) -> R {
        a + self.middle
    }
}
