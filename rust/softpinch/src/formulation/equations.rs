//! The interface of a formulation, and what all formulations have in common: the derivative and the multipliers
//! of a state, the jump by an impulse, and the energies.

use std::fmt::Debug;

use crate::formulation::contact_solve::Load;
use crate::formulation::{Response, constrained, response};
use crate::model::{
    Any, Applied, BILATERAL_WORKS, CONTACT_WORKS, Contacts, Coordinates, Energies, Forces, Geometry, Input,
    Motion, Parts, Plant, RELAXATIONS, each_coordinate, work,
};
use crate::number::{LaneTask, Real, dot, inlined, task};

/// Number of components of the largest state: nine coordinates, their rates, two memories, the eight works of the ledger, and
/// the four states of one Maxwell branch. More branches fit without the ledger.
pub const MAX_COMPONENTS: usize = 32;

/// A state as the integrators see it. Its components are, in this order: one coordinate for each degree of
/// freedom; the rates of these coordinates; quantities that depend on both and drive the rates (shears, branches of tips,
/// controllers' memories); the works of the ledger if it is carried, and the distance of slips in unilateral contact, which
/// drive nothing. The system's [`Size`] has the number of each. Zeros fill the rest.
pub type States<R> = [R; MAX_COMPONENTS];

/// The numbers of components of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    pub states: usize,
    /// Number of coordinates among these states. The coordinates come first, and their rates follow.
    pub degrees: usize,
    /// Number of works of the ledger that follow the states; 0 if the state does not carry them.
    pub works: usize,
    /// One if the distance of slips follows the works, else zero.
    pub slips: usize,
    /// Number of states of Maxwell branches, which are among the states.
    pub relaxations: usize,
}

/// Number of components that are computed together.
pub const BLOCK: usize = 4;

impl Size {
    inlined! {
        pub all(self) -> usize = self.states + self.works + self.slips;
        pub blocks(self) -> usize = self.all().div_ceil(BLOCK).min(MAX_COMPONENTS / BLOCK);
    }

    /// The distance of slips in a state; zero if it does not carry it.
    #[inline(always)]
    pub fn slipped<R: Real>(self, y: &States<R>) -> R {
        if self.slips > 0 { y[self.all() - 1] } else { R::zero() }
    }

    /// Calls `work` for each component of a state, and for the zeros that fill the last block. The length of
    /// a block is known at compile time.
    #[inline(always)]
    pub fn each(self, mut work: impl FnMut(usize)) {
        for block in 0..self.blocks() {
            for k in 0..BLOCK {
                work(BLOCK * block + k);
            }
        }
    }
}

/// What a state carries beside the motion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Carried {
    /// The works of the ledger.
    pub ledger: bool,
    /// The distance of slips, in unilateral contact.
    pub slips: bool,
}

/// The numbers of components of the equations' states.
#[inline(always)]
pub(super) fn size_of<R: Real, E: Equations<R>>(equations: &E, driven: bool, carried: Carried) -> Size {
    let works = if carried.ledger { equations.works() + usize::from(equations.plant().moves) } else { 0 };
    let (states, degrees) = (equations.states(driven), equations.degrees(driven));
    let slips = usize::from(carried.slips && equations.opens());
    Size { states, degrees, works, slips, relaxations: equations.relaxations() }
}

/// The results of a formulation at one state.
#[derive(Debug, Clone, Copy)]
pub struct Evaluation<R> {
    pub rate: States<R>,
    /// The state in the nine coordinates.
    pub motion: Motion<R>,
    /// (lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N).
    pub multipliers: [R; 4],
    /// (C_1^H, C_2^H, C_1^N, C_2^N).
    pub residuals: [R; 4],
    /// theta_p of both tips, for the monitors.
    pub tilt: [R; 2],
    /// sin theta_p of both tips, for the monitors.
    pub sin_tilt: [R; 2],
    /// The places of both contacts along their sides, up to their signs, m, for the monitors.
    pub contact_heights: [R; 2],
    pub torque: [R; 2],
    /// The part psi of each tip's couple that acts. Only unilateral contact computes it.
    pub share: [R; 2],
}

impl<R: Real> Evaluation<R> {
    #[inline(always)]
    pub(crate) fn nothing() -> Self {
        let zero = R::zero();
        Self {
            rate: [zero; MAX_COMPONENTS],
            motion: Motion::zero(),
            multipliers: [zero; 4],
            residuals: [zero; 4],
            tilt: [zero; 2],
            sin_tilt: [zero; 2],
            contact_heights: [zero; 2],
            torque: [zero; 2],
            share: [zero; 2],
        }
    }

