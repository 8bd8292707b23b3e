//! Every term of (24) at one state, as matrices, for tests and for a closer look at a scene.

use nalgebra::SMatrix;

use crate::error::Error;
use crate::formulation::equations;
use crate::formulation::{ContactEquations, Csm, Response};
use crate::model::contact::mechanism::Mechanism;
use crate::model::{
    Any, Contacts, Coordinates, Energies, Geometry, Inputs, Motion, Parameters, Plant, Rule, Stabilization,
};
use crate::number::signed;

/// A matrix over coordinates or constraints.
pub type Matrix<const R: usize, const C: usize> = SMatrix<f64, R, C>;

/// Every term at one state. The forces act on q: M p-dot is their sum plus Phi^T lambda.
#[allow(missing_docs)] // of fields that their types explain
pub struct Terms {
    pub mass_matrix: Matrix<9, 9>,
    pub constraint_matrix: Matrix<4, 9>,
    pub vectors: [(&'static str, Vec<f64>); 11],
    pub energies: Energies,
}

/// Evaluates all terms at time `t` and a motion. If an input jumps at `t`, its value after the
/// jump is used. Gains of zero give the accelerations of `nullspace` and `projected`, off the constraints
/// too.
pub fn evaluate(
    parameters: &Parameters,
    inputs: &Inputs,
    stabilization: &Stabilization,
    t: f64,
    motion: &Motion<f64>,
) -> Result<Terms, Error> {
    Rule::Finite.check("t", t)?;
    let drive = inputs.segment(t);
    let input = drive.at(0.0);
    // With tips that stick the equations of unilateral contact are those of bilateral contact.
    let plant = Plant::<f64>::called(parameters, inputs.fingers, inputs.moves());
    let csm = Csm::new(plant, stabilization);
    let own = drive.frame.as_deref().copied();
    let equations::Terms { geometry, forces, response, .. } =
        ContactEquations::new(&csm, [0.0; 2], own).terms(&input, &Contacts::sticking(), motion);
    let Motion { q, p, .. } = motion;
    let moving = own.map(|own| plant.loads(&own.at(0.0), &input.force, q.object, p.object));
    let mut outside = input.force;
    if let Some(moving) = &moving {
        outside[..2].copy_from_slice(&moving.outside);
    }
    let Response { multipliers, acceleration: accelerations, .. } = response;
    let [right, left] = forces.elastic;
    let (object, fingers) = geometry.couples([right.tilt, left.tilt]);
    let elastic = vector(object, fingers, [-right.normal, -left.normal, -right.tangential, -left.tangential]);
    let weight = moving.map_or([0.0, -forces.weight, 0.0], |moving| moving.object);
    let vectors = [
        // Phi-dot p.
        ("constraint_rate", geometry.bias().to_vec()),
        ("residuals", geometry.residuals().to_vec()),
        ("residual_rates", geometry.constraint_velocity()[..2].to_vec()),
        // Minus the gradient of (5).
        ("elastic", elastic),
        // Minus the gradient of (16); or the forces of the hand's motion, which include gravity.
        ("gravity", vector(weight, forces.finger_gravity, [0.0; 4])),
        // (44) and (45), and the dry friction of the joints.
        ("viscous", vector([0.0; 3], forces.friction.map(|own| own + 0.0), plant.drags(p).map(|drag| -drag))),
        // (39), or the torques that driven fingers need.
        ("control", vector([0.0; 3], forces.torque, [0.0; 4])),
        ("external", vector(outside, [0.0; 2], [0.0; 4])),
        ("multipliers", multipliers.to_vec()),
        ("accelerations", accelerations.row().to_vec()),
        // The target angles of the instant, or the torques.
        ("target", input.target.to_vec()),
    ];
    let (mass_matrix, constraint_matrix) = (parameters.mass_matrix(), geometry.constraint_matrix());
    Ok(Terms {
        mass_matrix,
        constraint_matrix,
        vectors,
        energies: plant.energies::<Any>(plant.tips_at::<Any>(q), q, p),
    })
}

/// A vector over q, from its parts for the object, the fingers, and d_n1, d_n2, d_t1 and d_t2.
fn vector(object: [f64; 3], fingers: [f64; 2], tips: [f64; 4]) -> Vec<f64> {
    object.into_iter().chain(fingers).chain(tips).collect()
}

/// Both contacts at one state, for drawings and checks: theta_p; the places along the sides from their middles, upwards; for
/// each contact the side's normal from the left finger to the right one, and the tip's centre. Along the axes of the hand.
pub fn contacts(parameters: &Parameters, q: &Coordinates) -> [f64; 12] {
    let geometry = Geometry::of_scene(parameters, q, &Coordinates::zero());
    let mut found = [0.0; 12];
    for (i, contact) in geometry.contacts.iter().enumerate() {
        let [along, across] = contact.in_object_axes([1.0, 0.0]);
        let [inwards, up] = Mechanism::<f64>::new(parameters, i).placed(q.finger[i]).centre;
        (found[i], found[2 + i]) = (contact.tilt, signed(i, contact.place));
        found[4 + 2 * i..6 + 2 * i].copy_from_slice(&geometry.outward(along, across));
        found[8 + 2 * i..10 + 2 * i].copy_from_slice(&[signed(i, inwards), up]);
    }
    found
}
