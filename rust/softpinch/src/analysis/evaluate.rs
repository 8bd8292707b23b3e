//! Every term of (24) at one state, as matrices, for tests and for a closer look at a scene.

use nalgebra::{SMatrix, SVector};

use crate::error::Error;
use crate::formulation::contact_solve::Response;
use crate::formulation::csm::Csm;
use crate::formulation::equations::{self, Equations};
use crate::model::contact::Side;
use crate::model::contact_modes::Contacts;
use crate::model::control::{Actuated, Controller, Driven, Fingers};
use crate::model::drive::Input;
use crate::model::energy::Energies;
use crate::model::forces::Plant;
use crate::model::geometry::Geometry;
use crate::model::inputs::Inputs;
use crate::model::motion::Motion;
use crate::model::parameters::{Parameters, Stabilization};
use crate::model::rule::Rule;

/// A matrix over coordinates or constraints.
pub type Matrix<const R: usize, const C: usize> = SMatrix<f64, R, C>;
/// A vector over the coordinates q.
pub type Vector9 = SVector<f64, 9>;
/// A vector over the constraints (H_1, H_2, N_1, N_2).
pub type Vector4 = SVector<f64, 4>;

/// Every term at one state. The forces act on q: M p-dot is their sum plus Phi^T lambda.
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    /// The mass matrix (14).
    pub mass_matrix: Matrix<9, 9>,
    /// Phi (25).
    pub constraint_matrix: Matrix<4, 9>,
    /// Phi-dot p.
    pub constraint_rate: Vector4,
    /// (C_1^H, C_2^H, C_1^N, C_2^N).
    pub residuals: Vector4,
    /// The rates of C_1^H and C_2^H.
    pub residual_rates: [f64; 2],
    /// The elastic forces: minus the gradient of (5).
    pub elastic: Vector9,
    /// The forces of gravity: minus the gradient of (16).
    pub gravity: Vector9,
    /// The viscous forces (44), (45).
    pub viscous: Vector9,
    /// The torques of the controllers (39), or those that driven fingers need.
    pub control: Vector9,
    /// The disturbances.
    pub external: Vector9,
    /// The multipliers lambda.
    pub multipliers: Vector4,
    /// The accelerations p-dot.
    pub accelerations: Vector9,
    /// Kinetic, elastic and gravity energy.
    pub energies: Energies,
    /// The target angles of the instant, or the torques.
    pub target: [f64; 2],
}

/// Evaluates all terms at time `t` and state (q, p, memory). If an input jumps at `t`, its value after the
/// jump is used. Gains of zero give the accelerations of `nullspace` and `projected`, off the constraints
/// too.
pub fn evaluate(
    parameters: &Parameters,
    inputs: &Inputs,
    stabilization: &Stabilization,
    t: f64,
    state: (&[f64; 9], &[f64; 9], &[f64; 2]),
) -> Result<Terms, Error> {
    Rule::Finite.check("t", t)?;
    let input = inputs.segment(t).at(0.0);
    let fingers = inputs.fingers();
    Ok(match fingers {
        Fingers::Pid | Fingers::Torque => {
            terms::<Actuated<f64>>(parameters, fingers, &input, stabilization, state)
        }
        Fingers::Driven => terms::<Driven>(parameters, fingers, &input, stabilization, state),
    })
}

fn terms<K: Controller<f64>>(
    parameters: &Parameters,
    fingers: Fingers,
    input: &Input<f64>,
    stabilization: &Stabilization,
    (q, p, memory): (&[f64; 9], &[f64; 9], &[f64; 2]),
) -> Terms {
    let plant = Plant::<f64, K>::new(parameters, fingers);
    let motion = Motion { q: *q, p: *p, memory: *memory };
    let geometry = Geometry::new(&plant.sides, q, p);
    let csm = Csm::new(plant, stabilization);
    let equations::Terms { forces, response, .. } =
        csm.terms(input, &Contacts::sticking(), &motion, geometry);
    let Response { multipliers, acceleration: accelerations, .. } = response;
    let [right, left] = forces.elastic;
    let ([drag_n1, drag_n2, drag_t1, drag_t2], torque) = (plant.drags(p), forces.torque);
    let [fx, fy, moment] = forces.external;
    let velocity = geometry.constraint_velocity();
    Terms {
        mass_matrix: parameters.mass_matrix(),
        constraint_matrix: geometry.constraint_matrix(),
        constraint_rate: Vector4::from(geometry.bias()),
        residuals: Vector4::from(geometry.residuals()),
        residual_rates: [velocity[0], velocity[1]],
        elastic: Vector9::from([
            0.0,
            0.0,
            right.tilt - left.tilt,
            -right.tilt,
            -left.tilt,
            -right.normal,
            -left.normal,
            -right.tangential,
            -left.tangential,
        ]),
        gravity: Vector9::from([
            0.0,
            -forces.weight,
            0.0,
            forces.finger_gravity[0],
            forces.finger_gravity[1],
            0.0,
            0.0,
            0.0,
            0.0,
        ]),
        viscous: Vector9::from([0.0, 0.0, 0.0, 0.0, 0.0, -drag_n1, -drag_n2, -drag_t1, -drag_t2]),
        control: Vector9::from([0.0, 0.0, 0.0, torque[0], torque[1], 0.0, 0.0, 0.0, 0.0]),
        external: Vector9::from([fx, fy, moment, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        multipliers: Vector4::from(multipliers),
        accelerations: Vector9::from(accelerations),
        energies: plant.energies(q, p),
        target: input.target,
    }
}

/// (C_1^H, C_2^H, C_1^N, C_2^N) at one state.
pub fn residuals(parameters: &Parameters, q: &[f64; 9], p: &[f64; 9]) -> [f64; 4] {
    Geometry::new(&Side::both(parameters), q, p).residuals()
}