    /// What the monitors need of a motion with this geometry. Grazing contacts have the parts `share`.
    #[inline(always)]
    pub(crate) fn of_contacts(
        motion: &Motion<R>,
        multipliers: &[R; 4],
        geometry: &Geometry<R, impl Parts>,
        share: [R; 2],
    ) -> Self {
        Self {
            motion: *motion,
            multipliers: *multipliers,
            residuals: geometry.residuals(),
            tilt: geometry.tilt(),
            sin_tilt: geometry.sin_tilt(),
            contact_heights: geometry.contact_heights(),
            share,
            ..Self::nothing()
        }
    }
}

/// The forces of (24) at a state, and what they make.
#[derive(Debug, Clone, Copy)]
pub struct Solved<R> {
    /// The applied forces. The couples of tips that graze or are free are left out.
    pub forces: Forces<R>,
    /// Multipliers, shares of the couples, and accelerations.
    pub response: Response<R>,
    /// dP/d theta_pi of both tips, N m, whether it acts or not.
    pub couple: [R; 2],
}

/// The same with the geometry. Its residuals C^H and C^N are the gap of a free tip and the velocity of one that slips.
#[derive(Debug, Clone, Copy)]
pub struct Terms<R, P = Any> {
    pub geometry: Geometry<R, P>,
    pub forces: Forces<R>,
    pub response: Response<R>,
    /// The rates of the constraints' velocities that the accelerations make: Phi times these.
    pub swept: [R; 4],
}

/// Evaluates an expression in which the kind of fingers is known at compile time. Loops over the states need it: with
/// a number of states that is known at run time only, vectors would be kept in memory instead of registers.
macro_rules! for_fingers {
    ($driven:expr, $known:ident => $body:expr) => {
        if $driven {
            let $known = true;
            $body
        } else {
            let $known = false;
            $body
        }
    };
}
pub(crate) use for_fingers;

/// The equations of a formulation, in numbers of any type. `driven` says whether the fingers follow the schedule, as
/// [`Plant::driven`] does; `carried` says what else the state carries, such as the works of the ledger. Bilateral contact
/// ignores the modes in `contacts`.
///
/// A formulation says what its states are and what bias its accelerations have. The rest is common to all.
pub trait Equations<R: Real>: Copy + Debug {
    /// The contacts for which the code is compiled.
    type Parts: Parts;
    /// Whether evaluations are called, because steps, Jacobians and linear models need the same large code.
    const CALLED: bool = false;

    inlined! {
        /// Whether the states can leave the constraints. If so, they have all deformations with their rates; if not, they
        /// have the shears, and the constraints determine the rest.
        drifts(&self) -> bool = true;
        /// Whether contacts can slip and open.
        opens(&self) -> bool = false;
        /// The bias b of the constraints on the accelerations, Phi a = -b, while both tips stick.
        bias(&self, geometry: &Geometry<R, Self::Parts>) -> [R; 4] = geometry.bias();
        /// The coefficients of friction, if the contacts have modes.
        friction(&self) -> Option<[R; 2]> = None;
        /// Number of works of the ledger, without that of the hand's motion.
        works(&self) -> usize = if self.opens() { CONTACT_WORKS } else { BILATERAL_WORKS };
        /// Number of coordinates that are states with their rates: the object's, those of fingers that the schedule does not
        /// prescribe, and deformations if the states can drift.
        degrees(&self, driven: bool) -> usize = 3 + if driven { 0 } else { 2 } + if self.drifts() { 4 } else { 0 };
    }

    /// Number of states of the motion: coordinates, rates, and after these shears, branches and controllers' memories.
    #[inline(always)]
    fn states(&self, driven: bool) -> usize {
        2 * self.degrees(driven)
            + if self.drifts() { 0 } else { 2 }
            + self.relaxations()
            + if driven { 0 } else { 2 }
    }

    inlined! {
        /// Number of states of Maxwell branches.
        relaxations(&self) -> usize = if Self::Parts::PAPERS { 0 } else { 4 * self.plant().branches };
        /// The place of the state's coordinate `n` among all nine.
        place(&self, driven: bool, n: usize) -> usize = if driven && n >= 3 { n + 2 } else { n };
    }

    fn plant(&self) -> &Plant<R>;

