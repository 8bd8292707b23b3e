//! A state of the motion, and the typical magnitude of each of its components.

use crate::model::geometry::index::{D_N, FINGER, THETA};
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
    #[must_use]
    pub fn sizes(parameters: &Parameters) -> Self {
        let [right, left] = &parameters.tips;
        let length = right.radius.max(left.radius);
        let pace = (right.youngs_modulus.max(left.youngs_modulus) * length / parameters.grasped.mass).sqrt();
        let mut q = [length; 9];
        q[THETA] = 1.0;
        q[FINGER..D_N].fill(1.0);
        let memory = parameters.control.map(|pid| if pid.ki == 0.0 { f64::INFINITY } else { 1.0 / pace });
        Self { q, p: q.map(|size| size * pace), memory }
    }

    /// [`Motion::sizes`] with smaller rates if viscosity slows the scene down: E a / c is the rate at which a
    /// tip gives way.
    #[must_use]
    pub fn slow_sizes(parameters: &Parameters) -> Self {
        let usual = Self::sizes(parameters);
        let mut pace = usual.p[THETA];
        for tip in &parameters.tips {
            let viscosity = tip.normal_viscosity.max(tip.tangential_viscosity);
            pace = pace.min(tip.youngs_modulus * tip.radius / viscosity);
        }
        Self { p: usual.q.map(|size| size * pace), ..usual }
    }
}

/// The point at which an implicit method took the Jacobian that it still uses: time since the segment's
/// start, q, p, memories.
pub type Linearized = [f64; 21];
