//! (7)-(12), (25)-(30): the positions of the tips, the residuals of the constraints, and the entries of the
//! constraint matrix and of its rate.
//!
//! The geometry is expressed in the object's own frame, which is turned by theta. In this frame finger i has
//! the tilt theta_pi = theta_i + s_i theta (6), so three sines and cosines serve the whole geometry. With
//! n_i = L sin theta_pi + d_f cos theta_pi and t_i = L cos theta_pi - d_f sin theta_pi (from the finger's root
//! to the tip's centre, along and across the object's normal) the tip's centre is at s_i (n_i - W_f C) along
//! the normal and at t_i + s_i W_f S along the face.

use nalgebra::SMatrix;

use crate::model::source::Source;
use crate::number::real::{Real, signed};

/// Index of each coordinate in q and p.
pub mod index {
    /// x of the centre of gravity.
    pub const X: usize = 0;
    /// y of the centre of gravity.
    pub const Y: usize = 1;
    /// Orientation of the object.
    pub const THETA: usize = 2;
    /// Angle of the right finger; the angle of the left finger is next.
    pub const FINGER: usize = 3;
    /// Compression of the right tip; the compression of the left tip is next.
    pub const D_N: usize = 5;
    /// Shear of the right tip; the shear of the left tip is next.
    pub const D_T: usize = 7;
}
use index::{D_N, D_T, FINGER, THETA, X, Y};

/// Lengths of one side.
#[derive(Debug, Clone, Copy)]
pub struct Side<R> {
    length: R,
    root_offset: R,
    half_thickness: R,
    radius: R,
    /// W/2 + s_i w, from the centre of gravity to the face.
    face: R,
}

impl<R> Side<R> {
    #[inline(always)]
    fn new(source: &impl Source<R>, i: usize) -> Self {
        Self {
            length: source.number(|p| p.fingers[i].length),
            root_offset: source.number(|p| p.fingers[i].root_offset),
            half_thickness: source.number(|p| p.fingers[i].half_thickness),
            radius: source.number(|p| p.tips[i].radius),
            face: source.number(|p| 0.5 * p.grasped.width + signed(i, p.grasped.com_offset)),
        }
    }

    /// The radius a of the tip.
    #[inline(always)]
    pub(crate) fn radius(&self) -> R
    where
        R: Copy,
    {
        self.radius
    }

    /// Both sides of a scene.
    #[must_use]
    #[inline(always)]
    pub fn both(source: &impl Source<R>) -> [Self; 2] {
        [Self::new(source, 0), Self::new(source, 1)]
    }
}

/// One contact at one state: residuals, the row entries of (25), and Phi-dot p.
#[derive(Debug, Clone, Copy)]
pub struct Contact<R> {
    /// sin theta_pi.
    pub sin_tilt: R,
    /// cos theta_pi.
    pub cos_tilt: R,
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

/// Position and velocity of the object in its own frame.
#[derive(Clone, Copy)]
struct ObjectFrame<R> {
    sin: R,
    cos: R,
    theta: R,
    omega: R,
    x: R,
    y: R,
    u: R,
    v: R,
}

impl<R: Real> ObjectFrame<R> {
    #[inline(always)]
    fn new(place: [R; 3], velocity: [R; 3]) -> Self {
        let [x, y, theta] = place;
        let (sin, cos) = theta.sin_cos();
        Self {
            sin,
            cos,
            theta,
            omega: velocity[2],
            x: x.dot2(cos, y, sin),
            y: y.dot2(cos, -x, sin),
            u: velocity[0].dot2(cos, velocity[1], sin),
            v: velocity[1].dot2(cos, -velocity[0], sin),
        }
    }
}

/// The position of one fingertip in the object's frame, without any deformation.
#[derive(Clone, Copy)]
struct Arm<R> {
    sin_tilt: R,
    cos_tilt: R,
    /// n_i and t_i of the module's documentation.
    normal: R,
    across: R,
    /// s_i X_i.
    sx: R,
    /// G_i (11).
    g: R,
    turn: R,
}

impl<R: Real> Arm<R> {
    #[inline(always)]
    fn new(i: usize, side: &Side<R>, object: &ObjectFrame<R>, angle: R, turn: R) -> Self {
        let (sin_tilt, cos_tilt) = (angle + signed(i, object.theta)).sin_cos();
        let normal = side.length.dot2(sin_tilt, side.half_thickness, cos_tilt);
        let across = side.length.dot2(cos_tilt, -side.half_thickness, sin_tilt);
        let sx = signed(i, object.x) + side.root_offset.mul_add(object.cos, -normal);
        let g = signed(i, side.root_offset).neg_mul_add(object.sin, object.y) - across;
        Self { sin_tilt, cos_tilt, normal, across, sx, g, turn }
    }

