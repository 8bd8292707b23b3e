//! A state of the motion, and the usual size of each of its numbers.

use crate::model::geometry::index::{D_N, FINGER, THETA};
use crate::model::parameters::Parameters;

/// A state in the nine coordinates that every formulation is recorded in.
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
    /// The usual size of each number of a scene: lengths against the larger tip's radius, angles against one, rates against
    /// these times sqrt(E a / M), at which such a tip moves the object. An integral without a gain drives nothing, so its error is
    /// none: its size is infinite.
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

    /// The same with the rates of a scene that its viscosity slows down: E a / c, at which a tip gives way.
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

/// Where a Jacobian that an implicit method still uses was taken: time since the segment's start, q, p, memories.
pub type Linearized = [f64; 21];