    /// The state of a motion, with works of zero. It turns the rates of a motion into the state's derivative, too.
    #[inline(always)]
    fn begin(&self, driven: bool, motion: &Motion<R>) -> States<R> {
        let Motion { q, p, memory, relaxation } = motion;
        let mut y = [R::zero(); MAX_COMPONENTS];
        let (coordinates, rates) = (q.row(), p.row());
        for_fingers!(driven, driven => {
            let (degrees, states) = (self.degrees(driven), self.states(driven));
            for n in 0..degrees {
                y[n] = coordinates[self.place(driven, n)];
                y[degrees + n] = rates[self.place(driven, n)];
            }
            if !self.drifts() {
                y[2 * degrees..2 * degrees + 2].copy_from_slice(&q.shear);
            }
            let (branches, end) = (self.relaxations(), states - if driven { 0 } else { 2 });
            y[end - branches..end].copy_from_slice(&relaxation[..branches]);
            if !driven {
                y[states - 2..states].copy_from_slice(memory);
            }
        });
        y
    }

    /// The motion of a state. Driven fingers are taken from the input, and coordinates that are no states are zero.
    #[inline(always)]
    fn unpack(&self, driven: bool, input: &Input<R>, y: &States<R>) -> Motion<R> {
        let (mut q, mut p, mut memory) = ([R::zero(); 9], [R::zero(); 9], [R::zero(); 2]);
        let (mut shear, mut relaxation) = ([R::zero(); 2], [R::zero(); RELAXATIONS]);
        for_fingers!(driven, driven => {
            let (degrees, states) = (self.degrees(driven), self.states(driven));
            for n in 0..degrees {
                q[self.place(driven, n)] = y[n];
                p[self.place(driven, n)] = y[degrees + n];
            }
            if !self.drifts() {
                shear.copy_from_slice(&y[2 * degrees..2 * degrees + 2]);
            }
            let (branches, end) = (self.relaxations(), states - if driven { 0 } else { 2 });
            relaxation[..branches].copy_from_slice(&y[end - branches..end]);
            if !driven {
                memory.copy_from_slice(&y[states - 2..states]);
            }
        });
        let (mut q, mut p) = (Coordinates::from(q), Coordinates::from(p));
        if !self.drifts() {
            q.shear = shear;
        }
        if driven {
            (q.finger, p.finger) = (input.target, input.target_rate);
        }
        Motion { q, p, memory, relaxation }
    }

    /// The geometry of a motion. A formulation whose states are on the constraints sets what these determine.
    #[inline(always)]
    fn geometry(&self, motion: &mut Motion<R>) -> Geometry<R, Self::Parts> {
        Geometry::of(&self.plant().sides, &motion.q, &motion.p)
    }

    /// All terms of (24) at one state, in the modes of the contacts.
    #[inline(always)]
    fn solved(
        &self,
        driven: bool,
        applied: Applied<'_, R>,
        contacts: &Contacts<R>,
        motion: &Motion<R>,
        geometry: &Geometry<R, Self::Parts>,
    ) -> Solved<R> {
        let (plant, friction) = (self.plant(), self.friction());
        let special = if friction.is_some() { contacts.special() } else { 0 };
        let mut tips = geometry.tips(&motion.q);
        if special != 0 {
            freeze(contacts, &mut tips);
        }
        let mut elastic = plant.elastic(tips);
        let couple = [elastic[0].tilt, elastic[1].tilt];
        if special != 0 {
            // The couples of tips that graze or are free do not act.
            for i in 0..2 {
                elastic[i].tilt = R::select(contacts.unloaded(i), R::zero(), couple[i]);
            }
        }
        if let Some(tips) = plant.relaxing::<Self::Parts>(motion, false) {
            for i in 0..2 {
                let [normal, tangential] = tips[i].resistance;
                elastic[i].normal = elastic[i].normal + normal;
                elastic[i].tangential = elastic[i].tangential + tangential;
            }
        }
        let mut forces = plant.forces(driven, elastic, geometry, motion, applied);
        let (force, bias) = (forces.total(geometry), self.bias(geometry));
        let finger_acceleration = applied.0.target_acceleration;
        let mut found = constrained(driven, geometry, plant, &force, &bias, &finger_acceleration);
        if let Some(friction) = friction
            && special != 0
        {
            let load = Load { force, couple, friction, bias, finger_acceleration };
            found = found.replaced(special, &response(driven, geometry, plant, contacts, &load));
        }
        if driven {
            if friction.is_some() {
                for i in 0..2 {
                    let part = found.share[i] * couple[i];
                    forces.elastic[i].tilt = R::select(contacts.graze[i], part, forces.elastic[i].tilt);
                }
            }
            forces.torque = plant.driving_torque(geometry, &forces, &finger_acceleration, &found.multipliers);
        }
        Solved { forces, response: found, couple }
    }

