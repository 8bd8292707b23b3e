//! The table of the methods, and those that can be made for lanes.

use nalgebra::{Complex, ComplexField};

use crate::formulation::{Runs, SceneEquations, System, Tangent};
use crate::method::{AnyAdaptiveMethod, Called, Dop853, MethodEntry, Rosenbrock};
use crate::method::{dop853, implicit_midpoint, radau5, rk4, rosenbrock};
use crate::names::named;
use crate::number::{LaneEntry, LaneTask, Lanes, task};

named! {
    /// The methods.
    Method;
    METHODS = {
        /// The classical Runge-Kutta method of order four.
        Rk4 = "rk4",
        /// Dormand and Prince's explicit method of order eight.
        Dop853 = "dop853",
        /// The implicit midpoint rule of order two.
        ImplicitMidpoint = "implicit_midpoint",
        /// The three-stage Radau IIA method of order five.
        Radau5 = "radau5",
        /// Rodas4P2, linearly implicit, of order four.
        Rosenbrock = "rosenbrock",
    }
}

task! {
    /// Makes a method whose lanes choose the length of their own steps, before its first step: `Rosenbrock` or `Dop853`.
    /// The zeros of its vectors need the instructions of the lanes.
    pub(crate) ['a, R: Lanes] MakeInLanes<'a, R>(method: Method, runs: Runs<'a>, system: &'a SceneEquations<R>)
    for R => AnyAdaptiveMethod<R> = match method {
        Method::Rosenbrock => {
            let method = Rosenbrock::<Tangent<R>, R, LaneEntry<R>>::new(system.size(), runs.tangent());
            Box::new(Called(method))
        }
        Method::Dop853 => Box::new(Called(Dop853::default())),
        Method::Rk4 | Method::ImplicitMidpoint | Method::Radau5 => unreachable!("{method:?} has no such lanes"),
    }
}

/// The steps in |z| by which the edge of a stability region is searched along a ray.
const STRIDE: f64 = 0.01;
/// Beyond this |z| every explicit method of the crate is outside of its stability region.
const OUTSIDE: f64 = 10.0;
/// If |R| exceeds one by no more than this, that is round-off: R is a sum of terms up to 10^5 in size.
const ROUND_OFF: f64 = 1e-10;

impl Method {
    /// The properties of the method.
    pub const fn entry(self) -> &'static MethodEntry {
        match self {
            Self::Rk4 => &rk4::ENTRY,
            Self::Dop853 => &dop853::ENTRY,
            Self::ImplicitMidpoint => &implicit_midpoint::ENTRY,
            Self::Radau5 => &radau5::ENTRY,
            Self::Rosenbrock => &rosenbrock::ENTRY,
        }
    }

    /// The longest step with which a mode of this eigenvalue does not grow: there the ray through the eigenvalue first
    /// leaves the region |R| <= 1. The step is infinite for a method that is stable in the whole left half-plane. It is
    /// infinite for an eigenvalue in the right half-plane too, because a mode that grows by itself limits no step.
    pub fn longest_stable_step(self, rate: Complex<f64>) -> f64 {
        let size = rate.modulus();
        if self.entry().real_stability_limit.is_none() || size == 0.0 || rate.re > 0.0 {
            return f64::INFINITY;
        }
        let direction = rate / size;
        // Overflow counts as growth.
        let grows = |r: f64| {
            let growth = (self.entry().stability_function)(direction * r).norm_sqr();
            growth > 1.0 + 2.0 * ROUND_OFF || growth.is_nan()
        };
        let mut inside = 0.0;
        while inside < OUTSIDE && !grows(inside + STRIDE) {
            inside += STRIDE;
        }
        let mut outside = inside + STRIDE;
        for _ in 0..30 {
            let middle = 0.5 * (inside + outside);
            if grows(middle) { outside = middle } else { inside = middle }
        }
        inside / size
    }
}
