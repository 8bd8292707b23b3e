//! A side by four numbers: a tilted face, or an arc.
//!
//! Its apex is at (-s_i b, h) from the centre of gravity, along the object's axes. There its normal n_0 is turned by
//! s_i beta from the object's first axis, and its curvature is k_0 = 1/R, zero for a face. With the place P of the tip's
//! centre from the apex, A = -s_i P.n_0 and T = P.t_0,
//!
//! ```text
//! e = 1 + k_0 A,  g = k_0 T,  Q = sqrt(e^2 + g^2),  D = (2 A + k_0 (A^2 + T^2)) / (1 + Q),
//! n = (e n_0 - s_i g t_0) / Q,  k = k_0 / Q
//! ```
//!
//! give the distance D of the tip's centre from the side, the normal n at its foot and 1 / (R + D). For k_0 = 0 they are
//! those of a face, without round-off, and for the smallest curvatures nothing cancels.

use super::ShapeKind;
use crate::model::Source;
use crate::number::{Real, signed};

#[derive(Debug, Clone, Copy)]
pub struct Surface<R> {
    /// The apex from the centre of gravity, along the object's axes.
    pub(in crate::model) apex: [R; 2],
    /// beta, its sine and its cosine.
    tilt: R,
    sin: R,
    cos: R,
    /// 1/R.
    curvature: R,
    pub(in crate::model) curved: bool,
}

/// The foot of the perpendicular from a tip's centre. Vectors are along the object's axes.
#[derive(Debug, Clone, Copy)]
pub struct Foot<R> {
    /// D.
    pub distance: R,
    /// n.
    pub normal: [R; 2],
    /// k.
    pub curvature: R,
    /// beta - atan2(g, e), the tilt of the side there.
    pub tilt: R,
    /// The place of the foot from the apex, upwards along the side.
    pub place: R,
}

impl<R: Real> Surface<R> {
    #[inline(always)]
    pub(in crate::model) fn new(source: &impl Source<R>, i: usize) -> Self {
        let zero = R::zero();
        let curved = source.kinds().shape(i) == ShapeKind::Arc;
        let (mut tilt, mut height, mut curvature) = (source.number(|p| p.shapes[i].tilt), zero, zero);
        let mut width = source.number(|p| 0.5 * p.grasped.width + signed(i, p.grasped.com_offset));
        if curved {
            (tilt, height) = (zero, source.number(|p| p.shapes[i].center_y));
            width = source.number(|p| p.shapes[i].radius - signed(i, p.shapes[i].center_x));
            curvature = R::constant(1.0) / source.number(|p| p.shapes[i].radius);
        }
        let (sin, cos) = tilt.sin_cos();
        Self { apex: [signed(i, -width), height], tilt, sin, cos, curvature, curved }
    }

    /// The foot of the perpendicular from `place`, which is given from the centre of gravity.
    #[inline(always)]
    pub(in crate::model::contact) fn foot(&self, i: usize, place: [R; 2]) -> Foot<R> {
        let [x, y] = [place[0] - self.apex[0], place[1] - self.apex[1]];
        let turned = signed(i, self.sin);
        let (away, along) = (signed(i, -x.dot2(self.cos, y, turned)), y.dot2(self.cos, -x, turned));
        if !self.curved {
            let (zero, normal) = (R::zero(), [self.cos, turned]);
            return Foot { distance: away, normal, curvature: zero, tilt: self.tilt, place: along };
        }
        let (one, k) = (R::constant(1.0), self.curvature);
        let (e, g) = (k.mul_add(away, one), k * along);
        let size = e.dot2(e, g, g).sqrt();
        let squares = away.dot2(away, along, along);
        let inverse = one / size;
        let angle = g.angle(e);
        Foot {
            distance: k.mul_add(squares, away + away) / (one + size),
            normal: [
                e.dot2(self.cos, g, self.sin) * inverse,
                signed(i, e.dot2(self.sin, -g, self.cos)) * inverse,
            ],
            curvature: k * inverse,
            tilt: self.tilt - angle,
            place: angle / k,
        }
    }
}