    /// The powers whose integrals are the works of the ledger. Friction's is the loss mu lambda^H |v|. While a
    /// tip grazes, its tilt changes (5) by tau theta_p-dot, but only the part psi of its couple acts.
    #[inline(always)]
    fn powers(
        &self,
        (geometry, solved): (&Geometry<R, Self::Parts>, &Solved<R>),
        contacts: &Contacts<R>,
        motion: &Motion<R>,
    ) -> [R; CONTACT_WORKS] {
        let Solved { forces, response, couple } = solved;
        let (plant, p, zero) = (self.plant(), &motion.p, R::zero());
        let (mut held, mut friction, mut relaxation) = (response.multipliers, zero, zero);
        if self.friction().is_some() {
            let drift = geometry.constraint_velocity();
            for i in 0..2 {
                let slip = contacts.slip(i);
                held[2 + i] = R::select(slip, zero, held[2 + i]);
                let loss = -(response.multipliers[2 + i] * drift[2 + i]);
                friction = friction + R::select(slip, loss, zero);
                let rate = geometry.contacts[i].tilt_rate;
                let gain = ((R::constant(1.0) - response.share[i]) * couple[i]) * rate;
                relaxation = relaxation + R::select(contacts.graze[i], gain, zero);
            }
        }
        let [control, external, mut viscous, constraint] = forces.powers(geometry, &plant.drags(p), p, &held);
        if let Some([right, left]) = plant.relaxing::<Self::Parts>(motion, true) {
            viscous = (viscous + right.lost) + left.lost;
        }
        [control, external, viscous, constraint, friction, zero, relaxation]
    }

    /// Derivative and multipliers of the state `y` under the inputs of the instant.
    #[inline(always)]
    fn evaluate(
        &self,
        driven: bool,
        applied: Applied<'_, R>,
        contacts: &Contacts<R>,
        y: &States<R>,
        carried: Carried,
    ) -> Evaluation<R> {
        if const { Self::CALLED } {
            return R::outlined(Evaluate { equations: self, driven, applied, contacts, y, carried });
        }
        evaluated(self, driven, applied, contacts, y, carried)
    }

    /// Adds the velocity jump that an impulse (J_x, J_y, J_theta) makes while both tips stick. It keeps the
    /// constraints: Phi dp = 0 and M dp = J + Phi^T Lambda. The works of the impulse and of the constraint
    /// impulses Lambda are added to the ledger as J (p before + p after) / 2, which is exact.
    #[inline(always)]
    fn jump(&self, input: &Input<R>, y: &mut States<R>, impulse: &[R; 3], carried: Carried) {
        let driven = self.plant().driven;
        let mut motion = self.unpack(driven, input, y);
        let geometry = self.geometry(&mut motion);
        let (plant, p, zero) = (self.plant(), motion.p, R::zero());
        let force = Coordinates { object: *impulse, ..Coordinates::zero() };
        let Response { multipliers: constraint_impulse, acceleration: change, .. } =
            constrained(driven, &geometry, plant, &force, &[zero; 4], &[zero; 2]);
        let jump = self.begin(driven, &Motion { p: change, ..Motion::zero() });
        let degrees = self.degrees(driven);
        for n in degrees..2 * degrees {
            y[n] = y[n] + jump[n];
        }
        if carried.ledger {
            let half = R::constant(0.5);
            let mean = each_coordinate!([change, p] => half.mul_add(change, p));
            let works = &mut y[self.states(driven)..];
            works[work::EXTERNAL] = works[work::EXTERNAL] + dot(impulse, &mean.object);
            if driven {
                let driving = plant.driving_work(&geometry, &constraint_impulse, &p);
                works[work::CONTROL] = works[work::CONTROL] + driving;
            }
            if self.drifts() {
                let drift = geometry.phi_times(&mean);
                works[work::CONSTRAINT] = works[work::CONSTRAINT]
                    + (constraint_impulse[0].dot2(drift[0], constraint_impulse[1], drift[1])
                        + constraint_impulse[2].dot2(drift[2], constraint_impulse[3], drift[3]));
            }
        }
    }

