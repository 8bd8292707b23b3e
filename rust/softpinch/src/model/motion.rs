//! A state of the motion, and the typical magnitude of each of its components.

use crate::model::index::{D_N, FINGER, THETA};
use crate::model::parameters::Parameters;

/// A state in the nine coordinates. Every formulation is recorded in this form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<R> {
    /// Coordinates.
    pub q: [R; 9],
    /// Velocities.
    pub p: [R; 9],
    /// The controllers' memories.
    pub memory: [R; 2],
}

impl Motion<f64> {
    /// The typical magnitude of each component in a scene. For lengths it is the larger tip's radius, for
    /// angles one, and for rates these magnitudes times sqrt(E a / M), the rate at which such a tip moves the
    /// object. A PID integral without a gain drives nothing, so its error does not matter and its magnitude
    /// is infinite.
    pub fn typical_magnitudes(parameters: &Parameters) -> Self {
        let [right, left] = &parameters.tips;
        let length = right.radius.max(left.radius);
        let pace =
            (parameters.modulus(0).max(parameters.modulus(1)) * length / parameters.grasped.mass).sqrt();
        let mut q = [length; 9];
        q[THETA] = 1.0;
        q[FINGER..D_N].fill(1.0);
        let memory = parameters.control.map(|pid| if pid.ki == 0.0 { f64::INFINITY } else { 1.0 / pace });
        Self { q, p: q.map(|magnitude| magnitude * pace), memory }
    }

    /// [`Motion::typical_magnitudes`] with smaller rates if viscosity slows the scene down: E a / c is the
    /// rate at which a tip gives way.
    pub fn slow_magnitudes(parameters: &Parameters) -> Self {
        let usual = Self::typical_magnitudes(parameters);
        let mut pace = usual.p[THETA];
        for (i, tip) in parameters.tips.iter().enumerate() {
            let viscosity = tip.normal_viscosity.max(tip.tangential_viscosity);
            pace = pace.min(parameters.modulus(i) * tip.radius / viscosity);
        }
        Self { p: usual.q.map(|magnitude| magnitude * pace), ..usual }
    }
}

/// The point at which an implicit method took the Jacobian that it still uses: time since the segment's
/// start, q, p, memories.
pub type Linearized = [f64; 21];

/// The time and the motion of such a point.
pub fn unpacked(point: &Linearized) -> (f64, Motion<f64>) {
    let motion = Motion {
        q: std::array::from_fn(|k| point[1 + k]),
        p: std::array::from_fn(|k| point[10 + k]),
        memory: [point[19], point[20]],
    };
    (point[0], motion)
}
