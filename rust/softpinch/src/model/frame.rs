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
//! with W_i the distance of root i from the middle of the roots, which is the frame's origin.

use crate::model::coordinates::Coordinates;
use crate::model::source::Source;
use crate::number::real::{Real, dot, signed};

/// The motion of the frame at one instant.
#[derive(Debug, Clone, Copy)]
pub struct FrameMotion<R> {
    /// The acceleration of the frame's origin along the hand's axes, without gravity, m/s^2.
    pub acceleration: [R; 2],
    /// sin phi.
    pub sin: R,
    /// cos phi.
    pub cos: R,
    /// omega and its rate, 1/s and 1/s^2; `None` where the frame keeps its tilt.
    pub turning: Option<[R; 2]>,
}

impl<R: Real> FrameMotion<R> {
    /// A frame at rest.
    pub fn still() -> Self {
        let zero = R::zero();
        Self { acceleration: [zero; 2], sin: zero, cos: R::constant(1.0), turning: None }
    }

    /// The motion with an acceleration along fixed axes.
    #[inline(always)]
    pub(crate) fn new(acceleration: [R; 2], (sin, cos): (R, R), turning: Option<[R; 2]>) -> Self {
        let mut frame = Self { acceleration, sin, cos, turning };
        frame.acceleration = frame.into_hand(acceleration);
        frame
    }

    /// The components along the hand's axes of a vector that is given along fixed axes.
    #[inline(always)]
    pub fn into_hand(&self, [x, y]: [R; 2]) -> [R; 2] {
        [x.dot2(self.cos, y, self.sin), y.dot2(self.cos, -x, self.sin)]
    }

    /// The components along fixed axes of a vector that is given along the hand's.
    pub fn into_fixed(&self, [x, y]: [R; 2]) -> [R; 2] {
        [x.dot2(self.cos, -y, self.sin), y.dot2(self.cos, x, self.sin)]
    }

    /// What an accelerometer at the frame's origin reads, (a^_x, a^_y): that of a hand at rest reads (0, g).
    #[inline(always)]
    pub fn felt(&self, gravity: R) -> [R; 2] {
        let [x, y] = self.acceleration;
        [gravity.mul_add(self.sin, x), gravity.mul_add(self.cos, y)]
    }

    /// The motion in numbers that do not vary.
    pub fn constant(own: &FrameMotion<f64>) -> Self {
        let FrameMotion { acceleration, sin, cos, turning } = *own;
        let turning = turning.map(|rates| rates.map(R::constant));
        let acceleration = acceleration.map(R::constant);
        Self { acceleration, sin: R::constant(sin), cos: R::constant(cos), turning }
    }
}

/// The masses and lengths on which the forces of the frame's motion depend.
#[derive(Debug, Clone, Copy)]
pub struct Carried<R> {
    /// g; zero for a hand at rest, whose bodies have weights instead.
    gravity: R,
    /// M and I of the object.
    object: [R; 2],
    /// I_i, M_i, L_i and W_i of both fingers.
    inertias: [R; 2],
    finger_masses: [R; 2],
    lengths: [R; 2],
    root_offsets: [R; 2],
}

impl<R: Real> Carried<R> {
    #[inline(always)]
    pub(super) fn new(source: &impl Source<R>, gravity: R) -> Self {
        let zero = [R::zero(); 2];
        let (mut inertias, mut finger_masses, mut lengths, mut root_offsets) = (zero, zero, zero, zero);
        for i in 0..2 {
            inertias[i] = source.number(|p| p.fingers[i].inertia);
            finger_masses[i] = source.number(|p| p.fingers[i].mass);
            lengths[i] = source.number(|p| p.fingers[i].length);
            root_offsets[i] = source.number(|p| p.fingers[i].root_offset);
        }
        let object = [source.number(|p| p.grasped.mass), source.number(|p| p.grasped.inertia)];
        Self { gravity, object, inertias, finger_masses, lengths, root_offsets }
    }

    /// The forces of the frame's motion, (M1) to (M4), with `force` along fixed axes on the object added, for
    /// coordinates and velocities of which only the object's and the fingers' are read.
    #[inline(always)]
    pub fn loads(
        &self,
        frame: &FrameMotion<R>,
        force: &[R; 3],
        q: &Coordinates<R>,
        p: &Coordinates<R>,
    ) -> FrameLoads<R> {
        let ([x, y, _], [u, v, _]) = (q.object, p.object);
        let [ax, ay] = frame.felt(self.gravity);
        let (mut along, mut across, mut moment) = (ax, ay, R::zero());
        let (theta, mut fingers) = (q.object[2], [R::zero(); 2]);
        let (sin_theta, cos_theta) = theta.sin_cos();
        for (i, finger) in fingers.iter_mut().enumerate() {
            let (mass, length) = (self.finger_masses[i], self.lengths[i]);
            // As the contact computes them from theta_p, so that an acceleration upwards has the bits of a gravity.
            let (sin_tilt, cos_tilt) = (q.finger[i] + signed(i, theta)).sin_cos();
            let sin = sin_tilt.dot2(cos_theta, signed(i, -cos_tilt), sin_theta);
            let cos = cos_tilt.dot2(cos_theta, signed(i, sin_tilt), sin_theta);
            *finger = (mass * ay * length) * sin - signed(i, (mass * ax * length) * cos);
            if let Some([omega, omega_rate]) = frame.turning {
                let lever = (mass * self.root_offsets[i]) * length;
                *finger = *finger + signed(i, omega_rate * lever.neg_mul_add(sin, self.inertias[i]));
                *finger = (omega * omega * lever).neg_mul_add(cos, *finger);
            }
        }
        let [mass, inertia] = self.object;
        if let Some([omega, omega_rate]) = frame.turning {
            let (square, twice) = (omega * omega, omega + omega);
            along = along - omega_rate.dot2(y, twice, v) - square * x;
            across = across + omega_rate.dot2(x, twice, u) - square * y;
            moment = -(inertia * omega_rate);
        }
        let object = [-(mass * along), -(mass * across), moment];
        let [x, y] = frame.into_hand([force[0], force[1]]);
        let external = [x, y, force[2]];
        FrameLoads {
            force: [external[0] + object[0], external[1] + object[1], external[2] + object[2]],
            fingers,
            object,
            external: dot(&external, &p.object),
            motion: dot(&object, &p.object) + fingers[0].dot2(p.finger[0], fingers[1], p.finger[1]),
        }
    }
}

/// The forces of the frame's motion, gravity included, at a state.
#[derive(Debug, Clone, Copy)]
pub struct FrameLoads<R> {
    /// Those on the object and the external force, along the hand's axes, and the moments.
    pub force: [R; 3],
    /// Generalised forces on the fingers, N m (M4).
    pub fingers: [R; 2],
    /// Those on the object alone, (M1) to (M3).
    pub object: [R; 3],
    /// The power of the external force, W.
    pub external: R,
    /// The power of the forces of the motion, W.
    pub motion: R,
}
