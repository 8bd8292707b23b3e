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

use nalgebra::Complex;

use crate::formulation::{BLOCK, MAX_COMPONENTS, StageState, Stages, States, System};
use crate::method::{Called, Integrator, MethodEntry, Stats, Step, StepResult};
use crate::number::Lanes;

pub const ENTRY: MethodEntry = MethodEntry {
    order: 4,
    // |R(z)| = |1 + z + z^2/2 + z^3/6 + z^4/24| <= 1 (Hairer and Wanner, "Solving Ordinary Differential Equations II", IV.2).
    real_stability_limit: Some(2.785_293_563_405_28),
    stability_function: |z| {
        let one = Complex::new(1.0, 0.0);
        one + z * (one + z / 2.0 * (one + z / 3.0 * (one + z / 4.0)))
    },
    keeps_jacobian: false,
    alone: |_, _| Box::new(Called::new(Rk4::default())),
    adaptive: None,
    error_order: 0.0,
    min_growth: 1.0,
};

pub struct Rk4<R = f64> {
    slopes: [States<R>; 3],
}

impl<R: Lanes> Default for Rk4<R> {
    #[inline(always)]
    fn default() -> Self {
        Self { slopes: [[R::zero(); MAX_COMPONENTS]; 3] }
    }
}

impl<R: Lanes, S: System<R>> Integrator<R, S> for Rk4<R> {
    #[inline(always)]
    fn step(&mut self, step: &Step<'_, R, S>, next: &mut States<R>, stats: &mut Stats) -> StepResult {
        stats.evaluations += 3;
        step.system.evaluate_stages(Rk4Stages { slopes: &mut self.slopes, step, next });
        Ok(())
    }
}

/// The evaluations of a step, and their sum.
struct Rk4Stages<'a, R, S> {
    slopes: &'a mut [States<R>; 3],
    step: &'a Step<'a, R, S>,
    next: &'a mut States<R>,
}

impl<R: Lanes, S: System<R>> Stages<R> for Rk4Stages<'_, R, S> {
    #[inline(always)]
    fn run(self, system: &impl System<R>) {
        let Self { slopes: [k2, k3, k4], step, next } = self;
        let &Step { drive, tau, h, y, rate: k1, .. } = step;
        let half = R::constant(0.5) * h;
        let middle = drive.at(tau + half);
        system.rates(&middle, drive, StageState { from: y, by: half, along: k1 }, k2);
        system.rates(&middle, drive, StageState { from: y, by: half, along: k2 }, k3);
        system.rates(&drive.at(tau + h), drive, StageState { from: y, by: h, along: k3 }, k4);
        let sixth = R::constant(1.0 / 6.0) * h;
        let third = R::constant(1.0 / 3.0) * h;
        // A closure might be compiled without the instructions of the lanes.
        for n in 0..BLOCK * system.size().blocks() {
            // The increment is added up first, then added to the larger state.
            let outer = sixth * (k1[n] + k4[n]);
            next[n] = y[n] + third.mul_add(k2[n] + k3[n], outer);
        }
    }
}
