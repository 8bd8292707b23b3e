//! The properties of a method, which its file states in one entry.

use nalgebra::Complex;

use crate::formulation::scene_equations::SceneEquations;
use crate::method::called::{AnyAdaptiveMethod, AnyMethod};
use crate::method::traits::Runs;

/// Makes a method of a single run, before its first step, for the equations of the run.
pub type MakeMethod = fn(Runs<'_>, &SceneEquations<f64>) -> AnyMethod;
/// Makes a method of a single run that chooses the length of its steps.
pub type MakeAdaptiveMethod = fn(Runs<'_>, &SceneEquations<f64>) -> AnyAdaptiveMethod;

/// The methods whose steps can be taken in lanes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LaneMethod {
    /// [`super::rk4`].
    Rk4,
    /// A method whose lanes can choose the length of their own steps.
    Adaptive(AdaptiveLaneMethod),
}

/// The methods whose lanes can choose the length of their own steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdaptiveLaneMethod {
    /// [`super::dop853`].
    Dop853,
    /// [`super::rosenbrock`].
    Rosenbrock,
}

/// The properties of a method.
pub struct MethodEntry {
    /// Its public name.
    pub name: &'static str,
    /// Its order: the error falls with this power of the step if nothing is stiff.
    pub order: u32,
    /// The end of its stability region on the negative real axis, without its sign; `None` if the region has no end
    /// there.
    pub real_stability_limit: Option<f64>,
    /// R(z): the factor by which a step of length h multiplies a mode of eigenvalue z / h.
    pub stability_function: fn(Complex<f64>) -> Complex<f64>,
    /// Whether its steps keep a Jacobian for the steps that follow.
    pub keeps_jacobian: bool,
    /// Makes the method.
    pub alone: MakeMethod,
    /// Makes the method as one that chooses the length of its steps, if it estimates its error.
    pub adaptive: Option<MakeAdaptiveMethod>,
    /// The method as one whose steps can be taken in lanes; `None` if its lanes would wait for each other.
    pub lanes: Option<LaneMethod>,
}
