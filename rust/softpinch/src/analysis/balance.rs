//! The balance of forces at rest: p = 0, so that f_5 - Phi_5^T f_d = 0 on the null space of Phi
//! (`formulation/constrained.rs`), and lambda = -f_d.
//!
//! The unknowns are the pose (x, y, theta, theta_1, theta_2) and both shears; the compressions follow from
//! C^H = 0 (9). There are seven rows:
//!
//! | rows | equation |
//! |---|---|
//! | 0 to 2 | forces and moment on the object balance |
//! | 3, 4 | the finger is at its target (driven, or with K_I > 0); otherwise its torques balance |
//! | 5, 6 | the member of the family of equilibria: see [`Member`] |
//!
//! C^N (12) restricts only rates, so a grasp rests in a family of states with two parameters. The shears are no
//! coordinates of this family: in an upright symmetric grasp the height of the object changes along it, but the
//! shears do not, because they carry the weight. With (12) as G_i-dot + (a - d_n) theta_p-dot + d_t-dot = 0,
//! sigma_i = G_i + (a - d_n) theta_p + d_t obeys sigma_i-dot = -theta_p d_n-dot. So sigma_i hardly changes
//! while a grasp moves. The tip, turned upright and without shear, would hold the face -sigma_i above the
//! centre of gravity: this height is the grip.

use std::sync::Arc;

use crate::model::{
    Any, Constants, Coordinates, Energies, Fingers, FrameMotion, Geometry, HandMotion, Input, Inputs,
    MechanismKind, Motion, Parameters, Plant, SegmentDrive, ShapeKind, each_coordinate,
};
use crate::number::{Dual, LaneKernel, Lanes, MOST, Real, call_four_lanes, signed};
use crate::stepping::column;

/// Number of unknowns: the pose (x, y, theta, theta_1, theta_2) and two shears.
pub const UNKNOWNS: usize = 7;
/// The unknowns, or the seven rows.
pub type Unknowns<R = f64> = [R; UNKNOWNS];
/// The place of the right finger among the unknowns, the rows and the forces; the left finger is next.
pub(super) const FINGER: usize = 3;

/// A member of the family of equilibria, by two conditions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Member {
    /// The grip of each tip, m above the centre of gravity.
    Grip([f64; 2]),
    /// The shears (d_t1, d_t2), m.
    Shear([f64; 2]),
    /// The no-slip constraint leads from another state to this member.
    From(Balance<f64>),
}

