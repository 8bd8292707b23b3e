//! The classical Runge-Kutta method of order four (Kutta, "Beitrag zur naeherungsweisen Integration totaler
//! Differentialgleichungen", 1901).
//!
//! ```text
//! 0   |
//! 1/2 | 1/2
//! 1/2 | 0   1/2
//! 1   | 0   0   1
//!     | 1/6 1/3 1/3 1/6
//! ```

use crate::formulation::{Build, System};
use crate::inputs::{Drive, SegmentDrive};
use crate::integrator::newton::Unsolved;
use crate::integrator::{InLanes, Integrator, LaneMethod, Stats, Step};
use crate::lanes::{Lanes, MOST};
use crate::parameters::{Parameters, Stabilization};
use crate::real::Real;

/// |R(z)| = |1 + z + z^2/2 + z^3/6 + z^4/24| <= 1 on the real axis from -2.785... to 0 (Hairer and Wanner,
/// "Solving Ordinary Differential Equations II", IV.2).
pub const REAL_STABILITY_LIMIT: f64 = 2.785_293_563_405_28;

/// Evaluations in a step beside the one at its start.
const EVALUATIONS: u64 = 3;

/// The method.
#[derive(Debug, Clone, Copy)]
pub struct Rk4;

#[inline(always)]
fn advance<R: Real, const N: usize>(y: &[R; N], h: R, k: &[R; N]) -> [R; N] {
    let mut next = *y;
    for n in 0..N {
        next[n] = k[n].mul_add(h, y[n]);
    }
    next
}

/// One step of length `h` from `y`, which is at time `tau` of its segment and has the derivative `k1`.
#[inline(always)]
pub fn step<R: Real, const N: usize, S: System<R, N>, D: Drive<R>>(
    system: &S,
    drive: &D,
    tau: R,
    h: R,
    y: &[R; N],
    k1: &[R; N],
) -> [R; N] {
    let half = R::constant(0.5) * h;
    let sixth = R::constant(1.0 / 6.0) * h;
    let third = R::constant(1.0 / 3.0) * h;
    let middle = drive.at(tau + half);
    let k2 = system.evaluate(&middle, &advance(y, half, k1)).rate;
    let k3 = system.evaluate(&middle, &advance(y, half, &k2)).rate;
    let k4 = system.evaluate(&drive.at(tau + h), &advance(y, h, &k3)).rate;
    let mut next = *y;
    for n in 0..N {
        // Small to large: the increment first, then the state.
        let outer = sixth * (k1[n] + k4[n]);
        next[n] = y[n] + third.mul_add(k2[n] + k3[n], outer);
    }
    next
}

impl<B: Build<N>, R: Lanes, const N: usize> LaneMethod<B, R, N> for Rk4 {
    #[inline(always)]
    fn new(_: &[Parameters; MOST], _: &Stabilization) -> Self {
        Self
    }

    #[inline(always)]
    fn step(
        &mut self,
        system: &B::Built<R>,
        drive: &SegmentDrive<R>,
        tau: R,
        h: R,
        y: &[R; N],
        rate: &[R; N],
    ) -> [R; N] {
        step(system, drive, tau, h, y, rate)
    }
}

impl<B: Build<N>, const N: usize> InLanes<B, N> for Rk4 {
    type Method<R: Lanes> = Self;
}

impl<S: System<f64, N>, const N: usize> Integrator<S, N> for Rk4 {
    #[inline(always)]
    fn step(
        &mut self,
        system: &S,
        drive: &SegmentDrive,
        at: &Step<'_, N>,
        stats: &mut Stats,
    ) -> Result<[f64; N], Unsolved> {
        stats.evaluations += EVALUATIONS;
        Ok(step(system, drive, at.tau, at.h, at.y, at.rate))
    }
}
