//! The index-1 equations without stabilisation, and after each step the state put back on the constraints by the
//! smallest correction in the norm of the mass matrix (Lubich, "Extrapolation integrators for constrained multibody systems",
//! 1991; Hairer and Wanner, "Solving Ordinary Differential Equations II", VII.2).
//!
//! Position: q - M^-1 Phi_H^T mu with mu from C^H = 0 by two Newton steps, a fixed number, so that every run does the
//! same work. Velocity: p - M^-1 Phi^T nu with Phi p = 0, one linear solve. What the correction does to the energy is the
//! constraints' work in the ledger.

use std::marker::PhantomData;

use crate::control::{Control, Controller};
use crate::dynamics::Plant;
use crate::energy::Energies;
use crate::formulation::csm::{Csm, constrained_acceleration, pack, unpack};
use crate::formulation::{Build, Evaluation, Motion, System};
use crate::geometry::Geometry;
use crate::geometry::index::{D_N, FINGER, THETA, X};
use crate::inputs::{Input, SegmentDrive};
use crate::lanes::Lanes;
use crate::linear::solve2;
use crate::parameters::{Source, Stabilization};
use crate::real::Real;
use crate::simd::Level;

/// Newton steps of the position's correction. RK4 leaves C^H at 1e-6 m even where it is hardly stable; the second
/// step then ends at round-off.
const NEWTON_STEPS: usize = 2;

/// The system that the integrators step: `csm` without gains, and the correction.
#[derive(Debug, Clone, Copy)]
pub struct Projected<R, K> {
    plant: Plant<R, K>,
    free: Csm<R, K>,
}

impl<R: Real, K: Controller<R>> Projected<R, K> {
    /// The formulation of a scene.
    pub fn new(plant: Plant<R, K>) -> Self {
        Self { plant, free: Csm::new(plant, &Stabilization { alpha: 0.0, beta: 0.0 }) }
    }

    /// q moved by one Newton step towards C^H = 0 along M^-1 Phi_H^T.
    #[inline(always)]
    fn nearer(&self, q: &[R; 9]) -> [R; 9] {
        let geometry = Geometry::new(&self.plant.sides, q, &[R::zero(); 9]);
        let w = &self.plant.inverse_masses;
        let [r, l] = &geometry.contacts;
        let own = |i: usize, a: R, b: R| {
            (b * b).mul_add(w[FINGER + i], (a * a).mul_add(w[THETA], w[X] + w[D_N + i]))
        };
        let matrix = [own(0, r.a, r.b), (r.a * l.a).mul_add(w[THETA], -w[X]), own(1, l.a, l.b)];
        let [h1, h2] = solve2(&matrix, &[r.holonomic, l.holonomic]);
        let push = geometry.phi_transposed_times(&[h1, h2, R::zero(), R::zero()]);
        let mut moved = *q;
        for k in 0..9 {
            moved[k] = push[k].neg_mul_add(w[k], q[k]);
        }
        moved
    }
}

/// Builds [`Projected`].
pub struct ByProjected<C>(PhantomData<C>);

impl<C: Control, const N: usize> Build<N> for ByProjected<C> {
    type Built<R: Real> = Projected<R, C::Of<R>>;
    type Rates<R: Real> = Csm<R, C::Of<R>>;

    #[inline(always)]
    fn build<R: Real>(source: &impl Source<R>, _: &Stabilization) -> Self::Built<R> {
        Projected::new(Plant::new(source))
    }

    #[inline(always)]
    fn rates<R: Real>(source: &impl Source<R>, _: &Stabilization) -> Self::Rates<R> {
        Projected::new(Plant::new(source)).free
    }
}

impl<R: Real, K: Controller<R>, const N: usize> System<R, N> for Projected<R, K> {
    const STATES: usize = <Csm<R, K> as System<R, N>>::STATES;
    const DEGREES: usize = <Csm<R, K> as System<R, N>>::DEGREES;

    #[inline(always)]
    fn begin(&self, motion: &Motion<R>) -> [R; N] {
        self.free.begin(motion)
    }

    #[inline(always)]
    fn evaluate(&self, input: &Input<R>, y: &[R; N]) -> Evaluation<R, N> {
        self.free.evaluate(input, y)
    }

    #[inline(always)]
    fn evaluation(&self, level: Level, drive: &SegmentDrive<R>, tau: R, y: &[R; N]) -> Evaluation<R, N>
    where
        R: Lanes,
    {
        self.free.evaluation(level, drive, tau, y)
    }

    #[inline(always)]
    fn rates(&self, level: Level, drive: &SegmentDrive<R>, tau: R, y: &[R; N]) -> [R; N]
    where
        R: Lanes,
    {
        self.free.rates(level, drive, tau, y)
    }

    #[inline(always)]
    fn energies(&self, motion: &Motion<R>) -> Energies<R> {
        self.plant.energies(&motion.q, &motion.p)
    }

    #[inline(always)]
    fn jump(&self, input: &Input<R>, y: &mut [R; N], impulse: &[R; 3]) {
        self.free.jump(input, y, impulse);
    }

    #[inline(always)]
    fn correct(&self, input: &Input<R>, y: &mut [R; N]) {
        let Motion { q: left_q, p: left_p, memory } = unpack::<R, K, N>(input, y);
        let mut q = left_q;
        for _ in 0..NEWTON_STEPS {
            q = self.nearer(&q);
        }
        let geometry = Geometry::new(&self.plant.sides, &q, &left_p);
        // Phi dp = -Phi p and M dp = Phi^T nu: the solve of (24) without a force.
        let (_, change) = constrained_acceleration(
            &geometry,
            &self.plant.inverse_masses,
            &[R::zero(); 9],
            &geometry.constraint_velocity(),
        );
        let mut p = left_p;
        for k in 0..9 {
            p[k] = left_p[k] + change[k];
        }
        let works = *y;
        *y = pack::<R, K, N>(&q, &p, &memory);
        if <Self as System<R, N>>::LEDGER {
            let (now, before) = (self.plant.energies(&q, &p), self.plant.energies(&left_q, &left_p));
            let gain = (now.kinetic - before.kinetic)
                + ((now.elastic - before.elastic) + (now.gravity - before.gravity));
            let first = <Self as System<R, N>>::STATES;
            y[first..].copy_from_slice(&works[first..]);
            y[first + 3] = y[first + 3] + gain;
        }
    }
}
