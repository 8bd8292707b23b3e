//! Unilateral contact: the constraint stabilisation method on the rows that the modes of the contacts hold.
//!
//! The states are those of [`Csm`], and where both tips stick the equations are those of [`Csm`], bit for bit. A
//! free tip keeps its own mass, spring and damper. The tilt in its elastic energy is frozen at its value at
//! the release, and its couple acts on nothing. Events change the modes.

use crate::formulation::{Csm, Equations};
use crate::model::{Geometry, Papers, Plant, Source};
use crate::number::{Real, inlined};

#[derive(Debug, Clone, Copy)]
pub struct Unilateral<R> {
    pub(crate) csm: Csm<R>,
    pub(super) friction: [R; 2],
}

impl<R: Real> Unilateral<R> {
    /// The equations of a scene whose bilateral ones are `csm`.
    #[inline(always)]
    pub fn new(source: &impl Source<R>, csm: Csm<R>) -> Self {
        let friction = [source.number(|p| p.friction.right), source.number(|p| p.friction.left)];
        Self { csm, friction }
    }
}

impl<R: Real> Equations<R> for Unilateral<R> {
    type Parts = Papers;
    const CALLED: bool = R::ORDER > 0;

    inlined! {
        opens(&self) -> bool = true;
        friction(&self) -> Option<[R; 2]> = Some(self.friction);
        bias(&self, geometry: &Geometry<R, Papers>) -> [R; 4] = self.csm.gamma(geometry);
        plant(&self) -> &Plant<R> = &self.csm.plant;
    }
}
