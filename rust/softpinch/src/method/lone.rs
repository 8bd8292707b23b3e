//! The methods of a single run.

use crate::formulation::scene_equations::{SceneEquations, Tangent};
use crate::formulation::system::System;
use crate::method::dop853::Dop853;
use crate::method::implicit_midpoint::ImplicitMidpoint;
use crate::method::linearize::{DIRECTIONS, Factors};
use crate::method::newton::Newton;
use crate::method::radau5::{Pair, Radau5};
use crate::method::rosenbrock::Rosenbrock;
use crate::method::traits::Runs;
use crate::model::motion::Motion;

/// A scheme whose equations Newton's iteration solves.
type ByNewton<M, F> = Newton<M, F, Tangent<f64, DIRECTIONS>>;

fn by_newton<M, F: Copy>(runs: Runs<'_>, system: &SceneEquations<f64>, scheme: M) -> ByNewton<M, F> {
    let magnitudes = system.begin(&Motion::typical_magnitudes(runs.parameters[0]));
    Newton::new(system.size(), runs.tangent(), magnitudes, scheme)
}

/// Dop853 before its first step.
pub fn dop853(_: Runs<'_>, _: &SceneEquations<f64>) -> Dop853 {
    Dop853::new()
}

/// The implicit midpoint rule of a single run.
pub type LoneMidpoint = ByNewton<ImplicitMidpoint, Factors<f64>>;
/// Radau5 of a single run.
pub type LoneRadau5 = ByNewton<Radau5, Pair>;
/// The Rosenbrock method of a single run.
pub type LoneRosenbrock = Rosenbrock<Tangent<f64, DIRECTIONS>>;

/// The implicit midpoint rule before its first step.
pub fn implicit_midpoint(runs: Runs<'_>, system: &SceneEquations<f64>) -> LoneMidpoint {
    by_newton(runs, system, ImplicitMidpoint)
}

/// Radau5 before its first step.
pub fn radau5(runs: Runs<'_>, system: &SceneEquations<f64>) -> LoneRadau5 {
    by_newton(runs, system, Radau5::new())
}

/// The Rosenbrock method before its first step.
pub fn rosenbrock(runs: Runs<'_>, system: &SceneEquations<f64>) -> LoneRosenbrock {
    Rosenbrock::new(system.size(), runs.tangent())
}
