//! Shapes of the object's sides: the frame in which a contact is computed, and the ends of the side.
//!
//! A new shape is a file in `shape/` with the functions of `TiltedFace`, an entry of [`Shape`] and one of [`SideShape`].
//! The tilted face is compiled for the tests only: they show by it that a side can be another one.

mod parallel_face;
#[cfg(test)]
mod tilted_face;

pub use parallel_face::ParallelFace;
#[cfg(test)]
pub use tilted_face::TiltedFace;

use crate::error::Error;
use crate::model::coordinates::Coordinates;
use crate::model::source::Source;
use crate::number::real::{Real, signed};

/// The kind of a side, with the numbers that only this kind has.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum SideShape {
    /// A face that is parallel to the object's other one: the paper's.
    #[default]
    ParallelFace,
    /// A face that is tilted about its middle, which is W/2 + s_i w from the centre of gravity.
    #[cfg(test)]
    TiltedFace {
        /// The angle by which the object is wider at its upper end, rad.
        tilt: f64,
    },
}

impl SideShape {
    /// The tilt of the side, rad.
    pub fn tilt(&self) -> f64 {
        match *self {
            Self::ParallelFace => 0.0,
            #[cfg(test)]
            Self::TiltedFace { tilt } => tilt,
        }
    }

    /// Refuses a face that is tilted by a right angle or more.
    pub fn check(&self, side: &str) -> Result<(), Error> {
        let tilt = self.tilt();
        if tilt.abs() < std::f64::consts::FRAC_PI_2 {
            return Ok(());
        }
        let field = format!("grasped.{side}.tilt");
        Err(Error::Field { field, value: tilt, rule: "must be between -pi/2 and pi/2" })
    }
}

/// Position and velocity of the object along the axes of its own frame, or along those of the frame of a side: the side's
/// normal, and the direction across it. Its origin is the middle of the hand.
#[derive(Debug, Clone, Copy)]
pub struct Frame<R> {
    /// Sine of the angle by which the frame is turned.
    pub sin: R,
    /// Cosine of that angle.
    pub cos: R,
    /// The angle.
    pub theta: R,
    /// The rate of the angle.
    pub omega: R,
    /// The centre of gravity along the normal.
    pub x: R,
    /// The centre of gravity across the normal.
    pub y: R,
    /// Its velocity along the normal.
    pub u: R,
    /// Its velocity across the normal.
    pub v: R,
}

impl<R: Real> Frame<R> {
    /// The object's own frame.
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

/// The direction of a side's normal in the object's frame.
#[derive(Debug, Clone, Copy)]
pub enum Direction<R> {
    /// That of the object's first axis.
    Aligned,
    /// Turned by an angle with this cosine and this sine.
    Turned {
        /// Cosine of the angle.
        cos: R,
        /// Sine of the angle.
        sin: R,
    },
}

impl<R: Real> Direction<R> {
    /// Cosine and sine of the angle; `None` if it is zero. Only the tests have kinds of sides that are turned, so that the
    /// release module has no code for them.
    #[inline(always)]
    pub fn turned(&self) -> Option<[R; 2]> {
        match *self {
            Self::Turned { cos, sin } if cfg!(test) => Some([cos, sin]),
            _ => None,
        }
    }

    /// The components of a vector along the axes of the side, from those along the object's axes.
    #[inline(always)]
    pub fn into_side(&self, [along, across]: [R; 2]) -> [R; 2] {
        match self.turned() {
            None => [along, across],
            Some([cos, sin]) => [along.dot2(cos, across, sin), across.dot2(cos, -along, sin)],
        }
    }

    /// The components of a vector along the object's axes, from those along the axes of the side.
    #[inline(always)]
    pub fn out_of_side(&self, [along, across]: [R; 2]) -> [R; 2] {
        match self.turned() {
            None => [along, across],
            Some([cos, sin]) => [along.dot2(cos, -across, sin), across.dot2(cos, along, sin)],
        }
    }
}

/// The shape of one side.
#[derive(Debug, Clone, Copy)]
pub enum Shape<R> {
    /// A face that is parallel to the other one.
    ParallelFace(ParallelFace<R>),
    /// A tilted face.
    #[cfg(test)]
    TiltedFace(TiltedFace<R>),
}

impl<R: Real> Shape<R> {
    /// The side of the object that finger `i` touches.
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        let distance = source.number(|p| 0.5 * p.grasped.width + signed(i, p.grasped.com_offset));
        match source.kinds().shapes[i] {
            SideShape::ParallelFace => Self::ParallelFace(ParallelFace { distance }),
            #[cfg(test)]
            SideShape::TiltedFace { .. } => {
                Self::TiltedFace(TiltedFace::new(i, distance, source.number(|p| p.shapes[i].tilt())))
            }
        }
    }

    /// The frame of the side, and the direction of its normal in the object's frame.
    #[inline(always)]
    #[cfg_attr(not(test), expect(unused_variables, reason = "a parallel face has the object's own frame"))]
    pub(super) fn frame(&self, i: usize, object: &Frame<R>) -> (Frame<R>, Direction<R>) {
        match self {
            Self::ParallelFace(_) => (*object, Direction::Aligned),
            #[cfg(test)]
            Self::TiltedFace(face) => face.frame(i, object),
        }
    }

    /// The distance of the side from the centre of gravity, along the side's normal.
    #[inline(always)]
    pub(super) fn distance(&self) -> R {
        match self {
            Self::ParallelFace(face) => face.distance,
            #[cfg(test)]
            Self::TiltedFace(face) => face.distance,
        }
    }

    /// The place of a contact along the side, up to its sign, from A_i = s_i G_i.
    #[inline(always)]
    pub(super) fn place(&self, a: R) -> R {
        match self {
            Self::ParallelFace(_) => a,
            #[cfg(test)]
            Self::TiltedFace(face) => face.place(a),
        }
    }

    /// theta_pi (6) at the coordinates `q`, from the tilt of the tip's base to the upright.
    #[inline(always)]
    pub(super) fn tilt(&self, i: usize, base: R, q: &Coordinates<R>) -> R {
        match self {
            Self::ParallelFace(_) => base + signed(i, q.object[2]),
            #[cfg(test)]
            Self::TiltedFace(face) => base + signed(i, q.object[2] + signed(i, face.tilt)),
        }
    }

    /// The rate of theta_pi for the rates `p`, from that of the tilt of the tip's base.
    #[inline(always)]
    pub(super) fn tilt_rate(&self, i: usize, base: R, p: &Coordinates<R>) -> R {
        base + signed(i, p.object[2])
    }
}