impl Member {
    /// The conditions, which are zero at this member. sigma-dot = -theta_p d_n-dot is integrated by the
    /// trapezoidal rule.
    #[inline(always)]
    fn rows<R: Real>(&self, state: &Balance<R>) -> [R; 2] {
        let mut rows = [R::zero(); 2];
        for i in 0..2 {
            rows[i] = match self {
                Self::Grip(grip) => state.sigma[i] + R::constant(grip[i]),
                Self::Shear(shear) => state.q.shear[i] - R::constant(shear[i]),
                Self::From(from) => {
                    let mean = R::constant(0.5) * (state.tilt[i] + R::constant(from.tilt[i]));
                    let change = state.q.compression[i] - R::constant(from.q.compression[i]);
                    mean.mul_add(change, state.sigma[i] - R::constant(from.sigma[i]))
                }
            };
        }
        rows
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Balance<R> {
    pub q: Coordinates<R>,
    /// theta_p of both tips.
    pub tilt: [R; 2],
    /// sigma of both tips, m: minus the grip.
    pub sigma: [R; 2],
    /// The forces that are left over on the pose, without the torques of the fingers.
    pub forces: [R; 5],
    /// The torques of the fingers' laws, N m; without meaning where a finger is held.
    pub torque: [R; 2],
    pub multipliers: [R; 4],
}

impl<R: Real> Balance<R> {
    #[inline(always)]
    fn new(
        plant: &Plant<R>,
        (input, frame): (&Input<R>, Option<&FrameMotion<R>>),
        z: &Unknowns<R>,
    ) -> (Self, Geometry<R>) {
        let zero = R::zero();
        let mut motion = Motion { q: coordinates(z), ..Motion::zero() };
        let geometry = <Geometry<R>>::constrained(&plant.sides, &mut motion.q, &mut motion.p);
        let q = motion.q;
        let moving = frame.map(|own| plant.loads(own, &input.force, q.object, motion.p.object));
        let applied = (input, moving.as_ref());
        // Driven fingers are held, so that the torques are left out again below.
        let forces = plant.forces(false, plant.elastic(geometry.tips(&q)), &geometry, &motion, applied);
        // At rest the multipliers balance the resistances of the deformations.
        let multipliers = forces.resistance;
        let (applied, carried) = (forces.total(&geometry), geometry.phi_transposed_times(&multipliers));
        let [mut left_over @ .., _, _, _, _] =
            each_coordinate!([applied, carried] => applied + carried).row();
        let (mut tilt, mut sigma) = ([zero; 2], [zero; 2]);
        for i in 0..2 {
            left_over[FINGER + i] = left_over[FINGER + i] - forces.torque[i];
            tilt[i] = geometry.contacts[i].tilt;
            let thickness = plant.sides[i].radius - q.compression[i];
            sigma[i] = thickness.mul_add(tilt[i], signed(i, geometry.contacts[i].place)) + q.shear[i];
        }
        let balance = Self { q, tilt, sigma, forces: left_over, torque: forces.torque, multipliers };
        (balance, geometry)
    }
}

impl<R: Lanes> Balance<Dual<R, 1>> {
    fn values(&self) -> Balance<f64> {
        let q = self.q;
        Balance {
            q: each_coordinate!([q] => q.lane(0)),
            tilt: column(&self.tilt, 0),
            sigma: column(&self.sigma, 0),
            forces: column(&self.forces, 0),
            torque: column(&self.torque, 0),
            multipliers: column(&self.multipliers, 0),
        }
    }
}

/// The coordinates of these unknowns, with compressions of zero.
#[inline(always)]
pub(super) fn coordinates<R: Real>(
    &[x, y, theta, right, left, shear1, shear2]: &Unknowns<R>,
) -> Coordinates<R> {
    let compression = [R::zero(); 2];
    Coordinates { object: [x, y, theta], finger: [right, left], compression, shear: [shear1, shear2] }
}

/// A scene at rest under constant inputs.
#[derive(Debug, Clone, Copy)]
pub struct RestScene {
    pub(super) parameters: Parameters,
    pub(super) fingers: Fingers,
    pub(super) input: Input<f64>,
    /// The motion of the hand's frame, in which the scene is at rest; `None` for a hand at rest.
    pub frame: Option<FrameMotion<f64>>,
    pub(super) plant: Plant<f64>,
}

/// The balance at one set of unknowns, with its derivatives by the unknowns.
#[derive(Debug, Clone, Copy)]
pub struct Rows {
    pub(super) values: Unknowns,
    pub(super) jacobian: [Unknowns; UNKNOWNS],
    pub balance: Balance<f64>,
    pub(super) forces: [Unknowns; 5],
    pub(super) sigma: [Unknowns; 2],
    pub(super) compressions: [Unknowns; 2],
    /// The derivatives of the shears by the pose under the no-slip constraint: minus the last two rows of Phi_5.
    pub no_slip: [[f64; 5]; 2],
}

impl RestScene {
    /// A scene with these inputs, at the start of a segment.
    pub fn new(parameters: &Parameters, fingers: Fingers, drive: &SegmentDrive) -> Self {
        Self {
            fingers,
            input: drive.at(0.0),
            frame: drive.frame.as_ref().map(|frame| frame.at(0.0)),
            plant: Plant::called(parameters, fingers, drive.frame.is_some()),
            parameters: *parameters,
        }
    }

    pub(crate) fn with(&self, parameters: Parameters) -> Self {
        let plant = Plant::called(&parameters, self.fingers, self.frame.is_some());
        Self { parameters, plant, ..*self }
    }

    pub(crate) fn under(&self, input: Input<f64>) -> Self {
        Self { input, ..*self }
    }

    /// The same scene in a hand that moves with this acceleration along fixed axes, in its present tilt.
    pub fn accelerated(&self, acceleration: [f64; 2]) -> Self {
        let (sin, cos) = self.frame.map_or((0.0, 1.0), |frame| (frame.sin, frame.cos));
        let moving = Self { frame: Some(FrameMotion::new(acceleration, (sin, cos), None)), ..*self };
        if self.frame.is_some() { moving } else { moving.with(self.parameters) }
    }

    pub(crate) fn inputs(&self) -> Inputs {
        let Input { target, force, .. } = self.input;
        let motion = self.frame.map(|frame| Arc::new(HandMotion::constant(&frame)));
        Inputs::constant(target, force, self.fingers).with_hand_motion(motion)
    }

    /// Whether each finger rests at its target, whatever torque that takes.
    pub fn held(&self) -> [bool; 2] {
        std::array::from_fn(|i| match self.fingers {
            Fingers::Driven => true,
            Fingers::Pid => self.parameters.control[i].ki > 0.0,
            Fingers::Torque => false,
        })
    }

    /// The torques that hold the fingers, N m.
    pub fn torque(&self, balance: &Balance<f64>) -> [f64; 2] {
        let held = self.held();
        std::array::from_fn(|i| if held[i] { -balance.forces[FINGER + i] } else { balance.torque[i] })
    }

    /// The memories of the controllers with these torques, rad s.
    pub fn memory(&self, balance: &Balance<f64>) -> [f64; 2] {
        let torque = self.torque(balance);
        std::array::from_fn(|i| {
            let ki = self.parameters.control[i].ki;
            if self.fingers == Fingers::Pid && ki > 0.0 { -torque[i] / ki } else { 0.0 }
        })
    }

    /// The energies of a state at rest.
    pub fn energies(&self, balance: &Balance<f64>) -> Energies {
        self.plant.energies::<Any>(self.plant.tips_at::<Any>(&balance.q), &balance.q, &Coordinates::zero())
    }

    /// The stiffness that a finger's law has, N m/rad.
    pub fn torque_slope(&self, finger: usize) -> f64 {
        if self.fingers == Fingers::Pid { self.parameters.control[finger].kp } else { 0.0 }
    }

    /// The balance of these unknowns, from which the no-slip constraint leads to other states. It does not depend on the
    /// member.
    pub fn origin(&self, z: &Unknowns) -> Balance<f64> {
        self.rows(&Member::Shear([0.0; 2]), z).balance
    }

    /// The sizes of unknowns and rows that count as one.
    pub fn scales(&self) -> (Unknowns, Unknowns) {
        let [right, left] = &self.parameters.tips;
        let length = right.radius.max(left.radius);
        let force = self.parameters.modulus(0).max(self.parameters.modulus(1)) * length * length;
        let moment = force * length;
        let (held, unit) = (self.held(), [0, 1].map(|i| self.parameters.finger_size(i, length)));
        let [finger1, finger2] = [0, 1].map(|i| if held[i] { unit[i] } else { moment / unit[i] });
        (
            [length, length, 1.0, unit[0], unit[1], length, length],
            [force, force, moment, finger1, finger2, length, length],
        )
    }

    /// The sizes of the terms whose sums the rows are.
    pub fn terms(&self, balance: &Balance<f64>) -> Unknowns {
        let Parameters { fingers, tips, grasped, surroundings, control, .. } = &self.parameters;
        let [fx, fy, moment] = self.input.force.map(f64::abs);
        let pressing: f64 = balance.multipliers.iter().map(|lambda| lambda.abs()).sum();
        let force = pressing + fx + fy + grasped.mass * surroundings.gravity.abs();
        let mut reach = 0.5 * grasped.width + grasped.com_offset.abs() + tips[0].radius + tips[1].radius;
        for i in 0..2 {
            if self.parameters.shape(i) == ShapeKind::Arc {
                reach += self.parameters.reach(i);
            }
        }
        let finger = |i: usize| {
            let Input { target, .. } = self.input;
            if self.held()[i] {
                return self.parameters.finger_size(i, tips[i].radius) + target[i].abs();
            }
            let lever = self.parameters.lever(i);
            let jaw = self.parameters.mechanism(i) == MechanismKind::Jaw;
            let arm = if jaw { lever } else { lever + tips[i].radius };
            let gain = if self.fingers == Fingers::Torque { 1.0 } else { control[i].kp };
            let weight = fingers[i].mass * surroundings.gravity.abs() * lever;
            pressing * arm + gain * (target[i].abs() + balance.q.finger[i].abs()) + weight
        };
        let place = reach + balance.sigma[0].abs() + balance.sigma[1].abs();
        [force, force, force * reach + moment, finger(0), finger(1), place, place]
    }

    /// Sets the shears among the unknowns to those of a member at their pose.
    pub fn shear_into(&self, member: &Member, z: &mut Unknowns) {
        for i in 0..2 {
            z[5 + i] = 0.0;
        }
        let row = member.rows(&self.origin(z));
        // Each condition is linear in its own shear, with the factor one.
        for i in 0..2 {
            z[5 + i] = -row[i];
        }
    }

    /// The rows of a member and their derivatives.
    pub fn rows(&self, member: &Member, z: &Unknowns) -> Rows {
        call_four_lanes(Evaluate { scene: self, member, z })
    }
}

/// Evaluates the balance in dual numbers, with one direction in each lane.
struct Evaluate<'a> {
    scene: &'a RestScene,
    member: &'a Member,
    z: &'a Unknowns,
}

impl LaneKernel for Evaluate<'_> {
    type Output = Rows;

