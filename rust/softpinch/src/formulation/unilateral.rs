//! Unilateral contact: the constraint stabilisation method on the rows that the modes of the contacts hold.
//!
//! The states are those of [`Csm`], and where both tips stick the equations are those of [`Csm`], bit for bit. A
//! free tip keeps its own mass, spring and damper. The tilt in its elastic energy is frozen at its value at
//! the release, and its couple acts on nothing. Events change the modes.

use crate::formulation::contact_solve::Load;
use crate::formulation::{Csm, Equations, Response, Terms, constrained, response};
use crate::model::{
    Applied, CONTACT_WORKS, Contacts, Coordinates, ElasticGradient, Energies, Geometry, Motion, Papers,
    Parts, Plant, Source,
};
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

    /// The gradients of (5) in the modes of the contacts: with frozen tilts where tips are free, and without
    /// the couples of tips that graze or are free.
    #[inline(always)]
    fn released<P: Parts>(
        &self,
        contacts: &Contacts<R>,
        mut elastic: [ElasticGradient<R>; 2],
        q: &Coordinates<R>,
    ) -> [ElasticGradient<R>; 2] {
        for i in 0..2 {
            let (sin, cos) = contacts.frozen_tilt[i].sin_cos();
            let at = [sin, cos, q.compression[i], q.shear[i]];
            let frozen = self.csm.plant.tips[i].gradient::<P>(at);
            let (free, live) = (contacts.free[i], elastic[i]);
            elastic[i] = ElasticGradient {
                tilt: R::select(contacts.unloaded(i), R::zero(), live.tilt),
                normal: R::select(free, frozen.normal, live.normal),
                tangential: R::select(free, frozen.tangential, live.tangential),
            };
        }
        elastic
    }

    /// The energies of a motion. The elastic energy of a free tip is that at its frozen tilt.
    #[inline(always)]
    pub(super) fn energies_of<P: Parts>(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R> {
        let (plant, Motion { q, p, .. }) = (&self.csm.plant, motion);
        let mut energies = plant.energies::<P>(q, p);
        if let Some([right, left]) = plant.relaxing::<P>(motion, true) {
            energies.elastic = (energies.elastic + right.stored) + left.stored;
        }
        if contacts.free[0] | contacts.free[1] != 0 {
            for i in 0..2 {
                let (_, sin, cos) = plant.sides[i].tilt::<P>(i, q);
                let (frozen_sin, frozen_cos) = contacts.frozen_tilt[i].sin_cos();
                let (d_n, d_t) = (q.compression[i], q.shear[i]);
                let live = plant.tips[i].energy::<P>([sin, cos, d_n, d_t]);
                let frozen = plant.tips[i].energy::<P>([frozen_sin, frozen_cos, d_n, d_t]);
                let gain = R::select(contacts.free[i], frozen - live, R::zero());
                energies.elastic = energies.elastic + gain;
            }
        }
        energies
    }

    /// All terms at one state, in the modes of the contacts.
    #[inline(always)]
    pub(crate) fn terms_of<P: Parts>(
        &self,
        driven: bool,
        applied: Applied<'_, R>,
        contacts: &Contacts<R>,
        motion: &Motion<R>,
        geometry: Geometry<R, P>,
    ) -> Terms<R, P> {
        let plant = &self.csm.plant;
        let elastic = plant.elastic(&geometry, &motion.q);
        let couple = [elastic[0].tilt, elastic[1].tilt];
        let special = contacts.special();
        let mut elastic =
            if special == 0 { elastic } else { self.released::<P>(contacts, elastic, &motion.q) };
        if let Some(tips) = plant.relaxing::<P>(motion, false) {
            for i in 0..2 {
                let [normal, tangential] = tips[i].resistance;
                elastic[i].normal = elastic[i].normal + normal;
                elastic[i].tangential = elastic[i].tangential + tangential;
            }
        }
        let mut forces = plant.forces(driven, elastic, &geometry, motion, applied);
        let (force, bias) = (forces.total(&geometry), self.csm.gamma(&geometry));
        let finger_acceleration = applied.0.target_acceleration;
        let mut found = constrained(driven, &geometry, plant, &force, &bias, &finger_acceleration);
        if special != 0 {
            let friction = self.friction;
            let load = Load { force, couple, friction, bias, finger_acceleration };
            found = select(special, &response(driven, &geometry, plant, contacts, &load), &found);
        }
        if driven {
            for i in 0..2 {
                let part = R::select(contacts.graze[i], found.share[i] * couple[i], forces.elastic[i].tilt);
                forces.elastic[i].tilt = part;
            }
            forces.torque =
                plant.driving_torque(&geometry, &forces, &finger_acceleration, &found.multipliers);
        }
        Terms { geometry, forces, response: found, couple }
    }

    /// The powers whose integrals are the works of the ledger. Friction's is the loss mu lambda^H |v|. While a
    /// tip grazes, its tilt changes (5) by tau theta_p-dot, but only the part psi of its couple acts.
    #[inline(always)]
    pub(super) fn powers_of<P: Parts>(
        &self,
        terms: &Terms<R, P>,
        contacts: &Contacts<R>,
        motion: &Motion<R>,
    ) -> [R; CONTACT_WORKS] {
        let Terms { geometry, forces, response, couple, .. } = terms;
        let drift = geometry.constraint_velocity();
        let zero = R::zero();
        let (mut held, mut friction, mut relaxation) = (response.multipliers, zero, zero);
        for i in 0..2 {
            let slip = contacts.slip(i);
            held[2 + i] = R::select(slip, zero, held[2 + i]);
            let loss = -(response.multipliers[2 + i] * drift[2 + i]);
            friction = friction + R::select(slip, loss, zero);
            let gain = ((R::constant(1.0) - response.share[i]) * couple[i]) * geometry.contacts[i].tilt_rate;
            relaxation = relaxation + R::select(contacts.graze[i], gain, zero);
        }
        let (plant, p) = (&self.csm.plant, &motion.p);
        let [control, external, mut viscous, constraint] = forces.powers(geometry, &plant.drags(p), p, &held);
        if let Some([right, left]) = plant.relaxing::<P>(motion, true) {
            viscous = (viscous + right.lost) + left.lost;
        }
        [control, external, viscous, constraint, friction, zero, relaxation]
    }
}

impl<R: Real> Equations<R> for Unilateral<R> {
    type Parts = Papers;
    const CALLED: bool = R::ORDER > 0;

    inlined! {
        opens(&self) -> bool = true;
        unilateral(&self) -> Option<&Unilateral<R>> = Some(self);
        plant(&self) -> &Plant<R> = &self.csm.plant;
    }
}

/// `a` in the lanes of `bits`, `b` in all other lanes.
#[inline(always)]
fn select<R: Real>(bits: u8, a: &Response<R>, b: &Response<R>) -> Response<R> {
    let mut found = *b;
    for k in 0..4 {
        found.multipliers[k] = R::select(bits, a.multipliers[k], b.multipliers[k]);
        found.pivots[k] = R::select(bits, a.pivots[k], b.pivots[k]);
    }
    for k in 0..2 {
        found.share[k] = R::select(bits, a.share[k], b.share[k]);
    }
    found.acceleration = Coordinates::select(bits, &a.acceleration, &b.acceleration);
    found
}
