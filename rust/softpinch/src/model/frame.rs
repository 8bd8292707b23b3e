//! A hand that moves: the position R and the tilt phi of the frame of the finger roots are given functions of time.
//!
//! All coordinates stay those of the hand's frame, so that constraints, tips and contacts are as in a hand at rest. The
//! object and the fingers feel the forces of inertia of the frame, and a gravity that turns with it. The tips' masses
//! (14) are masses of the surface's motion relative to the finger; as in (16) without weight, they are without inertia
//! of the frame. With a the acceleration R-dotdot along the hand's axes, omega = phi-dot and
//! a^ = (a_x + g sin phi, a_y + g cos phi), which take the place of the weight, the generalised forces are
//!
//! ```text
//! (M1) Q_x  = -M (a^_x - omega-dot y - 2 omega y-dot - omega^2 x)
//! (M2) Q_y  = -M (a^_y + omega-dot x + 2 omega x-dot - omega^2 y)
//! (M3) Q_th = -I omega-dot
//! (M4) Q_i  = -M_i L_i (s_i a^_x cos theta_i - a^_y sin theta_i) + s_i omega-dot (I_i - M_i L_i W_i sin theta_i)
//!             - omega^2 M_i L_i W_i cos theta_i
//! ```
//!
//! with W_i the distance of root i from the middle of the roots, which is the frame's origin. A parallelogram has (M4) too, because the point in
//! which its mass is thought has no Coriolis force either along its circle. A jaw of the mass M_i has the component of the
//! same forces along its travel.

use crate::number::Real;

#[derive(Debug, Clone, Copy)]
pub struct FrameMotion<R> {
    /// The acceleration of the frame's origin along the hand's axes, without gravity, m/s^2.
    pub acceleration: [R; 2],
    pub sin: R,
    pub cos: R,
    /// omega and its rate, 1/s and 1/s^2; `None` where the frame keeps its tilt.
    pub turning: Option<[R; 2]>,
}

impl<R: Real> FrameMotion<R> {
    pub fn still() -> Self {
        let zero = R::zero();
        Self { acceleration: [zero; 2], sin: zero, cos: R::constant(1.0), turning: None }
    }

    /// The motion with an acceleration along fixed axes.
    #[inline(always)]
    pub(crate) fn new(acceleration: [R; 2], (sin, cos): (R, R), turning: Option<[R; 2]>) -> Self {
        let mut frame = Self { acceleration, sin, cos, turning };
        frame.acceleration = frame.in_hand_axes(acceleration);
        frame
    }

    /// The components along the hand's axes of a vector that is given along fixed axes.
    #[inline(always)]
    pub fn in_hand_axes(&self, [x, y]: [R; 2]) -> [R; 2] {
        [x.dot2(self.cos, y, self.sin), y.dot2(self.cos, -x, self.sin)]
    }

    /// The components along fixed axes of a vector that is given along the hand's.
    pub fn in_fixed_axes(&self, [x, y]: [R; 2]) -> [R; 2] {
        [x.dot2(self.cos, -y, self.sin), y.dot2(self.cos, x, self.sin)]
    }

    /// What an accelerometer at the frame's origin reads, (a^_x, a^_y): that of a hand at rest reads (0, g).
    #[inline(always)]
    pub fn felt(&self, gravity: R) -> [R; 2] {
        let [x, y] = self.acceleration;
        [gravity.mul_add(self.sin, x), gravity.mul_add(self.cos, y)]
    }

    pub fn map<S: Real>(&self, to: impl Fn(R) -> S) -> FrameMotion<S> {
        let Self { acceleration, sin, cos, turning } = *self;
        let turning = turning.map(|rates| rates.map(&to));
        FrameMotion { acceleration: acceleration.map(&to), sin: to(sin), cos: to(cos), turning }
    }
}

/// The forces of the frame's motion, gravity included, at a state.
#[derive(Debug, Clone, Copy)]
pub struct FrameLoads<R> {
    /// Those on the object and the external force, along the hand's axes, and the moments.
    pub force: [R; 3],
    /// Generalised forces on the fingers, N m (M4): the factors of sin theta_i and cos theta_i, and a constant.
    pub fingers: [[R; 3]; 2],
    /// Those on the object alone, (M1) to (M3).
    pub object: [R; 3],
    /// The external force along the hand's axes.
    pub outside: [R; 2],
}
