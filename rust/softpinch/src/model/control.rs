//! The laws that move the fingers: a controller's torque, or the schedule itself.

use crate::model::Source;
use crate::names::named;
use crate::number::Real;

named! {
    /// How the fingers of a scene move.
    #[derive(Default)]
    Fingers;
    FINGERS = {
        /// A PID torque (39) turns the fingers towards the angles of the schedule.
        #[default]
        Pid = "pid",
        /// The schedule is the torque on the fingers.
        Torque = "torque",
        /// The fingers follow the schedule exactly, whatever torque that takes.
        Driven = "driven",
    }
}

/// The torque law of one finger.
///
/// PID (39): u = -K_P (theta - theta^d) - K_D theta-dot - K_I integral(theta - theta^d). Its memory is the integral,
/// in rad s; it is not reset where the target switches.
///
/// Where the schedule is the torque itself, u is the target: K_P = 1, K_D = K_I = 0, and no angle is fed back. So both
/// laws are the same code, which is compiled once; the factor of the angle costs a PID nothing, and changes no bit.
#[derive(Debug, Clone, Copy)]
pub struct Controller<R> {
    kp: R,
    kd: R,
    ki: R,
    /// 1 for a PID, 0 where the target is the torque.
    feedback: R,
}

impl<R: Real> Controller<R> {
    /// The law of one finger of a scene. Driven fingers have one too, which nothing uses while they are driven.
    #[inline(always)]
    pub fn new(source: &impl Source<R>, finger: usize, fingers: Fingers) -> Self {
        let zero = R::zero();
        if fingers == Fingers::Torque {
            return Self { kp: R::constant(1.0), kd: zero, ki: zero, feedback: zero };
        }
        Self {
            kp: source.number(|p| p.control[finger].kp),
            kd: source.number(|p| p.control[finger].kd),
            ki: source.number(|p| p.control[finger].ki),
            feedback: R::constant(1.0),
        }
    }

    /// Torque on the finger, N m.
    #[inline(always)]
    pub fn torque(&self, angle: R, rate: R, memory: R, target: R) -> R {
        let proportional = self.kp * self.feedback.neg_mul_add(angle, target);
        self.ki.neg_mul_add(memory, self.kd.neg_mul_add(rate, proportional))
    }

    /// Rate of the law's own state.
    #[inline(always)]
    pub fn memory_rate(&self, angle: R, target: R) -> R {
        self.feedback * (angle - target)
    }
}
