//! One contact at one state, (7)-(12), (25)-(30): where it is, its rows of Phi, and their rates.
//!
//! A contact is made of three parts, each of which has a table of its kinds:
//!
//! | part | answers | kinds |
//! |---|---|---|
//! | [`mechanism`] | the tip's centre and its tilt, from the finger's coordinate | a link about its root, a jaw, a parallelogram |
//! | [`shape`] | the distance of the tip's centre from the object's side, the normal there, the place along the side | parallel and tilted faces, arcs |
//! | [`law`] | the tip's elastic energy and its gradient | (5), powers of the compression, measured curves |
//!
//! This file composes them. Equations, solves and methods see only a [`Contact`] and the gradient of a law. Where else a new
//! kind is named (inertia, reach, ends), docs/architecture.md lists.
//!
//! The paper's contact, a link on a parallel face, is compiled into the equations; three sines and cosines serve both
//! sides. A contact of another mechanism or side is computed by one function, `PartsAt::contact`, which is called.

pub(crate) mod law;
pub(crate) mod mechanism;
pub(crate) mod shape;

use std::fmt::Debug;
use std::marker::PhantomData;

use crate::model::contact::mechanism::{Arm, Jaw, Mechanism, OneLink};
use crate::model::contact::shape::ParallelFace;
use crate::model::{Coordinates, Frame, Source, Surface};
use crate::number::{LaneTask, Real, inlined, signed, task};

/// The contacts for which code is compiled: the paper's alone, others alone, or any.
pub trait Parts: Copy + Debug {
    const PAPERS: bool = false;
    const OTHERS: bool = false;

