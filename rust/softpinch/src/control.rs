//! What drives the fingers.

use crate::parameters::PidGains;
use crate::real::Real;

/// A law for one finger's torque, with one state of its own that integrates beside the motion.
pub trait Controller<R: Real> {
    /// Torque on the finger, N m.
    fn torque(&self, angle: R, rate: R, memory: R, target: R) -> R;
    /// Rate of the controller's own state.
    fn memory_rate(&self, angle: R, target: R) -> R;
}

/// PID (39): u = -K_P (theta - theta^d) - K_D theta-dot - K_I integral(theta - theta^d). Its memory is the integral,
/// in rad s; it is not reset where the target switches.
impl<R: Real> Controller<R> for PidGains<R> {
    #[inline(always)]
    fn torque(&self, angle: R, rate: R, memory: R, target: R) -> R {
        let proportional = self.kp * (target - angle);
        self.ki.neg_mul_add(memory, self.kd.neg_mul_add(rate, proportional))
    }

    #[inline(always)]
    fn memory_rate(&self, angle: R, target: R) -> R {
        angle - target
    }
}
