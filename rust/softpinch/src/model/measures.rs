//! The quantities that a discrete controller measures.

use crate::names::named;

named! {
    /// A quantity that a controller measures. Those of the fingers and tips are of the right one, then of the left one.
    Measure;
    MEASURES = {
        /// theta_1 and theta_2, rad.
        Angle = "angle",
        /// theta_i minus its target, rad.
        AngleError = "angle_error",
        /// Rates of theta_1 and theta_2, rad/s.
        AngleRate = "angle_rate",
        /// The targets of both fingers, rad: the schedule, or what the block before puts out.
        Target = "target",
        /// Rates of the targets, rad/s.
        TargetRate = "target_rate",
        /// x and y, m.
        Position = "position",
        /// theta, rad.
        Rotation = "rotation",
        /// Rates of x and y, m/s.
        Velocity = "velocity",
        /// Rate of theta, rad/s.
        RotationRate = "rotation_rate",
        /// d_n1 and d_n2, m.
        Compression = "compression",
        /// d_t1 and d_t2, m.
        Shear = "shear",
        /// lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N, N, under the torques before the sample.
        Multipliers = "multipliers",
        /// The acceleration of the hand's frame along its own axes, with gravity as an accelerometer feels it, m/s^2.
        Accelerometer = "accelerometer",
        /// Rate of the tilt of the hand's frame, rad/s.
        Gyroscope = "gyroscope",
        /// theta_1^d and theta_2^d, rad: the schedule.
        Schedule = "schedule",
    }
}

impl Measure {
    /// Number of numbers.
    pub fn width(self) -> usize {
        match self {
            Self::Rotation | Self::RotationRate | Self::Gyroscope => 1,
            Self::Multipliers => 4,
            _ => 2,
        }
    }

    /// Whether the measure is an input of the controller, which no sensor measures.
    pub(super) fn is_known(self) -> bool {
        matches!(self, Self::Target | Self::TargetRate | Self::Schedule)
    }
}