    /// C_i^H (9) for the compression `d_n`.
    #[inline(always)]
    fn holonomic(&self, side: &Side<R>, d_n: R) -> R {
        (self.sx - (side.radius - d_n)) - side.face
    }
}

impl<R: Real> Contact<R> {
    #[inline(always)]
    fn new(
        i: usize,
        side: &Side<R>,
        object: &ObjectFrame<R>,
        arm: &Arm<R>,
        d_n: R,
        [d_n_rate, d_t_rate]: [R; 2],
    ) -> Self {
        let ObjectFrame { omega, u, v, .. } = *object;
        let Arm { sin_tilt, cos_tilt, normal, across, sx, g, turn } = *arm;
        let thickness = side.radius - d_n;
        let (a, b) = (signed(i, g), -across);
        let (e, f) = (signed(i, thickness - sx), normal + thickness);
        // Rates of theta_pi, G_i and s_i X_i, then b_i^H and b_i^N of (22) and (23).
        let tilt_rate = turn + signed(i, omega);
        let g_rate = normal.mul_add(turn, signed(i, sx).neg_mul_add(omega, v));
        let sx_rate = b.mul_add(turn, signed(i, g.mul_add(omega, u)));
        let swept = (u + signed(i, sx_rate + d_n_rate)) * omega;
        Self {
            sin_tilt,
            cos_tilt,
            a,
            b,
            e,
            f,
            holonomic: arm.holonomic(side, d_n),
            holonomic_rate: (signed(i, u) + d_n_rate) + a.dot2(omega, b, turn),
            nonholonomic: (v + d_t_rate) + e.dot2(omega, f, turn),
            bias_h: (normal * tilt_rate).mul_add(turn, signed(i, (v + g_rate) * omega)),
            bias_n: across.mul_add(tilt_rate, -d_n_rate).mul_add(turn, -swept),
        }
    }

    /// Rows H_i and N_i of Phi times a vector. `along` is the component of the vector along the normal, times
    /// s_i; `across` is the component along the face; `object` and `finger` belong to the angles of the
    /// object and of the finger; `d_n` and `d_t` belong to the two deformations of the tip.
    #[inline(always)]
    fn rows(&self, [along, across, object, finger]: [R; 4], d_n: R, d_t: R) -> (R, R) {
        (
            (along + d_n) + self.a.dot2(object, self.b, finger),
            (across + d_t) + self.e.dot2(object, self.f, finger),
        )
    }

    /// The contact at any q and p, on the constraints or off them.
    #[inline(always)]
    fn anywhere(i: usize, side: &Side<R>, object: &ObjectFrame<R>, q: &[R; 9], p: &[R; 9]) -> Self {
        let arm = Arm::new(i, side, object, q[FINGER + i], p[FINGER + i]);
        Self::new(i, side, object, &arm, q[D_N + i], [p[D_N + i], p[D_T + i]])
    }

    /// The contact on the constraints, with the d_n, d_n-dot and d_t-dot that the constraints determine.
    #[inline(always)]
    fn constrained(
        i: usize,
        side: &Side<R>,
        object: &ObjectFrame<R>,
        angle: R,
        turn: R,
    ) -> (Self, R, [R; 2]) {
        let arm = Arm::new(i, side, object, angle, turn);
        let d_n = (side.radius + side.face) - arm.sx;
        let still = Self::new(i, side, object, &arm, d_n, [R::zero(); 2]);
        let rates = [-still.holonomic_rate, -still.nonholonomic];
        (Self::new(i, side, object, &arm, d_n, rates), d_n, rates)
    }
}

/// The whole geometry at one state.
#[derive(Debug, Clone, Copy)]
pub struct Geometry<R> {
    /// S = sin theta.
    pub sin: R,
    /// C = cos theta.
    pub cos: R,
    /// Right and left contact.
    pub contacts: [Contact<R>; 2],
}

impl<R: Real> Geometry<R> {
    /// The geometry at coordinates `q` and velocities `p`.
    #[inline(always)]
    pub fn new(sides: &[Side<R>; 2], q: &[R; 9], p: &[R; 9]) -> Self {
        let object = ObjectFrame::new([q[X], q[Y], q[THETA]], [p[X], p[Y], p[THETA]]);
        let contacts =
            [Contact::anywhere(0, &sides[0], &object, q, p), Contact::anywhere(1, &sides[1], &object, q, p)];
        Self { sin: object.sin, cos: object.cos, contacts }
    }

