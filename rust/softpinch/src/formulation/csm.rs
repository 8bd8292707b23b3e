//! The constraint stabilisation method (19, 20, 24). Its states are nine coordinates, nine velocities and two
//! controller memories; with driven fingers they are seven coordinates and seven velocities.
//!
//! (24) is solved for the accelerations, with gamma in place of Phi-dot p (`constrained.rs`).

use crate::formulation::equations::{Equations, MAX_COMPONENTS, States};
use crate::model::control::Controller;
use crate::model::drive::Input;
use crate::model::forces::Plant;
use crate::model::geometry::Geometry;
use crate::model::geometry::index::{D_N, FINGER};
use crate::model::motion::Motion;
use crate::model::parameters::Stabilization;
use crate::number::real::Real;

/// Degrees of freedom: the number of coordinates that the equations integrate.
pub const DEGREES: usize = 9;
/// States without the ledger: q, p and two memories.
pub const STATES: usize = 20;
/// Degrees of freedom with driven fingers.
pub const DRIVEN_DEGREES: usize = 7;
/// States with driven fingers: q and p without the angles and the rates of the fingers.
pub const DRIVEN_STATES: usize = 14;

/// The equations of the constraint stabilisation method.
#[derive(Debug, Clone, Copy)]
pub struct Csm<R, K> {
    pub(crate) plant: Plant<R, K>,
    two_alpha: R,
    alpha_squared: R,
    beta: R,
}

impl<R: Real, K: Controller<R>> Csm<R, K> {
    /// The formulation of a scene with the gains of (19) and (20).
    #[inline(always)]
    pub fn new(plant: Plant<R, K>, stabilization: &Stabilization) -> Self {
        let Stabilization { alpha, beta } = *stabilization;
        Self {
            plant,
            two_alpha: R::constant(2.0 * alpha),
            alpha_squared: R::constant(alpha * alpha),
            beta: R::constant(beta),
        }
    }

    /// gamma of (22) and (23).
    #[inline(always)]
    fn gamma(&self, geometry: &Geometry<R>) -> [R; 4] {
        let [c1, c2, c3, c4] = geometry.residuals();
        let [v1, v2, _, _] = geometry.constraint_velocity();
        let [b1, b2, b3, b4] = geometry.bias();
        [
            self.alpha_squared.mul_add(c1, self.two_alpha.mul_add(v1, b1)),
            self.alpha_squared.mul_add(c2, self.two_alpha.mul_add(v2, b2)),
            self.beta.mul_add(c3, b3),
            self.beta.mul_add(c4, b4),
        ]
    }
}

impl<R: Real, K: Controller<R>> Equations<R> for Csm<R, K> {
    type Fingers = K;
    const STATES: usize = if K::ANGLE_IS_STATE { STATES } else { DRIVEN_STATES };
    const DEGREES: usize = if K::ANGLE_IS_STATE { DEGREES } else { DRIVEN_DEGREES };

    #[inline(always)]
    fn plant(&self) -> &Plant<R, K> {
        &self.plant
    }

    #[inline(always)]
    fn begin(&self, motion: &Motion<R>) -> States<R> {
        pack::<R, K>(&motion.q, &motion.p, &motion.memory)
    }

    #[inline(always)]
    fn motion(&self, input: &Input<R>, y: &States<R>) -> (Motion<R>, Geometry<R>) {
        let motion = unpack::<R, K>(input, y);
        (motion, Geometry::new(&self.plant.sides, &motion.q, &motion.p))
    }

    #[inline(always)]
    fn bias(&self, geometry: &Geometry<R>) -> [R; 4] {
        self.gamma(geometry)
    }
}

/// Packs q and p, or their rates, and the controllers' memories into a state. Driven fingers are not part of
/// the state, because the schedule prescribes them.
#[inline(always)]
pub fn pack<R: Real, K: Controller<R>>(q: &[R; 9], p: &[R; 9], memory: &[R; 2]) -> States<R> {
    let mut y = [R::zero(); MAX_COMPONENTS];
    if K::ANGLE_IS_STATE {
        y[..9].copy_from_slice(q);
        y[9..18].copy_from_slice(p);
        y[18..20].copy_from_slice(memory);
    } else {
        for (nine, first) in [(q, 0), (p, DRIVEN_DEGREES)] {
            y[first..first + 3].copy_from_slice(&nine[..FINGER]);
            y[first + 3..first + 7].copy_from_slice(&nine[D_N..]);
        }
    }
    y
}

/// Unpacks q, p and the controllers' memories from a state. Driven fingers are taken from the input.
#[inline(always)]
pub fn unpack<R: Real, K: Controller<R>>(input: &Input<R>, y: &States<R>) -> Motion<R> {
    let (mut q, mut p) = ([R::zero(); 9], [R::zero(); 9]);
    if K::ANGLE_IS_STATE {
        q.copy_from_slice(&y[..9]);
        p.copy_from_slice(&y[9..18]);
        return Motion { q, p, memory: [y[18], y[19]] };
    }
    q[FINGER..D_N].copy_from_slice(&input.target);
    p[FINGER..D_N].copy_from_slice(&input.target_rate);
    for (nine, first) in [(&mut q, 0), (&mut p, DRIVEN_DEGREES)] {
        nine[..FINGER].copy_from_slice(&y[first..first + 3]);
        nine[D_N..].copy_from_slice(&y[first + 3..first + 7]);
    }
    Motion { q, p, memory: [R::zero(); 2] }
}
