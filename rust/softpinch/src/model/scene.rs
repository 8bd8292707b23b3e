//! The scene that is simulated.

use crate::model::{Inputs, Parameters, State};

/// The physics, the inputs and the initial state of a simulation.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // of fields that their types explain
pub struct Scene {
    pub parameters: Parameters,
    pub inputs: Inputs,
    pub initial: State,
    /// Whether an initial state off the constraints is refused.
    pub check: bool,
    /// How long the simulation runs from the initial state, s.
    pub duration: f64,
}
