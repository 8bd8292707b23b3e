//! Mechanisms: what carries a tip, and where it puts the tip for a finger's coordinate.
//!
//! A new mechanism is a file in `mechanism/` with a function `arm` like `OneLink::arm`, and an entry of [`Mechanism`].

mod one_link;

pub use one_link::OneLink;

use crate::model::contact::shape::Frame;
use crate::model::source::Source;
use crate::number::real::Real;

/// The position of one fingertip in the frame of the object's side, without any deformation.
#[derive(Debug, Clone, Copy)]
pub struct Arm<R> {
    /// theta_pi (6).
    pub tilt: R,
    /// sin theta_pi.
    pub sin_tilt: R,
    /// cos theta_pi.
    pub cos_tilt: R,
    /// sin theta_i, by which gravity turns the finger (43).
    pub sin_finger: R,
    /// cos theta_i.
    pub cos_finger: R,
    /// n_i, from the finger's root to the tip's centre along the side's normal.
    pub normal: R,
    /// t_i, from the finger's root to the tip's centre across the side's normal.
    pub across: R,
    /// s_i X_i.
    pub sx: R,
    /// G_i (11).
    pub g: R,
    /// The rate of the finger's coordinate.
    pub turn: R,
}

/// The mechanism of one finger.
#[derive(Debug, Clone, Copy)]
pub enum Mechanism<R> {
    /// A rigid link that turns about its root (7, 8).
    OneLink(OneLink<R>),
}

impl<R: Real> Mechanism<R> {
    /// The mechanism of finger `i`.
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, i: usize) -> Self {
        Self::OneLink(OneLink::new(source, i))
    }

    /// The tip's position for the finger's coordinate and its rate.
    #[inline(always)]
    pub(super) fn arm(&self, i: usize, frame: &Frame<R>, coordinate: R, rate: R) -> Arm<R> {
        let Self::OneLink(link) = self;
        link.arm(i, frame, coordinate, rate)
    }

    /// The angle of the tip's base to the upright, for the finger's coordinate; or the rate of one for the rate of the other.
    #[inline(always)]
    pub(super) fn tilt(&self, coordinate: R) -> R {
        let Self::OneLink(_) = self;
        coordinate
    }
}
