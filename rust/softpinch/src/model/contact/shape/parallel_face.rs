//! The paper's side: a face that is parallel to the object's other one (9). Its frame is the object's own.

use crate::model::Source;
use crate::number::{Real, signed};

/// A face whose normal is the object's first axis.
#[derive(Debug, Clone, Copy)]
pub struct ParallelFace<R> {
    /// W/2 + s_i w, from the centre of gravity to the face.
    pub(in crate::model::contact) distance: R,
}

impl<R: Real> ParallelFace<R> {
    #[inline(always)]
    pub(in crate::model::contact) fn new(source: &impl Source<R>, i: usize) -> Self {
        Self { distance: source.number(|p| 0.5 * p.grasped.width + signed(i, p.grasped.com_offset)) }
    }
}

/// Position and velocity of the object along the axes of its own frame. Its origin is the middle of the hand.
#[derive(Debug, Clone, Copy)]
pub struct Frame<R> {
    /// Sine of the angle by which the frame is turned.
    pub sin: R,
    pub cos: R,
    pub theta: R,
    pub omega: R,
    /// The centre of gravity along the normal.
    pub x: R,
    pub y: R,
    /// Its velocity along the normal.
    pub u: R,
    pub v: R,
}

impl<R: Real> Frame<R> {
    #[inline(always)]
    pub(in crate::model) fn of_object([x, y, theta]: [R; 3], [u, v, omega]: [R; 3]) -> Self {
        let (sin, cos) = theta.sin_cos();
        Self {
            sin,
            cos,
            theta,
            omega,
            x: x.dot2(cos, y, sin),
            y: y.dot2(cos, -x, sin),
            u: u.dot2(cos, v, sin),
            v: v.dot2(cos, -u, sin),
        }
    }
}