    /// The geometry on the constraints at a pose (x, y, theta, theta_1, theta_2) and its velocity. d_n
    /// follows from C^H = 0 (9), the rates of d_n and d_t follow from Phi p = 0 (25). Returns q (with the
    /// shears) and p as well.
    #[inline(always)]
    pub fn constrained(
        sides: &[Side<R>; 2],
        pose: &[R; 5],
        shear: &[R; 2],
        velocity: &[R; 5],
    ) -> (Self, [R; 9], [R; 9]) {
        let object = ObjectFrame::new([pose[0], pose[1], pose[2]], [velocity[0], velocity[1], velocity[2]]);
        let (right, n1, [n1_rate, t1_rate]) =
            Contact::constrained(0, &sides[0], &object, pose[FINGER], velocity[FINGER]);
        let (left, n2, [n2_rate, t2_rate]) =
            Contact::constrained(1, &sides[1], &object, pose[FINGER + 1], velocity[FINGER + 1]);
        let [x, y, theta, angle1, angle2] = *pose;
        let [vx, vy, omega, turn1, turn2] = *velocity;
        (
            Self { sin: object.sin, cos: object.cos, contacts: [right, left] },
            [x, y, theta, angle1, angle2, n1, n2, shear[0], shear[1]],
            [vx, vy, omega, turn1, turn2, n1_rate, n2_rate, t1_rate, t2_rate],
        )
    }

    /// The x and y components of a vector that is given along the object's normal and across it.
    #[inline(always)]
    pub fn outward(&self, along: R, across: R) -> [R; 2] {
        [along.dot2(self.cos, -across, self.sin), along.dot2(self.sin, across, self.cos)]
    }

    /// (C_1^H, C_2^H, C_1^N, C_2^N).
    #[inline(always)]
    pub fn residuals(&self) -> [R; 4] {
        let [right, left] = &self.contacts;
        [right.holonomic, left.holonomic, right.nonholonomic, left.nonholonomic]
    }

    /// Phi p: the rates of C^H, then C^N.
    #[inline(always)]
    pub fn constraint_velocity(&self) -> [R; 4] {
        let [right, left] = &self.contacts;
        [right.holonomic_rate, left.holonomic_rate, right.nonholonomic, left.nonholonomic]
    }

    /// Phi-dot p.
    #[inline(always)]
    pub fn bias(&self) -> [R; 4] {
        let [right, left] = &self.contacts;
        [right.bias_h, left.bias_h, right.bias_n, left.bias_n]
    }

    /// The share of Phi-dot p + Phi p-dot that prescribed accelerations of the fingers contribute: their
    /// columns of Phi.
    #[inline(always)]
    pub fn driven_bias(&self, [right_turn, left_turn]: [R; 2]) -> [R; 4] {
        let [right, left] = &self.contacts;
        [right.b * right_turn, left.b * left_turn, right.f * right_turn, left.f * left_turn]
    }

    /// Phi x for any vector x (25).
    #[inline(always)]
    pub fn phi_times(&self, x: &[R; 9]) -> [R; 4] {
        let along = x[X].dot2(self.cos, x[Y], self.sin);
        let across = x[Y].dot2(self.cos, -x[X], self.sin);
        let [right, left] = &self.contacts;
        let (h1, n1) = right.rows([-along, across, x[THETA], x[FINGER]], x[D_N], x[D_T]);
        let (h2, n2) = left.rows([along, across, x[THETA], x[FINGER + 1]], x[D_N + 1], x[D_T + 1]);
        [h1, h2, n1, n2]
    }

    /// Phi^T lambda, the generalised force of the multipliers (24).
    #[inline(always)]
    pub fn phi_transposed_times(&self, lambda: &[R; 4]) -> [R; 9] {
        let [h1, h2, n1, n2] = *lambda;
        let [right, left] = &self.contacts;
        let along = h2 - h1;
        let [x, y] = self.outward(along, n1 + n2);
        [
            x,
            y,
            right.a.dot2(h1, right.e, n1) + left.a.dot2(h2, left.e, n2),
            right.b.dot2(h1, right.f, n1),
            left.b.dot2(h2, left.f, n2),
            h1,
            h2,
            n1,
            n2,
        ]
    }

    /// sin theta_p of both tips.
    #[inline(always)]
    pub fn sin_tilt(&self) -> [R; 2] {
        [self.contacts[0].sin_tilt, self.contacts[1].sin_tilt]
    }

    /// s_i G_i (11) of both contacts.
    #[inline(always)]
    pub fn places(&self) -> [R; 2] {
        [self.contacts[0].a, self.contacts[1].a]
    }
}

impl Geometry<f64> {
    /// Phi (25): a row for each constraint in the order (H_1, H_2, N_1, N_2), a column for each coordinate of q.
    #[must_use]
    pub fn constraint_matrix(&self) -> SMatrix<f64, 4, 9> {
        let (s, c) = (self.sin, self.cos);
        let [r, l] = &self.contacts;
        let rows = [
            [-c, -s, r.a, r.b, 0.0, 1.0, 0.0, 0.0, 0.0],
            [c, s, l.a, 0.0, l.b, 0.0, 1.0, 0.0, 0.0],
            [-s, c, r.e, r.f, 0.0, 0.0, 0.0, 1.0, 0.0],
            [-s, c, l.e, 0.0, l.f, 0.0, 0.0, 0.0, 1.0],
        ];
        // nalgebra's matrices are arrays of columns.
        SMatrix::<f64, 9, 4>::from(rows).transpose()
    }
}
