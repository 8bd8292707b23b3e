//! The choice of the step loop for runs: in lanes, compiled for each SIMD level, or one run after the other. Equal
//! steps need a grid of times, free steps a method that estimates its error.

use crate::error::{Error, Result};
use crate::formulation::{EquationKind, Inlined, Unilateral, with};
use crate::method::{METHODS, MakeAdaptiveMethod, MakeInLanes, Method, Rk4, Rk4InLanes, Runs};
use crate::model::{ContactModel, Fingers, Scene};
use crate::number::{LaneKernel, Lanes, Real, call_four_lanes, dispatch_lanes};
use crate::stepping::{AdaptiveSteps, EqualSteps, Grid, LoopSystem, Options, RunLoop, Steps};

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

/// The method as one that chooses the length of its steps. The error lists the methods that do.
pub(super) fn adaptive(method: Method) -> Result<MakeAdaptiveMethod> {
    method.entry().adaptive.ok_or_else(|| {
        let adaptive = METHODS.iter().filter(|(_, method)| method.entry().adaptive.is_some());
        let names: Vec<_> = adaptive.map(|(name, _)| format!("{name:?}")).collect();
        let allowed = names.join(", ") + " where tolerance is given: only they estimate their error";
        Error::unknown("method", method.name(), allowed)
    })
}

/// The times of the steps of a run from its start to its end, in equal steps.
pub(super) fn whole_run(options: &Options) -> impl Fn(usize, &Scene) -> Result<Grid> + '_ {
    // Adaptive steps have no such times, and do not ask for them.
    let dt = if let Steps::Fixed(dt) = options.steps { dt } else { f64::NAN };
    move |_, Scene { inputs, initial, duration, .. }| {
        Grid::new(inputs, initial, *duration, dt, options.refine)
    }
}
