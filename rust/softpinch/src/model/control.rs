//! The laws that move the fingers: a controller's torque, or the schedule itself.

use std::fmt::Debug;

use crate::model::source::Source;
use crate::names::named;
use crate::number::real::Real;

named! {
    /// How the fingers of a scene move.
    #[derive(Default)]
    Fingers;
    /// The kinds of fingers by their public names.
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

/// The law that moves one finger.
pub trait Controller<R: Real>: Copy + Debug {
    /// Whether the finger's angle is an unknown that a torque acts on, and the law has a memory, which is integrated
    /// beside the motion. Otherwise the schedule prescribes the angle.
    const ANGLE_IS_STATE: bool;

    /// The law of one finger of a scene.
    fn of(source: &impl Source<R>, finger: usize, fingers: Fingers) -> Self;
    /// Torque on the finger, N m; zero if the schedule prescribes the angle.
    fn torque(&self, angle: R, rate: R, memory: R, target: R) -> R;
    /// Rate of the law's own state.
    fn memory_rate(&self, angle: R, target: R) -> R;
}

/// A finger that a torque turns.
///
/// PID (39): u = -K_P (theta - theta^d) - K_D theta-dot - K_I integral(theta - theta^d). Its memory is the integral,
/// in rad s; it is not reset where the target switches.
///
/// Where the schedule is the torque itself, u is the target: K_P = 1, K_D = K_I = 0, and no angle is fed back. So
/// both laws are the same code, which is compiled once; the factor of the angle costs a PID nothing, and changes
/// no bit.
#[derive(Debug, Clone, Copy)]
pub struct Actuated<R> {
    kp: R,
    kd: R,
    ki: R,
    /// 1 for a PID, 0 where the target is the torque.
    feedback: R,
}

impl<R: Real> Controller<R> for Actuated<R> {
    const ANGLE_IS_STATE: bool = true;

    #[inline(always)]
    fn of(source: &impl Source<R>, finger: usize, fingers: Fingers) -> Self {
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

    #[inline(always)]
    fn torque(&self, angle: R, rate: R, memory: R, target: R) -> R {
        let proportional = self.kp * self.feedback.neg_mul_add(angle, target);
        self.ki.neg_mul_add(memory, self.kd.neg_mul_add(rate, proportional))
    }

    #[inline(always)]
    fn memory_rate(&self, angle: R, target: R) -> R {
        self.feedback * (angle - target)
    }
}

/// A finger that follows its schedule exactly, as under position control. The torque that this takes is a
/// result ([`Plant::driving_torque`](crate::model::forces::Plant::driving_torque)).
#[derive(Debug, Clone, Copy)]
pub struct Driven;

impl<R: Real> Controller<R> for Driven {
    const ANGLE_IS_STATE: bool = false;

    #[inline(always)]
    fn of(_: &impl Source<R>, _: usize, _: Fingers) -> Self {
        Self
    }

    #[inline(always)]
    fn torque(&self, _: R, _: R, _: R, _: R) -> R {
        R::zero()
    }

    #[inline(always)]
    fn memory_rate(&self, _: R, _: R) -> R {
        R::zero()
    }
}
