//! Mechanisms: what carries a tip, and where it puts the tip for a finger's coordinate.
//!
//! A new mechanism is a file in `mechanism/` with a function `placed` like `Jaw::placed`, an entry of [`Mechanism`] and one
//! of [`MechanismKind`], and its inertia and reach elsewhere (docs/architecture.md). The paper's link has a second function,
//! `arm`, which is inlined into the equations.

mod jaw;
mod one_link;
mod parallelogram;

pub use jaw::Jaw;
pub use one_link::OneLink;
pub use parallelogram::Parallelogram;

use crate::model::{Source, numbered};
use crate::number::Real;

numbered! {
    MechanismKind {
        /// A rigid link that turns about its root (7, 8).
        OneLink,
        /// A jaw that travels along a line.
        Jaw,
        /// A parallelogram, whose tip moves on a circle without turning.
        Parallelogram,
    }
}

/// The position of one fingertip in the frame of a parallel face, without any deformation.
#[derive(Debug, Clone, Copy)]
pub struct Arm<R> {
    /// theta_pi (6).
    pub tilt: R,
    pub sin_tilt: R,
    pub cos_tilt: R,
    /// sin theta_i, by which gravity turns the finger (43).
    pub sin_finger: R,
    pub cos_finger: R,
    /// n_i, from the finger's root to the tip's centre along the side's normal.
    pub normal: R,
    /// t_i, from the finger's root to the tip's centre across the side's normal.
    pub across: R,
    /// s_i X_i.
    pub sx: R,
    /// G_i (11).
    pub g: R,
    pub turn: R,
}

/// The tip's base for one coordinate z of the finger, with derivatives by z. Vectors have the components inwards, towards
/// the middle of the hand, and upwards.
#[derive(Debug, Clone, Copy)]
pub struct Placed<R> {
    /// O, the tip's centre.
    pub centre: [R; 2],
    /// O'.
    pub way: [R; 2],
    /// O''.
    pub bend: [R; 2],
    /// phi, the angle of the base to the upright, its sine and its cosine.
    pub angle: [R; 3],
    /// phi', a constant of each kind.
    pub turn: R,
    /// The numbers to which the forces of gravity and of the hand's motion have factors: sine and cosine of an angle, or
    /// the travel of a jaw and zero.
    pub gravity: [R; 2],
}

/// An angle, its sine and its cosine.
#[inline(always)]
fn turned<R: Real>(angle: R) -> [R; 3] {
    let (sin, cos) = angle.sin_cos();
    [angle, sin, cos]
}

#[derive(Debug, Clone, Copy)]
pub enum Mechanism<R> {
    OneLink(OneLink<R>),
    Jaw(Jaw<R>),
    Parallelogram(Parallelogram<R>),
}

impl<R: Real> Mechanism<R> {
    #[inline(always)]
    pub(crate) fn new(source: &impl Source<R>, i: usize) -> Self {
        match source.kinds().mechanism(i) {
            MechanismKind::OneLink => Self::OneLink(OneLink::new(source, i)),
            MechanismKind::Jaw => Self::Jaw(Jaw::new(source, i)),
            MechanismKind::Parallelogram => Self::Parallelogram(Parallelogram::new(source, i)),
        }
    }

    /// The tip's base for a coordinate.
    #[inline(always)]
    pub(crate) fn placed(&self, coordinate: R) -> Placed<R> {
        match self {
            Self::OneLink(link) => link.placed(coordinate),
            Self::Jaw(jaw) => jaw.placed(coordinate),
            Self::Parallelogram(bars) => bars.placed(coordinate),
        }
    }
}