    /// The numbers of other parts, if there are any.
    #[inline(always)]
    fn numbers<R: Real, T>(numbers: &Option<T>) -> Option<&T> {
        match numbers {
            _ if Self::PAPERS || !R::ANY_PARTS => None,
            Some(numbers) => Some(numbers),
            None if Self::OTHERS => unreachable!("equations of other parts have their numbers"),
            None => None,
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Papers;

impl Parts for Papers {
    const PAPERS: bool = true;
}

/// Contacts whose mechanisms and sides are computed by one function, whatever they are.
#[derive(Debug, Clone, Copy)]
pub struct Others;

impl Parts for Others {
    const OTHERS: bool = true;
}

#[derive(Debug, Clone, Copy)]
pub struct Any;

impl Parts for Any {}

/// The parts of a contact that say where it is: all but the law of the tip.
#[derive(Debug, Clone, Copy)]
pub struct Side<R> {
    link: OneLink<R>,
    face: ParallelFace<R>,
    /// The radius a of the tip.
    pub(crate) radius: R,
    /// The mechanism and the side, if the scene has not the paper's equations.
    others: Option<(Mechanism<R>, Surface<R>)>,
}

task! {
    ['a, R: Real, S: Source<R>] Build<'a, S>(source: &'a S, i: usize) for R => (Mechanism<R>, Surface<R>) =
        (Mechanism::new(source, i), Surface::new(source, i))
}

impl<R: Real> Side<R> {
    #[inline(always)]
    fn new(source: &impl Source<R>, i: usize) -> Self {
        let mut others = None;
        if R::ANY_PARTS && !source.kinds().has_the_papers_geometry() {
            others = Some(R::outlined(Build { source, i }));
        }
        Self {
            link: OneLink::new(source, i),
            face: ParallelFace::new(source, i),
            radius: source.number(|p| p.tips[i].radius),
            others,
        }
    }

    inlined! {
        pub(crate) is_curved(&self) -> bool =
            matches!(Any::numbers::<R, _>(&self.others), Some((_, surface)) if surface.curved);
        pub both(source: &impl Source<R>) -> [Self; 2] = [Self::new(source, 0), Self::new(source, 1)];
    }

    #[inline(always)]
    pub(crate) fn jaw(&self) -> Option<&Jaw<R>> {
        match Any::numbers::<R, _>(&self.others) {
            Some((Mechanism::Jaw(jaw), _)) => Some(jaw),
            _ => None,
        }
    }

    /// theta_pi (6), the angle between the tip's base and the side, with its sine and cosine.
    #[inline(always)]
    pub fn tilt<P: Parts>(&self, i: usize, q: &Coordinates<R>) -> (R, R, R) {
        if P::numbers::<R, _>(&self.others).is_some() {
            let contact = Contact::<R, P>::alone(i, self, q, &Coordinates::zero());
            return (contact.tilt, contact.sin_tilt, contact.cos_tilt);
        }
        let tilt = q.finger[i] + signed(i, q.object[2]);
        let (sin, cos) = tilt.sin_cos();
        (tilt, sin, cos)
    }

    #[inline(always)]
    pub fn tilt_rate(&self, i: usize, q: &Coordinates<R>, p: &Coordinates<R>) -> R {
        if Any::numbers::<R, _>(&self.others).is_some() {
            return Contact::<R, Any>::alone(i, self, q, p).tilt_rate;
        }
        p.finger[i] + signed(i, p.object[2])
    }
}

/// One contact at one state: residuals, the row entries of (25), and Phi-dot p.
#[derive(Debug, Clone, Copy)]
pub struct Contact<R, P = Any> {
    /// theta_pi (6).
    pub tilt: R,
    pub sin_tilt: R,
    pub cos_tilt: R,
    pub tilt_rate: R,
    /// sin theta_i and cos theta_i, by which gravity (43) and the hand's motion turn the finger; of a jaw its travel, and
    /// zero.
    pub sin_finger: R,
    pub cos_finger: R,
    /// The place of the contact along the side, up to its sign; on a parallel face s_i G_i (11).
    pub place: R,
    papers: bool,
    /// What another contact than the paper's has beside it.
    beside: Beside<R>,
    parts: PhantomData<P>,
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

/// What a contact has whose parts are not the paper's.
#[derive(Debug, Clone, Copy)]
pub struct Beside<R> {
    /// The side's normal at the contact, along the object's axes: cosine and sine of its angle.
    pub normal: [R; 2],
    /// T_i, the derivatives of theta_pi: by the object's way along the side, by its turn, and by the finger's
    /// coordinate. A couple tau of the tip is the generalised force -tau T_i. The paper's are 0, s_i and 1.
    pub tilt_by: [R; 3],
}

/// Where the contact is on the constraints: d_n, then the rates of d_n and d_t.
type Determined<R> = (R, [R; 2]);

impl<R: Real, P: Parts> Contact<R, P> {
    /// The contact of a link and a parallel face, in the object's own frame, where finger i has the tilt
    /// theta_pi = theta_i + s_i theta (6).
    #[inline(always)]
    fn new(
        i: usize,
        side: &Side<R>,
        frame: &Frame<R>,
        arm: &Arm<R>,
        d_n: R,
        [d_n_rate, d_t_rate]: [R; 2],
    ) -> Self {
        let Frame { omega, u, v, .. } = *frame;
        // `normal` and `across` are -t.O' and s_i n.O', the way of the tip's centre for a unit of the coordinate.
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
            tilt_rate,
            sin_finger,
            cos_finger,
            place: a,
            papers: true,
            beside: Beside { normal: [R::zero(); 2], tilt_by: [R::zero(); 3] },
            parts: PhantomData,
            a,
            b,
            e,
            f,
            holonomic: (sx - thickness) - side.face.distance,
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
        let deformation = (q.compression[i], [p.compression[i], p.shear[i]]);
        if const { R::ANY_PARTS && !P::PAPERS }
            && let Some(parts) = P::numbers::<R, _>(&side.others)
        {
            let finger = [q.finger[i], p.finger[i]];
            let at = PartsAt { i, parts, radius: side.radius, object: *object, finger };
            return R::outlined(InParts {
                at,
                constrained: false,
                own: &mut { deformation },
                _parts: PhantomData,
            });
        }
        let arm = side.link.arm(i, object, q.finger[i], p.finger[i]);
        Self::new(i, side, object, &arm, deformation.0, deformation.1)
    }

    /// [`Contact::anywhere`] for a single contact.
    #[inline(always)]
    fn alone(i: usize, side: &Side<R>, q: &Coordinates<R>, p: &Coordinates<R>) -> Self {
        Self::anywhere(i, side, &Frame::of_object(q.object, p.object), q, p)
    }

    /// The contact on the constraints, with the d_n, d_n-dot and d_t-dot that the constraints determine.
    #[inline(always)]
    pub(super) fn constrained(
        i: usize,
        side: &Side<R>,
        object: &Frame<R>,
        angle: R,
        turn: R,
    ) -> (Self, Determined<R>) {
        if const { R::ANY_PARTS && !P::PAPERS }
            && let Some(parts) = P::numbers::<R, _>(&side.others)
        {
            let at = PartsAt { i, parts, radius: side.radius, object: *object, finger: [angle, turn] };
            let mut own = (R::zero(), [R::zero(); 2]);
            let contact = R::outlined(InParts { at, constrained: true, own: &mut own, _parts: PhantomData });
            return (contact, own);
        }
        let arm = side.link.arm(i, object, angle, turn);
        let d_n = (side.radius + side.face.distance) - arm.sx;
        let still = Self::new(i, side, object, &arm, d_n, [R::zero(); 2]);
        let rates = [-still.holonomic_rate, -still.nonholonomic];
        (Self::new(i, side, object, &arm, d_n, rates), (d_n, rates))
    }

    inlined! {
        beside(&self) -> Option<&Beside<R>> = if self.is_the_papers() { None } else { Some(&self.beside) };
        pub(crate) is_the_papers(&self) -> bool = P::PAPERS || !R::ANY_PARTS || (!P::OTHERS && self.papers);
    }

    /// The components along the axes of the side of a vector along the object's axes.
    #[inline(always)]
    pub(crate) fn in_side_axes(&self, [along, across]: [R; 2]) -> [R; 2] {
        match self.beside() {
            None => [along, across],
            Some(&Beside { normal: [cos, sin], .. }) => {
                [along.dot2(cos, across, sin), across.dot2(cos, -along, sin)]
            }
        }
    }

    /// The components along the object's axes of a vector along the axes of the side.
    #[inline(always)]
    pub(crate) fn in_object_axes(&self, [along, across]: [R; 2]) -> [R; 2] {
        match self.beside() {
            None => [along, across],
            Some(&Beside { normal: [cos, sin], .. }) => {
                [along.dot2(cos, -across, sin), across.dot2(cos, along, sin)]
            }
        }
    }

    /// Rows H_i and N_i of Phi times a vector. `along` and `across` are the components of the vector along the object's
    /// own axes; `object` and `finger` belong to the coordinates of the object's turn and of the finger; `d_n` and `d_t`
    /// belong to the two deformations of the tip.
    #[inline(always)]
    pub(super) fn rows(&self, i: usize, [along, across, object, finger]: [R; 4], d_n: R, d_t: R) -> (R, R) {
        let [along, across] = self.in_side_axes([along, across]);
        (
            (signed(i, along) + d_n) + self.a.dot2(object, self.b, finger),
            (across + d_t) + self.e.dot2(object, self.f, finger),
        )
    }

    /// The derivatives of theta_pi by the object's way along its own axes, by its turn and by the finger's coordinate.
    #[inline(always)]
    pub(crate) fn tilt_by(&self, i: usize) -> ([R; 2], R, R) {
        let (zero, one) = (R::zero(), R::constant(1.0));
        match self.beside() {
            None => ([zero; 2], signed(i, one), one),
            Some(&Beside { tilt_by: [along, turn, finger], .. }) => {
                (self.in_object_axes([zero, along]), turn, finger)
            }
        }
    }

    inlined! {
        /// The components, along the object's own axes, of the force on the object that these multipliers are.
        pub(crate) push(&self, i: usize, [normal, tangential]: [R; 2]) -> [R; 2] =
            self.in_object_axes([signed(i, normal), tangential]);
        /// The generalised force of multipliers on the object's turn.
        pub(crate) moment(&self, [normal, tangential]: [R; 2]) -> R = self.a.dot2(normal, self.e, tangential);
        /// The generalised force of multipliers on the finger.
        pub(crate) torque(&self, [normal, tangential]: [R; 2]) -> R = self.b.dot2(normal, self.f, tangential);
    }
}

/// A contact of any parts: docs/equations.md, "Other mechanisms, sides and laws".
struct PartsAt<'a, R> {
    i: usize,
    parts: &'a (Mechanism<R>, Surface<R>),
    radius: R,
    object: Frame<R>,
    /// The finger's coordinate and its rate.
    finger: [R; 2],
}

task! {
    /// Computes a contact at a deformation, which is set to that of the constraints if the contact is on them. The contact is
    /// returned alone, so that it need not be copied to its place.
    ['a, R: Real, P: Parts]
    InParts<'a, R, P>(at: PartsAt<'a, R>, constrained: bool, own: &'a mut Determined<R>, _parts: PhantomData<P>)
    for R => Contact<R, P> = at.contact(constrained, own)
}

impl<R: Real> PartsAt<'_, R> {
    /// The components along the object's axes of a vector inwards and upwards.
    #[inline(always)]
    fn along_object(&self, [inwards, up]: [R; 2]) -> [R; 2] {
        let (sin, cos, x) = (self.object.sin, self.object.cos, signed(self.i, inwards));
        [x.dot2(cos, up, sin), up.dot2(cos, -x, sin)]
    }

    /// The contact at this deformation, which is first set to the one that the constraints determine if it is on them.
    #[inline(always)]
    fn contact<P>(&self, constrained: bool, deformation: &mut Determined<R>) -> Contact<R, P> {
        let (i, [z, z_rate]) = (self.i, self.finger);
        let (mechanism, surface) = self.parts;
        let Frame { sin, cos, theta, omega, x, y, u, v } = self.object;
        let base = mechanism.placed(z);
        let centre = self.along_object(base.centre);
        let (rx, ry) = (x - centre[0], y - centre[1]);
        let foot = surface.foot(i, [-rx, -ry]);
        let [n_cos, n_sin] = foot.normal;
        let (k, one) = (foot.curvature, R::constant(1.0));
        // Components along n and t; a vector r is from the tip's centre to the centre of gravity.
        let (r_n, r_t) = (rx.dot2(n_cos, ry, n_sin), ry.dot2(n_cos, -rx, n_sin));
        let ([way_x, way_y], [bend_x, bend_y]) = (self.along_object(base.way), self.along_object(base.bend));
        let (way_n, way_t) = (way_x.dot2(n_cos, way_y, n_sin), way_y.dot2(n_cos, -way_x, n_sin));
        let (bend_n, bend_t) = (bend_x.dot2(n_cos, bend_y, n_sin), bend_y.dot2(n_cos, -bend_x, n_sin));
        let r_n_rate = way_n.neg_mul_add(z_rate, u.dot2(n_cos, v, n_sin));
        let r_t_rate = way_t.neg_mul_add(z_rate, v.dot2(n_cos, -u, n_sin));
        let speed_t = r_n.neg_mul_add(omega, r_t_rate);
        let speed_n = r_t.mul_add(omega, r_n_rate);
        let turn = base.turn.mul_add(z_rate, signed(i, omega));
        let normal_turn = omega + signed(i, k * speed_t);
        // The angle of the normal, then theta_p = phi + s_i Theta.
        let (sin_normal, cos_normal) = (sin.dot2(n_cos, cos, n_sin), cos.dot2(n_cos, -sin, n_sin));
        let [angle, sin_base, cos_base] = base.angle;
        if constrained {
            let rates = [-signed(i, speed_n), -foot.distance.mul_add(turn, speed_t)];
            *deformation = (self.radius - foot.distance, rates);
        }
        let (d_n, [d_n_rate, d_t_rate]) = *deformation;
        let thickness = self.radius - d_n;
        let square = z_rate * z_rate;
        Contact {
            tilt: angle + (signed(i, theta) + foot.tilt),
            sin_tilt: sin_base.dot2(cos_normal, signed(i, cos_base), sin_normal),
            cos_tilt: cos_base.dot2(cos_normal, -signed(i, sin_base), sin_normal),
            tilt_rate: k.mul_add(speed_t, turn),
            sin_finger: base.gravity[0],
            cos_finger: base.gravity[1],
            place: signed(i, -foot.place),
            papers: false,
            beside: Beside {
                normal: foot.normal,
                tilt_by: [k, k.neg_mul_add(r_n, signed(i, one)), k.neg_mul_add(way_t, base.turn)],
            },
            parts: PhantomData,
            a: signed(i, r_t),
            b: signed(i, -way_n),
            e: signed(i, thickness) - r_n,
            f: thickness.mul_add(base.turn, -way_t),
            holonomic: foot.distance - thickness,
            holonomic_rate: signed(i, speed_n) + d_n_rate,
            nonholonomic: thickness.mul_add(turn, speed_t) + d_t_rate,
            bias_h: signed(i, bend_n.neg_mul_add(square, normal_turn.dot2(speed_t, omega, r_t_rate))),
            bias_n: -(bend_t.mul_add(square, normal_turn.dot2(speed_n, omega, r_n_rate)) + d_n_rate * turn),
        }
    }
}
