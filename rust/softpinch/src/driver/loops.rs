//! The choice of the step loop for runs: in lanes, compiled for each SIMD level, or one run after the other.

use crate::driver::simulate::adaptive;
use crate::error::Result;
use crate::formulation::{EquationKind, Inlined, Unilateral, with};
use crate::method::{MakeInLanes, Method, Rk4, Rk4InLanes, Runs};
use crate::model::{ContactModel, Fingers};
use crate::number::{LaneKernel, Lanes, Real, call_four_lanes, dispatch_lanes};
use crate::stepping::{AdaptiveSteps, EqualSteps, LoopSystem, Options, RunLoop, Steps};

impl RunLoop<'_> {
    /// Computes the runs in lanes, if the steps of the method have lanes.
    pub fn in_lanes(self) -> Result {
        // Jacobians in vectors of eight lanes have code for the paper's mechanisms and sides only.
        let papers = self.scene.parameters.has_the_papers_geometry();
        let Options { simd, method, .. } = *self.options;
        if papers || method != Method::Rosenbrock {
            dispatch_lanes(simd, self)?
        } else {
            call_four_lanes(self)
        }
    }

    /// Computes the runs one after the other: a single one, or those of a method whose steps have no lanes.
    pub fn alone(self) -> Result {
        let Self { options, scene, .. } = self;
        if let Steps::Free { tolerance } = options.steps {
            let make = adaptive(options.method)?;
            let build = |runs: Runs<'_>| runs.with_method(make);
            return f64::outlined(AdaptiveSteps { runs: self, tolerance, build });
        }
        let choice = options.choice(&scene.inputs);
        // Only what was measured to pay is inlined (docs/what-a-scene-pays.md).
        if options.method == Method::Rk4
            && options.contact == ContactModel::Bilateral
            && !(choice.carried.ledger || choice.moves)
            && scene.parameters.has_the_papers_geometry()
        {
            let called = &options.runs(scene).system();
            return with!(called.kind, equations [false, false] => if choice.fingers == Fingers::Driven {
                self.inlined(Inlined::<_, _, true> { equations, called })
            } else {
                self.inlined(Inlined::<_, _, false> { equations, called })
            });
        }
        let build = |runs: Runs<'_>| runs.with_method(options.method.entry().alone);
        f64::outlined(EqualSteps { runs: self, build })
    }

    /// Computes a run with RK4, whose loop has the equations inlined.
    fn inlined<S: LoopSystem<f64>>(self, system: S) -> Result {
        let method = &mut Rk4::default();
        f64::outlined(EqualSteps { runs: self, build: move |_: Runs<'_>| (system, method) })
    }
}

impl LaneKernel for RunLoop<'_> {
    type Output = Result;

    #[inline(always)]
    fn run<R: Lanes>(self) -> Result {
        let method = self.options.method;
        let make = |runs: Runs<'_>, system: &_| R::outlined(MakeInLanes { method, runs, system });
        let build = |runs: Runs<'_>| runs.with_method(make);
        match (self.options.steps, method) {
            // A step of RK4 is so short that a call would take 3 % of it.
            (Steps::Fixed(_), Method::Rk4) => {
                let method = &mut Rk4InLanes(Rk4::default());
                let build = move |runs: Runs<'_>| (runs.system::<R>(), method);
                R::outlined(EqualSteps { runs: self, build })
            }
            (Steps::Fixed(_), Method::Dop853 | Method::Rosenbrock) => {
                R::outlined(EqualSteps { runs: self, build })
            }
            (Steps::Free { tolerance }, Method::Dop853 | Method::Rosenbrock) => {
                R::outlined(AdaptiveSteps { runs: self, tolerance, build })
            }
            // Lanes of a method that iterates would wait for each other.
            (_, Method::ImplicitMidpoint | Method::Radau5) | (Steps::Free { .. }, Method::Rk4) => {
                self.alone()
            }
        }
    }
}
