//! The forces of (24), and the constants of a scene that all formulations share.

use crate::model::contact::Side;
use crate::model::contact::law::{self, Tip};
use crate::model::control::Controller;
use crate::model::{
    BILATERAL_WORKS, Coordinates, ElasticGradient, Energies, Fingers, FrameLoads, FrameMotion, Geometry,
    Input, MechanismKind, Motion, Parts, RELAXATIONS, Relaxing, Source, each_coordinate,
};
use crate::number::{LaneTask, Real, dot, signed, task};

/// The physics of a scene in the form that the kernel needs: lengths, stiffnesses, masses and controllers.
#[derive(Debug, Clone, Copy)]
pub struct Plant<R> {
    pub sides: [Side<R>; 2],
    pub tips: [Tip<R>; 2],
    /// The diagonal of the mass matrix (14).
    pub masses: Coordinates<R>,
    /// The inverse masses. Those of driven fingers are zero: no force moves these fingers away from the
    /// schedule.
    pub inverse_masses: Coordinates<R>,
    /// One over the mass that driven fingers push along the object's normal, and one over the mass that they
    /// push along its faces: the object's mass with the normal masses, or with the tangential masses, of both
    /// tips.
    pub inverse_driven_masses: [R; 2],
    pub controllers: [Controller<R>; 2],
    /// f and v of the joints' dry friction, if one has it.
    joints: Option<[[R; 2]; 2]>,
    /// Whether the fingers follow the schedule, whatever torque that takes.
    ///
    /// What follows from it is also a parameter of the functions below and of the formulations. A caller that
    /// passes a constant has the code for these fingers alone.
    pub driven: bool,
    /// Weight M g of the object; zero if the hand moves, because then the forces of its motion include gravity.
    weight: R,
    /// Gravity's torques on the fingers, as [`FrameLoads::fingers`] has forces; zero if the hand moves.
    finger_weights: [[R; 3]; 2],
    /// For a hand that moves: g, and M_i, L_i and W_i of both fingers.
    gravity: R,
    links: [[R; 3]; 2],
    pub moves: bool,
    pub branches: usize,
}

/// The inputs of an instant, and the forces of the hand's motion, if it moves. They then include weights and the external
/// force. A caller that passes the constant `None` has the code for a hand at rest alone.
pub type Applied<'a, R> = (&'a Input<R>, Option<&'a FrameLoads<R>>);

/// The applied forces at a state, sorted by their origin.
#[derive(Debug, Clone, Copy)]
pub struct Forces<R> {
    /// Gradients of (5); the force is their negative.
    pub elastic: [ElasticGradient<R>; 2],
    /// Gravity's torque on the fingers (43), or that of the hand's motion.
    pub finger_gravity: [R; 2],
    pub weight: R,
    /// Elastic and viscous (44), (45) forces on (d_n1, d_n2, d_t1, d_t2), with reversed signs.
    pub resistance: [R; 4],
    /// The torques on the fingers, from the controllers (39). For driven fingers they are zero until the
    /// formulation has found the multipliers and sets them to [`Plant::driving_torque`].
    pub torque: [R; 2],
    /// The dry friction of the joints; -0.0, which changes no bit of a sum, without it.
    pub friction: [R; 2],
    pub external: [R; 3],
}

