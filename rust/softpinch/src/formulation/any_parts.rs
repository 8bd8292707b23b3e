//! The equations of a scene whose parts are not the paper's: jaws, arcs, measured tips.
//!
//! They are those of unilateral contact, in which both tips stick if the contact is bilateral, in one piece of code for all
//! formulations. So the code of the paper's contacts has no branch for others, and loops, methods and solves are not
//! multiplied by their kinds.

use crate::formulation::{Choice, Csm, Equations, Formulation, Unilateral};
use crate::model::{
    ContactModel, Contacts, Energies, Geometry, Motion, Others, Plant, Source, Stabilization,
};
use crate::number::{LaneTask, Real, inlined, task};

#[derive(Debug, Clone, Copy)]
pub struct AnyParts<R> {
    /// The equations with modes of the contacts. Their gains of stabilisation are zero in `nullspace` and `projected`.
    pub(crate) unilateral: Unilateral<R>,
    /// Whether the states can leave the constraints.
    pub(crate) drifts: bool,
    /// Whether contacts can slip and open.
    pub(crate) opens: bool,
}

task! {
    ['a, R: Real] EnergiesOf<'a, R>(equations: &'a AnyParts<R>, contacts: &'a Contacts<R>, motion: &'a Motion<R>)
    for R => Energies<R> = equations.unilateral.energies_of::<Others>(contacts, motion)
}

impl<R: Real> AnyParts<R> {
    #[inline(always)]
    pub(super) fn new(choice: Choice, source: &impl Source<R>, gains: &Stabilization) -> Self {
        let plant = Plant::called(source, choice.fingers, choice.moves);
        let unilateral = Unilateral::new(source, Csm::new(plant, &choice.formulation.gains(gains)));
        let opens = choice.contact == ContactModel::Unilateral;
        Self { unilateral, drifts: opens || choice.formulation != Formulation::Nullspace, opens }
    }
}

impl<R: Real> Equations<R> for AnyParts<R> {
    type Parts = Others;
    const CALLED: bool = true;

    inlined! {
        drifts(&self) -> bool = self.drifts;
        opens(&self) -> bool = self.opens;
        unilateral(&self) -> Option<&Unilateral<R>> = Some(&self.unilateral);
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

    #[inline(always)]
    fn energies(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R> {
        R::outlined(EnergiesOf { equations: self, contacts, motion })
    }
}
