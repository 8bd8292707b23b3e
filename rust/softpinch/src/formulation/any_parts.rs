//! The equations of a scene whose contacts are not the paper's: jaws, arcs, tips that relax.
//!
//! They are those of unilateral contact, in which both tips stick if the contact is bilateral, in one piece of code for all
//! formulations. So the code of the paper's contacts has no branch for others, and loops, methods and solves are not
//! multiplied by their kinds. Other laws of the tip need no other equations: those of the paper call them.

use crate::formulation::{Equations, Unilateral};
use crate::model::{Geometry, Motion, Others, Plant};
use crate::number::{Real, inlined};

#[derive(Debug, Clone, Copy)]
pub struct AnyParts<R> {
    /// The equations with modes of the contacts. Their gains of stabilisation are zero in `nullspace` and `projected`.
    pub(crate) unilateral: Unilateral<R>,
    /// Whether the states can leave the constraints.
    pub(crate) drifts: bool,
    /// Whether contacts can slip and open.
    pub(crate) opens: bool,
}

impl<R: Real> Equations<R> for AnyParts<R> {
    type Parts = Others;
    const CALLED: bool = true;

    inlined! {
        drifts(&self) -> bool = self.drifts;
        opens(&self) -> bool = self.opens;
        friction(&self) -> Option<[R; 2]> = Some(self.unilateral.friction);
        bias(&self, geometry: &Geometry<R, Others>) -> [R; 4] = self.unilateral.csm.gamma(geometry);
        plant(&self) -> &Plant<R> = &self.unilateral.csm.plant;
    }

    #[inline(always)]
    fn geometry(&self, motion: &mut Motion<R>) -> Geometry<R, Others> {
        let sides = &self.plant().sides;
        if self.drifts {
            Geometry::of(sides, &motion.q, &motion.p)
        } else {
            Geometry::constrained(sides, &mut motion.q, &mut motion.p)
        }
    }
}