task! {
    ['a, R: Real, S: Source<R>] Compile<'a, S>(source: &'a S, fingers: Fingers, moves: bool) for R => Plant<R> =
        Plant::new(source, fingers, moves)
}

impl<R: Real> Plant<R> {
    /// [`Plant::new`] in code that is called.
    #[inline(always)]
    pub fn called(source: &impl Source<R>, fingers: Fingers, moves: bool) -> Self {
        R::outlined(Compile { source, fingers, moves })
    }

    /// Compiles the parameters of a scene whose fingers move in this way, and whose hand may move.
    #[inline(always)]
    pub fn new(source: &impl Source<R>, fingers: Fingers, moves: bool) -> Self {
        let one = R::constant(1.0);
        let gravity = if moves { R::zero() } else { source.number(|p| p.surroundings.gravity) };
        let object = source.number(|p| p.grasped.mass);
        let mut masses = Coordinates::zero();
        masses.object = [object, object, source.number(|p| p.grasped.inertia)];
        // -0.0 changes no bit of a sum.
        let (mut finger_weights, mut links) = ([[R::constant(-0.0); 3]; 2], [[R::zero(); 3]; 2]);
        for i in 0..2 {
            masses.finger[i] = source.number(|p| p.fingers[i].inertia);
            masses.compression[i] = source.number(|p| p.tips[i].normal_mass);
            masses.shear[i] = source.number(|p| p.tips[i].tangential_mass);
            let mass = source.number(|p| p.fingers[i].mass);
            let (length, root_offset) =
                (source.number(|p| p.fingers[i].length), source.number(|p| p.fingers[i].root_offset));
            links[i] = [mass, length, root_offset];
            if R::ANY_PARTS && source.kinds().mechanism(i) == MechanismKind::Jaw {
                masses.finger[i] = mass;
                let sin = source.number(|p| p.mechanisms[i].direction).sin_cos().0;
                finger_weights[i][2] = -(mass * gravity) * sin;
            } else {
                finger_weights[i][0] = (mass * gravity) * length;
            }
        }
        let mut joints = None;
        if R::ANY_PARTS && source.kinds().mechanisms.iter().any(|own| own.rubs != 0.0) {
            let most = [0, 1].map(|i| source.number(|p| p.mechanisms[i].joint_friction));
            let creep = [0, 1].map(|i| source.number(|p| p.mechanisms[i].creep_rate));
            joints = Some([[most[0], creep[0]], [most[1], creep[1]]]);
        }
        let mut inverse_masses = each_coordinate!([masses] => one / masses);
        let driven = fingers == Fingers::Driven;
        if driven {
            inverse_masses.finger = [R::zero(); 2];
        }
        let along = source.number(|p| p.grasped.mass + (p.tips[0].normal_mass + p.tips[1].normal_mass));
        let across =
            source.number(|p| p.grasped.mass + (p.tips[0].tangential_mass + p.tips[1].tangential_mass));
        Self {
            sides: Side::both(source),
            tips: [Tip::new(source, 0), Tip::new(source, 1)],
            masses,
            inverse_masses,
            inverse_driven_masses: [one / along, one / across],
            controllers: [Controller::new(source, 0, fingers), Controller::new(source, 1, fingers)],
            joints,
            driven,
            weight: object * gravity,
            finger_weights,
            gravity: source.number(|p| p.surroundings.gravity),
            links,
            moves,
            branches: source.kinds().branches(),
        }
    }

    /// The gradients of the elastic energies of tips ([`Geometry::tips`]).
    #[inline(always)]
    pub fn elastic(&self, tips: [[R; 4]; 2]) -> [ElasticGradient<R>; 2] {
        law::gradients(&self.tips, tips)
    }

    /// The forces of a motion for these gradients of (5), with the inputs of the instant. `driven` leaves the torques out.
    #[inline(always)]
    pub fn forces(
        &self,
        driven: bool,
        elastic: [ElasticGradient<R>; 2],
        geometry: &Geometry<R, impl Parts>,
        motion: &Motion<R>,
        applied: Applied<'_, R>,
    ) -> Forces<R> {
        // References, so that choosing them costs no instructions.
        let (input, moving) = applied;
        let (force, fingers) = match moving {
            None => (&input.force, &self.finger_weights),
            Some(moving) => (&moving.force, &moving.fingers),
        };
        // The other factors of links at rest are -0.0, which changes no bit of a sum.
        let kinds = (driven, moving.is_none() && R::ORDER == 0 && geometry.is_the_papers());
        let right = self.side_forces(kinds, 0, &elastic[0], geometry, motion, (input, fingers));
        let left = self.side_forces(kinds, 1, &elastic[1], geometry, motion, (input, fingers));
        Forces {
            elastic,
            finger_gravity: [right.0, left.0],
            weight: self.weight,
            resistance: [right.1, left.1, right.2, left.2],
            torque: [right.3, left.3],
            friction: if geometry.is_the_papers() { [R::constant(-0.0); 2] } else { self.rubbing(&motion.p) },
            external: *force,
        }
    }

    /// The dry friction of the joints, -f z-dot / sqrt(z-dot^2 + v^2): Coulomb's law with the square root of Wriggers,
    /// "Computational Contact Mechanics" (2006), in place of its step at z-dot = 0.
    #[inline(always)]
    fn rubbing(&self, p: &Coordinates<R>) -> [R; 2] {
        let mut friction = [R::constant(-0.0); 2];
        if let Some(joints) = &self.joints {
            for i in 0..2 {
                let ([most, creep], rate) = (joints[i], p.finger[i]);
                friction[i] = -(most * (rate / rate.dot2(rate, creep, creep).sqrt()));
            }
        }
        friction
    }

    /// Gravity's torque on a finger, the resistances of d_n and d_t, and the controller's torque. In a loop over both sides
    /// the Jacobian in lanes would take 14 % more instructions.
    #[inline(always)]
    fn side_forces(
        &self,
        (driven, at_rest): (bool, bool),
        i: usize,
        elastic: &ElasticGradient<R>,
        geometry: &Geometry<R, impl Parts>,
        Motion { q, p, memory, .. }: &Motion<R>,
        (input, fingers): (&Input<R>, &[[R; 3]; 2]),
    ) -> (R, R, R, R) {
        let (tip, control, contact) = (&self.tips[i], &self.controllers[i], &geometry.contacts[i]);
        let [sin, cos, constant] = fingers[i];
        let torque = if driven {
            R::zero()
        } else {
            control.torque(q.finger[i], p.finger[i], memory[i], input.target[i])
        };
        let gravity = if at_rest {
            sin * contact.sin_finger
        } else {
            sin.mul_add(contact.sin_finger, cos.mul_add(contact.cos_finger, constant))
        };
        (
            gravity,
            tip.normal_viscosity.mul_add(p.compression[i], elastic.normal),
            tip.tangential_viscosity.mul_add(p.shear[i], elastic.tangential),
            torque,
        )
    }

    /// The viscous forces (44), (45) on (d_n1, d_n2, d_t1, d_t2), with reversed signs.
    #[inline(always)]
    pub fn drags(&self, p: &Coordinates<R>) -> [R; 4] {
        let [right, left] = &self.tips;
        [
            right.normal_viscosity * p.compression[0],
            left.normal_viscosity * p.compression[1],
            right.tangential_viscosity * p.shear[0],
            left.tangential_viscosity * p.shear[1],
        ]
    }

    /// [`Geometry::tips`] at coordinates.
    #[inline(always)]
    pub fn tips_at<P: Parts>(&self, q: &Coordinates<R>) -> [[R; 4]; 2] {
        let mut tips = [[R::zero(); 4]; 2];
        for i in 0..2 {
            let (_, sin_tilt, cos_tilt) = self.sides[i].tilt::<P>(i, q);
            tips[i] = [sin_tilt, cos_tilt, q.compression[i], q.shear[i]];
        }
        tips
    }

    /// The energies at (q, p): (5) of these tips, (16) and p M p / 2.
    #[inline(always)]
    pub fn energies<P: Parts>(
        &self,
        tips: [[R; 4]; 2],
        q: &Coordinates<R>,
        p: &Coordinates<R>,
    ) -> Energies<R> {
        let mut doubled = R::zero();
        for (&mass, &rate) in self.masses.row().iter().zip(&p.row()) {
            doubled = (mass * rate).mul_add(rate, doubled);
        }
        let mut gravity = self.weight * q.object[1];
        for i in 0..2 {
            gravity = match self.sides[i].jaw() {
                Some(_) if !P::PAPERS => self.finger_weights[i][2].neg_mul_add(q.finger[i], gravity),
                _ => self.finger_weights[i][0].mul_add(q.finger[i].sin_cos().1, gravity),
            };
        }
        let [right, left] = law::energies(&self.tips, tips);
        Energies { kinetic: R::constant(0.5) * doubled, elastic: right + left, gravity }
    }

    /// The effects of the Maxwell branches of both tips; `None` if there are no branches. `ledger` says whether the energy
    /// and the loss are needed.
    #[inline(always)]
    pub fn relaxing<P: Parts>(&self, motion: &Motion<R>, ledger: bool) -> Option<[Relaxing<R>; 2]> {
        if P::PAPERS || self.branches == 0 {
            return None;
        }
        let [right, left] = &self.tips;
        Some([right.relaxing(0, motion, ledger), left.relaxing(1, motion, ledger)])
    }

    #[inline(always)]
    pub fn relaxation_rates<P: Parts>(&self, motion: &Motion<R>) -> [R; RELAXATIONS] {
        let mut rates = [R::zero(); RELAXATIONS];
        if let Some([right, left]) = self.relaxing::<P>(motion, false) {
            for k in 0..RELAXATIONS {
                rates[k] = if k % 2 == 0 { right.rates[k] } else { left.rates[k] };
            }
        }
        rates
    }

    #[inline(always)]
    pub fn memory_rates(&self, q: &Coordinates<R>, input: &Input<R>) -> [R; 2] {
        [
            self.controllers[0].memory_rate(q.finger[0], input.target[0]),
            self.controllers[1].memory_rate(q.finger[1], input.target[1]),
        ]
    }

    /// The work of the torques that hold driven fingers at their speed during an impulse.
    /// `constraint_impulse` has the impulses of the constraints, in the order of the multipliers.
    #[inline(always)]
    pub fn driving_work(
        &self,
        geometry: &Geometry<R, impl Parts>,
        constraint_impulse: &[R; 4],
        p: &Coordinates<R>,
    ) -> R {
        let [right, left] = &geometry.contacts;
        let [h1, h2, n1, n2] = *constraint_impulse;
        -right.torque([h1, n1]).dot2(p.finger[0], left.torque([h2, n2]), p.finger[1])
    }

    /// The torques that driven fingers need: I_i theta_i-dotdot, less the share of the multipliers and of the
    /// other forces.
    #[inline(always)]
    pub fn driving_torque(
        &self,
        geometry: &Geometry<R, impl Parts>,
        forces: &Forces<R>,
        acceleration: &[R; 2],
        multipliers: &[R; 4],
    ) -> [R; 2] {
        let [right, left] = &geometry.contacts;
        let [h1, h2, n1, n2] = *multipliers;
        let mut couples = geometry.couples([forces.elastic[0].tilt, forces.elastic[1].tilt]).1;
        if !geometry.is_the_papers() {
            couples = [couples[0] + forces.friction[0], couples[1] + forces.friction[1]];
        }
        let others = [
            (forces.finger_gravity[0] + couples[0]) + right.torque([h1, n1]),
            (forces.finger_gravity[1] + couples[1]) + left.torque([h2, n2]),
        ];
        [
            self.masses.finger[0].mul_add(acceleration[0], -others[0]),
            self.masses.finger[1].mul_add(acceleration[1], -others[1]),
        ]
    }

    /// The forces of the frame's motion, (M1) to (M4) of `frame.rs`, with `force` along fixed axes on the object added, for
    /// the object's coordinates (x, y, theta) and their rates, on which they depend only while the frame turns.
    #[inline(always)]
    pub fn loads(&self, frame: &FrameMotion<R>, force: &[R; 3], q: [R; 3], p: [R; 3]) -> FrameLoads<R> {
        let ([x, y, _], [u, v, _], [mass, _, inertia]) = (q, p, self.masses.object);
        let [ax, ay] = frame.felt(self.gravity);
        let (mut along, mut across, mut moment) = (ax, ay, R::zero());
        let mut fingers = [[R::zero(); 3]; 2];
        for (i, [sin, cos, constant]) in fingers.iter_mut().enumerate() {
            let [mass, length, root_offset] = self.links[i];
            if let Some(jaw) = self.sides[i].jaw() {
                (*sin, *constant) = jaw.drawn(i, mass, [ax, ay], frame.turning);
                continue;
            }
            // In the order of the weights' products, so that an acceleration upwards has the bits of a gravity.
            (*sin, *cos) = (mass * ay * length, -signed(i, mass * ax * length));
            if let Some([omega, omega_rate]) = frame.turning {
                let (lever, turned) = ((mass * root_offset) * length, signed(i, omega_rate));
                (*sin, *cos) = (turned.neg_mul_add(lever, *sin), (omega * omega).neg_mul_add(lever, *cos));
                *constant = turned * self.masses.finger[i];
            }
        }
        if let Some([omega, omega_rate]) = frame.turning {
            let (square, twice) = (omega * omega, omega + omega);
            along = along - omega_rate.dot2(y, twice, v) - square * x;
            across = across + omega_rate.dot2(x, twice, u) - square * y;
            moment = -(inertia * omega_rate);
        }
        let object = [-(mass * along), -(mass * across), moment];
        let [x, y] = frame.in_hand_axes([force[0], force[1]]);
        FrameLoads {
            force: [x + object[0], y + object[1], force[2] + object[2]],
            fingers,
            object,
            outside: [x, y],
        }
    }
}

impl<R: Real> Forces<R> {
    #[inline(always)]
    pub fn total(&self, geometry: &Geometry<R, impl Parts>) -> Coordinates<R> {
        let ([right, left], [mut x, mut y, moment]) = (&self.elastic, self.external);
        let (object, mut finger) = geometry.couples([right.tilt, left.tilt]);
        if !geometry.is_the_papers() {
            (x, y) = (x + object[0], y + object[1]);
            finger = [finger[0] + self.friction[0], finger[1] + self.friction[1]];
        }
        let [normal1, normal2, tangential1, tangential2] = self.resistance;
        Coordinates {
            object: [x, y - self.weight, moment + object[2]],
            finger: [
                (self.torque[0] + self.finger_gravity[0]) + finger[0],
                (self.torque[1] + self.finger_gravity[1]) + finger[1],
            ],
            compression: [-normal1, -normal2],
            shear: [-tangential1, -tangential2],
        }
    }

    /// The powers whose integrals are the works of the ledger: of the torques, of the external forces, of the
    /// losses of tips (from `drags`) and joints, and of the stabilisation.
    #[inline(always)]
    pub fn powers(
        &self,
        geometry: &Geometry<R, impl Parts>,
        drags: &[R; 4],
        p: &Coordinates<R>,
        multipliers: &[R; 4],
    ) -> [R; BILATERAL_WORKS] {
        let drift = geometry.constraint_velocity();
        let external = dot(&self.external, &p.object);
        let normal = drags[0].dot2(p.compression[0], drags[1], p.compression[1]);
        let tangential = drags[2].dot2(p.shear[0], drags[3], p.shear[1]);
        let mut lost = normal + tangential;
        if !geometry.is_the_papers() {
            lost = lost - self.friction[0].dot2(p.finger[0], self.friction[1], p.finger[1]);
        }
        [
            self.torque[0].dot2(p.finger[0], self.torque[1], p.finger[1]),
            external,
            lost,
            multipliers[0].dot2(drift[0], multipliers[1], drift[1])
                + multipliers[2].dot2(drift[2], multipliers[3], drift[3]),
        ]
    }
}
