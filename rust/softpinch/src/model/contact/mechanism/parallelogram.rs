//! A parallelogram: two equal links keep the tip's base at one angle, so that its centre moves on a circle.

use super::{Placed, turned};
use crate::model::Source;
use crate::number::Real;

#[derive(Debug, Clone, Copy)]
pub struct Parallelogram<R> {
    length: R,
    /// -W_f + d_f, the place inwards about which the tip's centre turns.
    middle: R,
    /// phi_0, its sine and its cosine.
    angle: [R; 3],
}

impl<R: Real> Parallelogram<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            length: source.number(|p| p.fingers[i].length),
            middle: source.number(|p| p.fingers[i].half_thickness - p.fingers[i].root_offset),
            angle: turned(source.number(|p| p.mechanisms[i].angle)),
        }
    }

    #[inline(always)]
    pub(super) fn placed(&self, swing: R) -> Placed<R> {
        let (sin, cos) = swing.sin_cos();
        let (along, up) = (self.length * sin, self.length * cos);
        Placed {
            centre: [self.middle + along, up],
            way: [up, -along],
            bend: [-along, -up],
            angle: self.angle,
            turn: R::zero(),
            gravity: [sin, cos],
        }
    }
}
