//! The laws that move the fingers: a controller's torque, or the schedule itself.

use std::fmt::Debug;

use crate::model::parameters::PidGains;
use crate::model::source::Source;
use crate::number::real::Real;

/// How the fingers of a scene move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fingers {
    /// A PID torque (39) turns the fingers towards the angles of the schedule.
    #[default]
    Pid,
    /// The fingers follow the schedule exactly, whatever torque that takes.
    Driven,
}

/// The kinds of fingers by their public names.
pub const FINGERS: [(&str, Fingers); 2] = [("pid", Fingers::Pid), ("driven", Fingers::Driven)];

/// The law that moves one finger.
pub trait Controller<R: Real>: Copy + Debug {
    /// Whether the finger's angle is an unknown that a torque acts on. Otherwise the schedule prescribes the
    /// angle.
    const TURNS: bool;
    /// Whether the law has a state of its own, which is integrated beside the motion.
    const MEMORY: bool;

    /// The law of one finger of a scene.
    fn of(source: &impl Source<R>, finger: usize) -> Self;
    /// Torque on the finger, N m; zero if the schedule prescribes the angle.
    fn torque(&self, angle: R, rate: R, memory: R, target: R) -> R;
    /// Rate of the law's own state.
    fn memory_rate(&self, angle: R, target: R) -> R;
}

/// PID (39): u = -K_P (theta - theta^d) - K_D theta-dot - K_I integral(theta - theta^d). Its memory is the integral,
/// in rad s; it is not reset where the target switches.
impl<R: Real> Controller<R> for PidGains<R> {
    const TURNS: bool = true;
    const MEMORY: bool = true;

    #[inline(always)]
    fn of(source: &impl Source<R>, finger: usize) -> Self {
        Self {
            kp: source.number(|p| p.control[finger].kp),
            kd: source.number(|p| p.control[finger].kd),
            ki: source.number(|p| p.control[finger].ki),
        }
    }

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

/// A finger that follows its schedule exactly, as under position control. The torque that this takes is a
/// result ([`Plant::driving_torque`](crate::model::forces::Plant::driving_torque)).
#[derive(Debug, Clone, Copy)]
pub struct Driven;

impl<R: Real> Controller<R> for Driven {
    const TURNS: bool = false;
    const MEMORY: bool = false;

    #[inline(always)]
    fn of(_: &impl Source<R>, _: usize) -> Self {
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
