//! The paper's finger: a rigid link that turns about its root (7, 8).
//!
//! With n_i = L sin theta_pi + d_f cos theta_pi and t_i = L cos theta_pi - d_f sin theta_pi (from the finger's root to
//! the tip's centre, along and across the normal of the side) the tip's centre is at s_i (n_i - W_f C) along the normal and
//! at t_i + s_i W_f S along the side.

use super::{Arm, Placed};
use crate::model::{Frame, Source};
use crate::number::{Real, signed};

#[derive(Debug, Clone, Copy)]
pub struct OneLink<R> {
    length: R,
    root_offset: R,
    half_thickness: R,
}

impl<R: Real> OneLink<R> {
    #[inline(always)]
    pub(in crate::model::contact) fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            length: source.number(|p| p.fingers[i].length),
            root_offset: source.number(|p| p.fingers[i].root_offset),
            half_thickness: source.number(|p| p.fingers[i].half_thickness),
        }
    }

    /// The position of the tip at the finger's `angle`, with the angle's rate `turn`.
    #[inline(always)]
    pub(in crate::model::contact) fn arm(&self, i: usize, frame: &Frame<R>, angle: R, turn: R) -> Arm<R> {
        let tilt = angle + signed(i, frame.theta);
        let (sin_tilt, cos_tilt) = tilt.sin_cos();
        let normal = self.length.dot2(sin_tilt, self.half_thickness, cos_tilt);
        let across = self.length.dot2(cos_tilt, -self.half_thickness, sin_tilt);
        let sx = signed(i, frame.x) + self.root_offset.mul_add(frame.cos, -normal);
        let g = signed(i, self.root_offset).neg_mul_add(frame.sin, frame.y) - across;
        // theta_i = theta_pi - s_i theta, so its sine and cosine follow from sines and cosines that are already known.
        let sin_finger = sin_tilt.dot2(frame.cos, signed(i, -cos_tilt), frame.sin);
        let cos_finger = cos_tilt.dot2(frame.cos, signed(i, sin_tilt), frame.sin);
        Arm { tilt, sin_tilt, cos_tilt, sin_finger, cos_finger, normal, across, sx, g, turn }
    }

    /// The tip's base at the finger's `angle`.
    #[inline(always)]
    pub(super) fn placed(&self, angle: R) -> Placed<R> {
        let (sin, cos) = angle.sin_cos();
        let inwards = self.length.dot2(sin, self.half_thickness, cos);
        let up = self.length.dot2(cos, -self.half_thickness, sin);
        Placed {
            centre: [inwards - self.root_offset, up],
            way: [up, -inwards],
            bend: [-inwards, -up],
            angle: [angle, sin, cos],
            turn: R::constant(1.0),
            gravity: [sin, cos],
        }
    }
}
