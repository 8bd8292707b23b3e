//! The quantities that a discrete controller measures, with noise and finite resolution.

use crate::model::geometry::index::{D_N, D_T, FINGER, THETA, X};
use crate::model::motion::Motion;
use crate::model::noise::normals;
use crate::model::sampled::SampledController;

/// The stream of the measurements' noise. Those of the disturbances' noises count from 0.
const STREAM: u64 = u64::MAX;

/// A quantity that a controller measures. Quantities of the fingers and their tips are those of the right one and
/// then of the left one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// theta_1 and theta_2, rad.
    Angle,
    /// theta_i - theta_i^d, rad.
    AngleError,
    /// Rates of theta_1 and theta_2, rad/s.
    AngleRate,
    /// theta_1^d and theta_2^d, rad: the schedule.
    Target,
    /// Rates of theta_1^d and theta_2^d, rad/s.
    TargetRate,
    /// x and y, m.
    Position,
    /// theta, rad.
    Rotation,
    /// Rates of x and y, m/s.
    Velocity,
    /// Rate of theta, rad/s.
    RotationRate,
    /// d_n1 and d_n2, m.
    Compression,
    /// d_t1 and d_t2, m.
    Shear,
    /// lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N, N, under the torques before the sample.
    Multipliers,
}

/// The measures by their public names.
pub const MEASURES: [(&str, Measure); 12] = [
    ("angle", Measure::Angle),
    ("angle_error", Measure::AngleError),
    ("angle_rate", Measure::AngleRate),
    ("target", Measure::Target),
    ("target_rate", Measure::TargetRate),
    ("position", Measure::Position),
    ("rotation", Measure::Rotation),
    ("velocity", Measure::Velocity),
    ("rotation_rate", Measure::RotationRate),
    ("compression", Measure::Compression),
    ("shear", Measure::Shear),
    ("multipliers", Measure::Multipliers),
];

impl Measure {
    /// Number of numbers.
    pub fn width(self) -> usize {
        match self {
            Self::Rotation | Self::RotationRate => 1,
            Self::Multipliers => 4,
            _ => 2,
        }
    }

    /// Whether the measure is an input of the controller, which no sensor measures.
    fn is_known(self) -> bool {
        matches!(self, Self::Target | Self::TargetRate)
    }
}

/// The measured system at the instant of a sample.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a> {
    /// The motion.
    pub motion: &'a Motion<f64>,
    /// The multipliers.
    pub multipliers: &'a [f64; 4],
    /// The target angles, rad, and their rates, rad/s.
    pub target: [[f64; 2]; 2],
}

/// Measures y: each number with noise, and rounded to its resolution.
pub(super) fn measure(controller: &SampledController, number: u64, seen: &Measured<'_>, y: &mut Vec<f64>) {
    let Measured { motion: Motion { q, p, .. }, multipliers, target: [target, target_rate] } = seen;
    y.clear();
    for measure in &controller.measures {
        match measure {
            Measure::Angle | Measure::AngleError => y.extend(&q[FINGER..FINGER + 2]),
            Measure::AngleRate => y.extend(&p[FINGER..FINGER + 2]),
            Measure::Target => y.extend(target),
            Measure::TargetRate => y.extend(target_rate),
            Measure::Position => y.extend(&q[X..X + 2]),
            Measure::Rotation => y.push(q[THETA]),
            Measure::Velocity => y.extend(&p[X..X + 2]),
            Measure::RotationRate => y.push(p[THETA]),
            Measure::Compression => y.extend(&q[D_N..D_N + 2]),
            Measure::Shear => y.extend(&q[D_T..D_T + 2]),
            Measure::Multipliers => y.extend(multipliers.iter()),
        }
    }
    let mut first = 0;
    for measure in &controller.measures {
        for k in first..first + measure.width() {
            if measure.is_known() {
                continue;
            }
            if controller.noise[k] > 0.0 {
                let random = normals([number, STREAM, (k / 4) as u64, 0], controller.key)[k % 4];
                y[k] += controller.noise[k] * random;
            }
            if controller.resolution[k] > 0.0 {
                y[k] = (y[k] / controller.resolution[k]).round() * controller.resolution[k];
            }
            if *measure == Measure::AngleError {
                // An encoder measures the angle.
                y[k] -= target[k - first];
            }
        }
        first += measure.width();
    }
}
