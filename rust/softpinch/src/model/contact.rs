//! One contact at one state, (7)-(12), (25)-(30): where it is, its rows of Phi, and their rates.
//!
//! A contact is made of three parts, each of which has a table of its kinds:
//!
//! | part | answers | kinds |
//! |---|---|---|
//! | [`mechanism`] | the tip's centre and its tilt, from the finger's coordinate | a link about its root |
//! | [`shape`] | the frame of the object's side, its distance from the centre of gravity, the place along it | parallel and tilted faces |
//! | [`law`] | the tip's elastic energy and its gradient | (5), a power of the compression |
//!
//! This file composes them. Everything above it sees only a [`Contact`] and the gradient of a law, so that a new kind is
//! one file and one line in the table of its part.
//!
//! A contact is computed in the frame of its side, where the side's normal is the first axis. In the frame of a parallel
//! face, which is the object's own, finger i has the tilt theta_pi = theta_i + s_i theta (6), so that three sines and
//! cosines serve both contacts.

pub mod law;
pub mod mechanism;
pub mod shape;

use crate::model::contact::mechanism::{Arm, Mechanism};
use crate::model::contact::shape::{Frame, Shape};
use crate::model::coordinates::Coordinates;
use crate::model::source::Source;
use crate::number::real::{Real, signed};

pub use crate::model::contact::shape::Direction;

/// The parts of a contact that say where it is: all but the law of the tip.
#[derive(Debug, Clone, Copy)]
pub struct Side<R> {
    mechanism: Mechanism<R>,
    shape: Shape<R>,
    /// The radius a of the tip.
    radius: R,
}

impl<R: Real> Side<R> {
    #[inline(always)]
    fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            mechanism: Mechanism::new(source, i),
            shape: Shape::new(source, i),
            radius: source.number(|p| p.tips[i].radius),
        }
    }

    /// Both sides of a scene.
    #[inline(always)]
    pub fn both(source: &impl Source<R>) -> [Self; 2] {
        [Self::new(source, 0), Self::new(source, 1)]
    }

    /// The radius a of the tip.
    #[inline(always)]
    pub(crate) fn radius(&self) -> R {
        self.radius
    }

    /// theta_pi (6), the angle between the tip's base and the side.
    #[inline(always)]
    pub fn tilt(&self, i: usize, q: &Coordinates<R>) -> R {
        self.shape.tilt(i, self.mechanism.tilt(q.finger[i]), q)
    }

    /// The rate of theta_pi.
    #[inline(always)]
    pub fn tilt_rate(&self, i: usize, p: &Coordinates<R>) -> R {
        self.shape.tilt_rate(i, self.mechanism.tilt(p.finger[i]), p)
    }
}

/// One contact at one state: residuals, the row entries of (25), and Phi-dot p.
#[derive(Debug, Clone, Copy)]
pub struct Contact<R> {
    /// theta_pi (6).
    pub tilt: R,
    /// sin theta_pi.
    pub sin_tilt: R,
    /// cos theta_pi.
    pub cos_tilt: R,
    /// sin theta_i, by which gravity turns the finger (43).
    pub sin_finger: R,
    /// cos theta_i.
    pub cos_finger: R,
    /// The place of the contact along the side, up to its sign; on a parallel face s_i G_i (11).
    pub place: R,
    /// The direction of the side's normal in the object's frame.
    pub direction: Direction<R>,
    /// A_i (26).
    pub a: R,
    /// B_i (27).
    pub b: R,
    /// E_i (28).
    pub e: R,
    /// F_i (29).
    pub f: R,
    /// C_i^H (9).
    pub holonomic: R,
    /// The rate of C_i^H: row H_i of Phi p.
    pub holonomic_rate: R,
    /// C_i^N (12): row N_i of Phi p.
    pub nonholonomic: R,
    /// b_i^H, row H_i of Phi-dot p (22).
    pub bias_h: R,
    /// b_i^N, row N_i of Phi-dot p (23).
    pub bias_n: R,
}

