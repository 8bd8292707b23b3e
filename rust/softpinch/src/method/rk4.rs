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

use crate::formulation::{
    BLOCK, EquationKind, Inlined, MAX_COMPONENTS, SceneEquations, StageState, States, System,
};
use crate::method::called::TakeStep;
use crate::method::{Called, Integrator, MethodEntry, Stats, Step, StepResult};
use crate::model::Plant;
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
    alone: |_, _| Box::new(Called(Rk4::default())),
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
        let &Step { system, drive, tau, h, y, rate: k1, .. } = step;
        let [k2, k3, k4] = &mut self.slopes;
        stats.evaluations += 3;
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
        Ok(())
    }
}

/// The method in lanes: the equations of undisturbed bilateral contact are inlined into its stages.
pub struct Rk4InLanes<R>(pub Rk4<R>);

impl<R: Lanes> Integrator<R, SceneEquations<R>> for Rk4InLanes<R> {
    #[inline(always)]
    fn step(&mut self, step: &Step<'_, R>, next: &mut States<R>, stats: &mut Stats) -> StepResult {
        let &Step { system: called, drive, tau, h, y, rate, allowed } = step;
        let (method, inlines) =
            (&mut self.0, |plant: &Plant<R>| !(called.carried.ledger || plant.driven || plant.moves));
        match &called.kind {
            EquationKind::Csm(equations) if inlines(&equations.plant) => {
                let system = &Inlined::<_, _, false> { equations, called };
                let step = &Step { system, drive, tau, h, y, rate, allowed };
                R::outlined(TakeStep { method, step, next, stats })
            }
            EquationKind::Nullspace(equations) if inlines(&equations.plant) => {
                let system = &Inlined::<_, _, false> { equations, called };
                let step = &Step { system, drive, tau, h, y, rate, allowed };
                R::outlined(TakeStep { method, step, next, stats })
            }
            _ => method.step(step, next, stats),
        }
    }
}