    inlined! {
        energies(&self, contacts: &Contacts<R>, motion: &Motion<R>) -> Energies<R> =
            R::outlined(EnergiesOf { equations: self, contacts, motion });
    }
}

/// Gives free tips the tilt at which they froze.
#[inline(always)]
fn freeze<R: Real>(contacts: &Contacts<R>, tips: &mut [[R; 4]; 2]) {
    for i in 0..2 {
        let (free, [sin_tilt, cos_tilt, ..]) = (contacts.free[i], &mut tips[i]);
        let (sin, cos) = contacts.frozen_tilt[i].sin_cos();
        (*sin_tilt, *cos_tilt) = (R::select(free, sin, *sin_tilt), R::select(free, cos, *cos_tilt));
    }
}

task! {
    /// Computes the energies of a motion. The elastic energy of a free tip is that at its frozen tilt.
    ['a, R: Real, E: Equations<R>]
    EnergiesOf<'a, R, E>(equations: &'a E, contacts: &'a Contacts<R>, motion: &'a Motion<R>)
    for R => Energies<R> = {
        let (plant, Motion { q, p, .. }) = (equations.plant(), motion);
        let mut tips = plant.tips_at::<E::Parts>(q);
        if equations.friction().is_some() && contacts.free[0] | contacts.free[1] != 0 {
            freeze(contacts, &mut tips);
        }
        let mut energies = plant.energies::<E::Parts>(tips, q, p);
        if let Some([right, left]) = plant.relaxing::<E::Parts>(motion, true) {
            energies.elastic = (energies.elastic + right.stored) + left.stored;
        }
        energies
    }
}

task! {
    ['a, R: Real, E: Equations<R>]
    Evaluate<'a, R, E>(equations: &'a E, driven: bool, applied: Applied<'a, R>, contacts: &'a Contacts<R>,
        y: &'a States<R>, carried: Carried)
    for R => Evaluation<R> = evaluated(equations, driven, applied, contacts, y, carried)
}

/// Derivative and multipliers of a state, by the equations' own terms.
#[inline(always)]
pub(super) fn evaluated<R: Real, E: Equations<R>>(
    equations: &E,
    driven: bool,
    (input, moving): Applied<'_, R>,
    contacts: &Contacts<R>,
    y: &States<R>,
    carried: Carried,
) -> Evaluation<R> {
    let mut motion = equations.unpack(driven, input, y);
    let geometry = equations.geometry(&mut motion);
    let solved = equations.solved(driven, (input, moving), contacts, &motion, &geometry);
    let Response { multipliers, share, acceleration, .. } = solved.response;
    let memory = equations.plant().memory_rates(&motion.q, input);
    let relaxation = equations.plant().relaxation_rates::<E::Parts>(&motion);
    let mut rate = equations.begin(driven, &Motion { q: motion.p, p: acceleration, memory, relaxation });
    if carried.ledger {
        let powers = equations.powers((&geometry, &solved), contacts, &motion);
        for_fingers!(driven, driven => {
            let states = equations.states(driven);
            rate[states..states + equations.works()].copy_from_slice(&powers[..equations.works()]);
            if let Some(moving) = moving {
                let (fingers, turns) = (&solved.forces.finger_gravity, &motion.p.finger);
                let [x, y] = moving.outside;
                rate[states + work::EXTERNAL] = dot(&[x, y, input.force[2]], &motion.p.object);
                rate[states + equations.works()] = dot(&moving.object, &motion.p.object)
                    + fingers[0].dot2(turns[0], fingers[1], turns[1]);
            }
        });
    }
    if equations.opens() && carried.slips {
        let mut speed = R::zero();
        for i in 0..2 {
            let v = geometry.residuals()[2 + i];
            let size = R::select(v.less(R::zero()), -v, v);
            speed = speed + R::select(contacts.slip(i) | contacts.graze[i], size, R::zero());
        }
        for_fingers!(driven, driven => {
            // Places are constants, so that the rates need not be in memory: they would be copied there as a whole.
            let (states, works) = (equations.states(driven), equations.works());
            match (carried.ledger, equations.plant().moves) {
                (false, _) => rate[states] = speed,
                (true, false) => rate[states + works] = speed,
                (true, true) => rate[states + works + 1] = speed,
            }
        });
    }
    let torque = solved.forces.torque;
    Evaluation { rate, torque, ..Evaluation::of_contacts(&motion, &multipliers, &geometry, share) }
}
