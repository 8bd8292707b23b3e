//! The choice of the step loop for runs: in lanes, compiled for each SIMD level, or one run after the other.

use crate::driver::simulate::adaptive;
use crate::error::Result;
use crate::formulation::{AnyParts, EquationKind, Inlined, Unilateral, with};
use crate::method::{MakeInLanes, Method, Rk4, Runs};
use crate::model::{ContactModel, Fingers, Scene};
use crate::number::{LaneKernel, Lanes, Real, call_four_lanes, dispatch_lanes};
use crate::stepping::{AdaptiveSteps, EqualSteps, GridOf, LoopSetup, LoopSystem, Options, RunQueue, Steps};

/// The runs of one thread, over the times of `grid` if steps are equal. They have been checked.
pub struct RunLoop<'a> {
    pub queue: RunQueue<'a>,
    pub grid: &'a GridOf<'a>,
    pub options: &'a Options,
    /// One of the scenes. All have the same kinds of parts, fingers and inputs.
    pub scene: &'a Scene,
}

impl RunLoop<'_> {
    /// Computes the runs in lanes, if the steps of the method have lanes.
    pub fn in_lanes(self) -> Result {
        // Vectors of eight lanes have code for the paper's parts only.
        let papers = self.scene.parameters.has_the_papers_parts();
        let level = self.options.simd;
        if papers { dispatch_lanes(level, self)? } else { call_four_lanes(self) }
    }

    /// Computes the runs one after the other: a single one, or those of a method whose steps have no lanes.
    pub fn alone(self) -> Result {
        let Self { queue, grid, options, scene } = self;
        let choice = options.choice(&scene.inputs);
        let setup = LoopSetup { options, choice, queue };
        if let Steps::Free { tolerance } = options.steps {
            let make = adaptive(options.method)?;
            let build = |runs: Runs<'_>| runs.with_method(make);
            return f64::outlined(AdaptiveSteps { setup, tolerance, build });
        }
        // Only what was measured to pay is inlined (docs/what-a-scene-pays.md).
        if options.method == Method::Rk4
            && options.contact == ContactModel::Bilateral
            && !(choice.ledger || choice.moves)
            && scene.parameters.has_the_papers_parts()
        {
            let called = &options.runs(scene).system();
            return with!(called.kind, equations [false, false] => if choice.fingers == Fingers::Driven {
                inlined(Inlined::<_, _, true> { equations, called }, setup, grid)
            } else {
                inlined(Inlined::<_, _, false> { equations, called }, setup, grid)
            });
        }
        let build = |runs: Runs<'_>| runs.with_method(options.method.entry().alone);
        f64::outlined(EqualSteps { setup, grid, build })
    }
}

/// Computes a run with RK4, whose loop has the equations inlined.
fn inlined<S: LoopSystem<f64>>(system: S, setup: LoopSetup<'_>, grid: &GridOf<'_>) -> Result {
    let method = &mut Rk4::default();
    let build = move |_: Runs<'_>| (system, method);
    f64::outlined(EqualSteps { setup, grid, build })
}

impl LaneKernel for RunLoop<'_> {
    type Output = Result;

    #[inline(always)]
    fn run<R: Lanes>(self) -> Result {
        let Self { queue, grid, options, scene } = self;
        let choice = options.choice(&scene.inputs);
        let setup = LoopSetup { options, choice, queue };
        let method = options.method;
        let make = |runs: Runs<'_>, system: &_| R::outlined(MakeInLanes { method, runs, system });
        let build = |runs: Runs<'_>| runs.with_method(make);
        match (options.steps, options.method) {
            // A step of RK4 is so short that a call would take 3 % of it.
            (Steps::Fixed(_), Method::Rk4) => {
                let method = &mut Rk4::default();
                let build = move |runs: Runs<'_>| (runs.system::<R>(), method);
                R::outlined(EqualSteps { setup, grid, build })
            }
            (Steps::Fixed(_), Method::Dop853 | Method::Rosenbrock) => {
                R::outlined(EqualSteps { setup, grid, build })
            }
            (Steps::Free { tolerance }, Method::Dop853 | Method::Rosenbrock) => {
                R::outlined(AdaptiveSteps { setup, tolerance, build })
            }
            // Lanes of a method that iterates would wait for each other.
            (_, Method::ImplicitMidpoint | Method::Radau5) | (Steps::Free { .. }, Method::Rk4) => {
                Self { queue: setup.queue, grid, options, scene }.alone()
            }
        }
    }
}