    #[inline(always)]
    fn run<X: Lanes>(self) -> Rows {
        let Self { scene, member, z } = self;
        let parameters = [&scene.parameters; MOST];
        let plant = Plant::called(&Constants(&parameters), scene.fingers, scene.frame.is_some());
        let (input, frame) =
            (scene.input.map(Dual::constant), scene.frame.map(|own| own.map(Dual::constant)));
        let (held, mut found) = (scene.held(), None);
        for first in (0..UNKNOWNS).step_by(X::WIDTH) {
            let mut unknowns = [Dual::<X, 1>::zero(); UNKNOWNS];
            for k in 0..UNKNOWNS {
                let along = |lane: usize| f64::from(first + lane == k);
                unknowns[k] = Dual { value: X::constant(z[k]), slope: [X::from_fn(along)] };
            }
            let (balance, geometry) = Balance::new(&plant, (&input, frame.as_ref()), &unknowns);
            let mut rows = [Dual::zero(); UNKNOWNS];
            rows[..5].copy_from_slice(&balance.forces);
            for i in 0..2 {
                rows[FINGER + i] = if held[i] {
                    unknowns[FINGER + i] - input.target[i]
                } else {
                    rows[FINGER + i] + balance.torque[i]
                };
            }
            rows[5..].copy_from_slice(&member.rows(&balance));
            let all = found.get_or_insert_with(|| {
                let mut no_slip = [[0.0; 5]; 2];
                for (i, row) in no_slip.iter_mut().enumerate() {
                    let contact = &geometry.contacts[i];
                    let [along, across] = contact.push(i, [Dual::zero(), Dual::constant(1.0)]);
                    let [x, y] = geometry.outward(along, across);
                    *row = [-x.lane(0), -y.lane(0), -contact.e.lane(0), 0.0, 0.0];
                    row[FINGER + i] = -contact.f.lane(0);
                }
                let (jacobian, forces, pair) = ([[0.0; _]; _], [[0.0; _]; _], [[0.0; _]; 2]);
                let (values, balance) = (column(&rows, 0), balance.values());
                Rows { values, jacobian, balance, forces, sigma: pair, compressions: pair, no_slip }
            });
            for (to, from) in [
                (&mut all.jacobian[..], &rows[..]),
                (&mut all.forces, &balance.forces),
                (&mut all.sigma, &balance.sigma),
                (&mut all.compressions, &balance.q.compression),
            ] {
                for (to, from) in to.iter_mut().zip(from) {
                    for k in first..UNKNOWNS.min(first + X::WIDTH) {
                        to[k] = from.slope[0].lane(k - first);
                    }
                }
            }
        }
        found.unwrap_or_else(|| unreachable!("there are unknowns"))
    }
}
