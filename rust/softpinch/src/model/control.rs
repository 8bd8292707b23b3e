//! What moves the fingers: a torque, or the schedule itself.

use std::fmt::Debug;

use crate::model::parameters::PidGains;
use crate::model::source::Source;
use crate::number::real::Real;

/// What a scene's fingers do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fingers {
    /// A PID torque (39) turns them towards the schedule.
    #[default]
    Pid,
    /// They are where the schedule has them, whatever torque that takes.
    Driven,
}

/// The kinds of fingers by their public names.
pub const FINGERS: [(&str, Fingers); 2] = [("pid", Fingers::Pid), ("driven", Fingers::Driven)];

/// What moves one finger.
pub trait Controller<R: Real>: Copy + Debug {
    /// Whether the finger's angle is an unknown that a torque acts on; else the schedule has it.
    const TURNS: bool;
    /// Whether the law has a state of its own that integrates beside the motion.
    const MEMORY: bool;

    /// Of one finger of a scene.
    fn of(source: &impl Source<R>, finger: usize) -> Self;
    /// Torque on the finger, N m, where it turns.
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

/// A finger that follows its schedule exactly, as one under position control: what torque that takes is a result
/// ([`Plant::driving_torque`](crate::model::forces::Plant::driving_torque)).
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