impl<R: Real> Contact<R> {
    /// The contact of an arm in the frame of its side. `normal` and `across` of the arm are -t.O' and s_i n.O', the way of
    /// the tip's centre for a unit of the finger's coordinate.
    #[inline(always)]
    fn new(
        i: usize,
        side: &Side<R>,
        (frame, direction): &(Frame<R>, Direction<R>),
        arm: &Arm<R>,
        d_n: R,
        [d_n_rate, d_t_rate]: [R; 2],
    ) -> Self {
        let Frame { omega, u, v, .. } = *frame;
        let Arm { tilt, sin_tilt, cos_tilt, sin_finger, cos_finger, normal, across, sx, g, turn } = *arm;
        let thickness = side.radius - d_n;
        let (a, b) = (signed(i, g), -across);
        let (e, f) = (signed(i, thickness - sx), normal + thickness);
        // Rates of theta_pi, G_i and s_i X_i, then b_i^H and b_i^N of (22) and (23).
        let tilt_rate = turn + signed(i, omega);
        let g_rate = normal.mul_add(turn, signed(i, sx).neg_mul_add(omega, v));
        let sx_rate = b.mul_add(turn, signed(i, g.mul_add(omega, u)));
        let swept = (u + signed(i, sx_rate + d_n_rate)) * omega;
        Self {
            tilt,
            sin_tilt,
            cos_tilt,
            sin_finger,
            cos_finger,
            place: side.shape.place(a),
            direction: *direction,
            a,
            b,
            e,
            f,
            holonomic: side.holonomic(arm, d_n),
            holonomic_rate: (signed(i, u) + d_n_rate) + a.dot2(omega, b, turn),
            nonholonomic: (v + d_t_rate) + e.dot2(omega, f, turn),
            bias_h: (normal * tilt_rate).mul_add(turn, signed(i, (v + g_rate) * omega)),
            bias_n: across.mul_add(tilt_rate, -d_n_rate).mul_add(turn, -swept),
        }
    }

    /// The contact at any q and p, on the constraints or off them.
    #[inline(always)]
    pub(super) fn anywhere(
        i: usize,
        side: &Side<R>,
        object: &Frame<R>,
        q: &Coordinates<R>,
        p: &Coordinates<R>,
    ) -> Self {
        let frame = side.shape.frame(i, object);
        let arm = side.mechanism.arm(i, &frame.0, q.finger[i], p.finger[i]);
        Self::new(i, side, &frame, &arm, q.compression[i], [p.compression[i], p.shear[i]])
    }

    /// The contact on the constraints, with the d_n, d_n-dot and d_t-dot that the constraints determine.
    #[inline(always)]
    pub(super) fn constrained(
        i: usize,
        side: &Side<R>,
        object: &Frame<R>,
        angle: R,
        turn: R,
    ) -> (Self, R, [R; 2]) {
        let frame = side.shape.frame(i, object);
        let arm = side.mechanism.arm(i, &frame.0, angle, turn);
        let d_n = (side.radius + side.shape.distance()) - arm.sx;
        let still = Self::new(i, side, &frame, &arm, d_n, [R::zero(); 2]);
        let rates = [-still.holonomic_rate, -still.nonholonomic];
        (Self::new(i, side, &frame, &arm, d_n, rates), d_n, rates)
    }

    /// Rows H_i and N_i of Phi times a vector. `along` and `across` are the components of the vector along the object's
    /// own axes; `object` and `finger` belong to the coordinates of the object's turn and of the finger; `d_n` and `d_t`
    /// belong to the two deformations of the tip.
    #[inline(always)]
    pub(super) fn rows(&self, i: usize, [along, across, object, finger]: [R; 4], d_n: R, d_t: R) -> (R, R) {
        let [along, across] = self.direction.into_side([along, across]);
        (
            (signed(i, along) + d_n) + self.a.dot2(object, self.b, finger),
            (across + d_t) + self.e.dot2(object, self.f, finger),
        )
    }

    /// The components, along the object's own axes, of the force on the object that these multipliers are.
    #[inline(always)]
    pub(crate) fn push(&self, i: usize, [normal, tangential]: [R; 2]) -> [R; 2] {
        self.direction.out_of_side([signed(i, normal), tangential])
    }

    /// The generalised force of multipliers on the object's turn.
    #[inline(always)]
    pub(crate) fn moment(&self, [normal, tangential]: [R; 2]) -> R {
        self.a.dot2(normal, self.e, tangential)
    }

    /// The generalised force of multipliers on the finger.
    #[inline(always)]
    pub(crate) fn torque(&self, [normal, tangential]: [R; 2]) -> R {
        self.b.dot2(normal, self.f, tangential)
    }
}

impl<R: Real> Side<R> {
    /// C_i^H (9) for the compression `d_n`.
    #[inline(always)]
    fn holonomic(&self, arm: &Arm<R>, d_n: R) -> R {
        (arm.sx - (self.radius - d_n)) - self.shape.distance()
    }
}
