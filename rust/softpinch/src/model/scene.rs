//! What is simulated.

use crate::model::inputs::Inputs;
use crate::model::parameters::Parameters;
use crate::model::start::State;

/// The physics of a scene, what drives it and where it starts.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The physics.
    pub parameters: Parameters,
    /// Schedule and disturbances.
    pub inputs: Inputs,
    /// Where it starts.
    pub initial: State,
    /// Whether a start off the constraints is refused.
    pub check: bool,
    /// How long it runs from there, s.
    pub duration: f64,
}
