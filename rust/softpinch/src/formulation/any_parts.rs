//! The equations of a scene whose parts are not the paper's: jaws, arcs, measured tips.
//!
//! They are those of unilateral contact, in which both tips stick if the contact is bilateral, in one piece of code for all
//! formulations. So the code of the paper's contacts has no branch for others, and loops, methods and solves are not
//! multiplied by their kinds.

use crate::formulation::equations::evaluated;
use crate::formulation::{Choice, Csm, Equations, Evaluation, Formulation, States, Terms, Unilateral};
use crate::model::{
    Applied, CONTACT_WORKS, ContactModel, Contacts, Energies, Geometry, Motion, Others, Plant, Source,
    Stabilization,
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
    ['a, R: Real]
    Evaluate<'a, R>(equations: &'a AnyParts<R>, driven: bool, applied: Applied<'a, R>,
        contacts: &'a Contacts<R>, y: &'a States<R>, ledger: bool)
    for R => Evaluation<R> = evaluated(equations, driven, applied, contacts, y, ledger)
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

    inlined! {
        drifts(&self) -> bool = self.drifts;
        opens(&self) -> bool = self.opens;
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
    fn bias(&self, geometry: &Geometry<R, Others>) -> [R; 4] {
        if self.drifts { self.unilateral.csm.gamma(geometry) } else { geometry.bias() }
    }

    #[inline(always)]
    fn terms(
        &self,
        driven: bool,
        applied: Applied<'_, R>,
        contacts: &Contacts<R>,
        motion: &Motion<R>,
        geometry: Geometry<R, Others>,
    ) -> Terms<R, Others> {
        self.unilateral.terms_of(driven, applied, contacts, motion, geometry)
    }

    /// Called, because steps, Jacobians and linear models need the same large code.
    #[inline(always)]
    fn evaluate(
        &self,
        driven: bool,
        applied: Applied<'_, R>,
        contacts: &Contacts<R>,
        y: &States<R>,
        ledger: bool,
    ) -> Evaluation<R> {
        R::outlined(Evaluate { equations: self, driven, applied, contacts, y, ledger })
    }

    #[inline(always)]
    fn energies(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R> {
        R::outlined(EnergiesOf { equations: self, contacts, motion })
    }

    #[inline(always)]
    fn powers(
        &self,
        terms: &Terms<R, Others>,
        contacts: &Contacts<R>,
        motion: &Motion<R>,
    ) -> [R; CONTACT_WORKS] {
        self.unilateral.powers_of(terms, contacts, motion)
    }
}
