//! Unilateral contact: the constraint stabilisation method on the rows that the modes of the contacts hold.
//!
//! The states are those of [`Csm`], and where both tips stick the equations are those of [`Csm`], bit for bit. A
//! free tip keeps its own mass, spring and damper. The tilt in its elastic energy is frozen at its value at
//! the release, and its couple acts on nothing. Events change the modes.

use crate::formulation::constrained::constrained;
use crate::formulation::contact_solve::{Load, Response, response};
use crate::formulation::csm::{Csm, pack, unpack};
use crate::formulation::equations::States;
use crate::model::contact_modes::Contacts;
use crate::model::control::Controller;
use crate::model::drive::Input;
use crate::model::energy::ElasticGradient;
use crate::model::forces::{Forces, Plant};
use crate::model::geometry::Geometry;
use crate::model::geometry::index::{D_N, D_T};
use crate::model::motion::Motion;
use crate::model::parameters::Stabilization;
use crate::model::source::Source;
use crate::number::real::Real;

/// The equations of unilateral contact.
#[derive(Debug, Clone, Copy)]
pub struct Unilateral<R, K> {
    csm: Csm<R, K>,
    friction: [R; 2],
}

/// All terms at one state.
#[derive(Debug, Clone, Copy)]
pub struct ContactTerms<R> {
    /// The geometry. Its residuals C^H and C^N are the gap of a free tip and the velocity of one that slips.
    pub geometry: Geometry<R>,
    /// The applied forces. The couples of tips that graze or are free are left out.
    pub forces: Forces<R>,
    /// Multipliers, shares of the couples, and accelerations.
    pub response: Response<R>,
    /// dP/d theta_pi of both tips, N m, whether it acts or not.
    pub couple: [R; 2],
    /// mu of both contacts.
    pub friction: [R; 2],
}

impl<R: Real, K: Controller<R>> Unilateral<R, K> {
    /// The equations of a scene with the gains of (19) and (20).
    pub fn new(source: &impl Source<R>, stabilization: &Stabilization) -> Self {
        let friction = source.number(|p| p.surroundings.friction);
        Self { csm: Csm::new(Plant::new(source), stabilization), friction: [friction; 2] }
    }

    /// The constants of the scene.
    pub fn plant(&self) -> &Plant<R, K> {
        &self.csm.plant
    }

    /// mu of both contacts.
    pub fn friction(&self) -> [R; 2] {
        self.friction
    }

    /// All terms at one state, in the modes of the contacts.
    #[inline(always)]
    pub fn terms(&self, input: &Input<R>, contacts: &Contacts<R>, motion: &Motion<R>) -> ContactTerms<R> {
        let (csm, plant) = (&self.csm, &self.csm.plant);
        let Motion { q, p, memory } = motion;
        let geometry = Geometry::new(&plant.sides, q, p);
        let elastic = plant.elastic(&geometry, q);
        let couple = [elastic[0].tilt, elastic[1].tilt];
        let special = contacts.special();
        let elastic = if special == 0 { elastic } else { self.released(contacts, elastic, q) };
        let mut forces = plant.forces_with(elastic, &geometry, q, p, memory, input);
        let (force, bias) = (forces.total(), csm.gamma(&geometry));
        let finger_acceleration = input.target_acceleration;
        let stuck = constrained(&geometry, plant, &force, &bias, &finger_acceleration);
        let one = R::constant(1.0);
        let mut found = Response {
            multipliers: stuck.multipliers,
            share: [one; 2],
            acceleration: stuck.acceleration,
            pivots: [one; 4],
        };
        if special != 0 {
            let friction = self.friction;
            let load = Load { force, couple, friction, bias, finger_acceleration };
            found = select(special, &response(&geometry, plant, contacts, &load), &found);
        }
        if !K::ANGLE_IS_STATE {
            for i in 0..2 {
                let part = R::select(contacts.graze[i], found.share[i] * couple[i], forces.elastic[i].tilt);
                forces.elastic[i].tilt = part;
            }
            forces.torque =
                plant.driving_torque(&geometry, &forces, &finger_acceleration, &found.multipliers);
        }
        ContactTerms { geometry, forces, response: found, couple, friction: self.friction }
    }

    /// The gradients of (5) in the modes of the contacts: with frozen tilts where tips are free, and without
    /// the couples of tips that graze or are free.
    #[inline(always)]
    fn released(
        &self,
        contacts: &Contacts<R>,
        mut elastic: [ElasticGradient<R>; 2],
        q: &[R; 9],
    ) -> [ElasticGradient<R>; 2] {
        for i in 0..2 {
            let (sin, cos) = contacts.frozen_tilt[i].sin_cos();
            let frozen = self.csm.plant.tips[i].gradient(sin, cos, q[D_N + i], q[D_T + i]);
            let (free, live) = (contacts.free[i], elastic[i]);
            elastic[i] = ElasticGradient {
                tilt: R::select(contacts.unloaded(i), R::zero(), live.tilt),
                normal: R::select(free, frozen.normal, live.normal),
                tangential: R::select(free, frozen.tangential, live.tangential),
            };
        }
        elastic
    }

    /// The state of a motion.
    #[inline(always)]
    pub fn begin(&self, motion: &Motion<R>) -> States<R> {
        pack::<R, K>(&motion.q, &motion.p, &motion.memory)
    }

    /// The derivative of a state, in the modes of the contacts.
    #[inline(always)]
    pub fn rate(&self, input: &Input<R>, contacts: &Contacts<R>, y: &States<R>) -> States<R> {
        let motion = self.motion(input, y);
        let acceleration = self.terms(input, contacts, &motion).response.acceleration;
        let memory = if K::MEMORY { self.plant().memory_rates(&motion.q, input) } else { [R::zero(); 2] };
        pack::<R, K>(&motion.p, &acceleration, &memory)
    }

    /// The motion of a state.
    #[inline(always)]
    pub fn motion(&self, input: &Input<R>, y: &States<R>) -> Motion<R> {
        unpack::<R, K>(input, y)
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
    for k in 0..9 {
        found.acceleration[k] = R::select(bits, a.acceleration[k], b.acceleration[k]);
    }
    found
}
