//! The motion linearised about one state. The eigenvalues of its Jacobian say how fast it is and which steps
//! it allows.

use nalgebra::DMatrix;

use crate::error::Error;
use crate::formulation::scene_equations::{Choice, SceneEquations};
use crate::formulation::system::{Linear, System};
use crate::formulation::table::Formulation;
use crate::formulation::tangent::Tangent;
use crate::method::linearize::DIRECTIONS;
use crate::model::contact_modes::ContactModel;
use crate::model::inputs::Inputs;
use crate::model::motion::Motion;
use crate::model::parameters::{Parameters, Stabilization};
use crate::model::rule::Rule;
use crate::number::simd::level::Level;

/// The derivatives of the state's rates with respect to the state, in the formulation's own states, at time
/// `t`. If an input jumps at `t`, its value after the jump is used.
pub fn jacobian(
    parameters: &Parameters,
    inputs: &Inputs,
    (formulation, gains, level): (Formulation, &Stabilization, Level),
    t: f64,
    motion: &Motion<f64>,
) -> Result<DMatrix<f64>, Error> {
    Rule::Finite.check("t", t)?;
    let instructions = level.require()?;
    let choice =
        Choice { formulation, contact: ContactModel::Bilateral, fingers: inputs.fingers(), ledger: false };
    let system = SceneEquations::<f64>::new(instructions, choice, parameters, gains);
    let tangent = Tangent::<f64, DIRECTIONS>::new(instructions, choice, parameters, gains);
    let rows = tangent.jacobian(&inputs.segment(t), 0.0, &system.begin(motion)).rows;
    let states = system.size().states;
    Ok(DMatrix::from_fn(states, states, |row, column| rows[row][column]))
}
