//! Unilateral contact: the constraint stabilisation method on the rows that the modes of the contacts hold.
//!
//! The states are those of [`Csm`], and where both tips stick the equations are those of [`Csm`], bit for bit. A
//! free tip keeps its own mass, spring and damper. The tilt in its elastic energy is frozen at its value at
//! the release, and its couple acts on nothing. Events change the modes.
//!
//! Contacts that are not the paper's, of jaws, arcs and tips that relax, have these equations in bilateral contact too: both
//! tips stick then. All formulations share one piece of code for them, that of [`Others`](crate::model::Others). So the code of the paper's contacts has no branch
//! for others, and loops, methods and solves are not multiplied by their kinds. Other laws of the tip need no other equations:
//! those of the paper call them.

use std::marker::PhantomData;

use crate::formulation::{Csm, Equations};
use crate::model::{Geometry, Motion, Papers, Parts, Plant, Source};
use crate::number::{Real, inlined};

#[derive(Debug, Clone, Copy)]
pub struct Unilateral<R, P = Papers> {
    /// Its gains of stabilisation are zero in `nullspace` and `projected`.
    pub(crate) csm: Csm<R>,
    pub(super) friction: [R; 2],
    /// Whether the states can leave the constraints, and whether contacts can slip and open: always with the paper's parts.
    drifts: bool,
    pub(super) opens: bool,
    parts: PhantomData<P>,
}

impl<R: Real, P: Parts> Unilateral<R, P> {
    /// The equations of a scene whose bilateral ones are `csm`.
    #[inline(always)]
    pub fn new(source: &impl Source<R>, csm: Csm<R>, drifts: bool, opens: bool) -> Self {
        let friction = [source.number(|p| p.friction.right), source.number(|p| p.friction.left)];
        Self { csm, friction, drifts, opens, parts: PhantomData }
    }
}

impl<R: Real, P: Parts> Equations<R> for Unilateral<R, P> {
    type Parts = P;
    const CALLED: bool = R::ORDER > 0 || !P::PAPERS;

    inlined! {
        drifts(&self) -> bool = P::PAPERS || self.drifts;
        opens(&self) -> bool = P::PAPERS || self.opens;
        friction(&self) -> Option<[R; 2]> = Some(self.friction);
        bias(&self, geometry: &Geometry<R, P>) -> [R; 4] = self.csm.gamma(geometry);
        plant(&self) -> &Plant<R> = &self.csm.plant;
    }

    #[inline(always)]
    fn geometry(&self, motion: &mut Motion<R>) -> Geometry<R, P> {
        let sides = &self.plant().sides;
        if self.drifts() {
            Geometry::of(sides, &motion.q, &motion.p)
        } else {
            Geometry::constrained(sides, &mut motion.q, &mut motion.p)
        }
    }
}
