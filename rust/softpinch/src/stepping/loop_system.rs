//! The equations as the step loops use them.

use crate::formulation::equations::Equations;
use crate::formulation::inlined::Inlined;
use crate::formulation::scene_equations::SceneEquations;
use crate::formulation::system::System;
use crate::method::traits::Runs;
use crate::number::lanes::Lanes;

/// Equations for a step loop. The loop of RK4 has them inlined; its rare work calls them, so that its code exists once.
pub trait LoopSystem<R: Lanes>: System<R> {
    /// The same equations, called.
    fn called(&self) -> &SceneEquations<R>;

    /// Renews the equations after some of the runs have changed.
    fn renew(&mut self, runs: Runs<'_>);
}

impl<R: Lanes> LoopSystem<R> for SceneEquations<R> {
    #[inline(always)]
    fn called(&self) -> &SceneEquations<R> {
        self
    }

    #[inline(always)]
    fn renew(&mut self, runs: Runs<'_>) {
        *self = runs.system();
    }
}

impl<E: Equations<f64>, const DRIVEN: bool> LoopSystem<f64> for Inlined<'_, f64, E, DRIVEN> {
    #[inline(always)]
    fn called(&self) -> &SceneEquations<f64> {
        self.called
    }

    /// The equations are those of a single run, whose loop has no other one.
    #[inline(always)]
    fn renew(&mut self, _: Runs<'_>) {}
}
