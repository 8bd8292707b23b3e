//! Both contacts at one state: residuals, the constraint matrix and its rate (25).

use std::marker::PhantomData;

use nalgebra::SMatrix;

use crate::model::contact::Side;
use crate::model::{Any, Contact, Coordinates, Frame, Parameters, Parts};
use crate::number::{LaneTask, Real, inlined, task};

/// The whole geometry at one state.
#[derive(Debug, Clone, Copy)]
pub struct Geometry<R, P = Any> {
    /// S = sin theta.
    pub sin: R,
    /// C = cos theta.
    pub cos: R,
    /// Right and left contact.
    pub contacts: [Contact<R, P>; 2],
}

/// Two numbers of each contact, in the order of the rows of Phi.
macro_rules! rows {
    ($geometry:expr, $holonomic:ident, $nonholonomic:ident) => {{
        let [right, left] = &$geometry.contacts;
        [right.$holonomic, left.$holonomic, right.$nonholonomic, left.$nonholonomic]
    }};
}

task! {
    ['a, R: Real, P: Parts]
    Compute<'a, R, P>(sides: &'a [Side<R>; 2], q: &'a Coordinates<R>, p: &'a Coordinates<R>, _parts: PhantomData<P>)
    for R => Geometry<R, P> = Geometry::inlined(sides, q, p)
}

impl<R: Real, P: Parts> Geometry<R, P> {
    /// The geometry at coordinates `q` and velocities `p`.
    #[inline(always)]
    pub fn of(sides: &[Side<R>; 2], q: &Coordinates<R>, p: &Coordinates<R>) -> Self {
        // Steps and corrections of other parts share one piece of code.
        if const { P::OTHERS } { Self::called(sides, q, p) } else { Self::inlined(sides, q, p) }
    }

    /// [`Geometry::of`] in code that is called.
    #[inline(always)]
    pub fn called(sides: &[Side<R>; 2], q: &Coordinates<R>, p: &Coordinates<R>) -> Self {
        R::outlined(Compute { sides, q, p, _parts: PhantomData })
    }

    #[inline(always)]
    fn inlined(sides: &[Side<R>; 2], q: &Coordinates<R>, p: &Coordinates<R>) -> Self {
        let object = Frame::of_object(q.object, p.object);
        let right = Contact::anywhere(0, &sides[0], &object, q, p);
        let left = Contact::anywhere(1, &sides[1], &object, q, p);
        Self { sin: object.sin, cos: object.cos, contacts: [right, left] }
    }

    /// The geometry on the constraints at the object, the fingers and the shears of `q` and the rates of object and
    /// fingers in `p`. Sets d_n, which follows from C^H = 0 (9), and the rates of d_n and d_t, which follow from
    /// Phi p = 0 (25).
    #[inline(always)]
    pub fn constrained(sides: &[Side<R>; 2], q: &mut Coordinates<R>, p: &mut Coordinates<R>) -> Self {
        let object = Frame::of_object(q.object, p.object);
        let (right, (n1, [n1_rate, t1_rate])) =
            Contact::constrained(0, &sides[0], &object, q.finger[0], p.finger[0]);
        let (left, (n2, [n2_rate, t2_rate])) =
            Contact::constrained(1, &sides[1], &object, q.finger[1], p.finger[1]);
        q.compression = [n1, n2];
        (p.compression, p.shear) = ([n1_rate, n2_rate], [t1_rate, t2_rate]);
        Self { sin: object.sin, cos: object.cos, contacts: [right, left] }
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
    pub fn phi_times(&self, x: &Coordinates<R>) -> [R; 4] {
        let [first, second, turn] = x.object;
        let [along, across] = self.inward([first, second]);
        let [right, left] = &self.contacts;
        let (h1, n1) = right.rows(0, [along, across, turn, x.finger[0]], x.compression[0], x.shear[0]);
        let (h2, n2) = left.rows(1, [along, across, turn, x.finger[1]], x.compression[1], x.shear[1]);
        [h1, h2, n1, n2]
    }

    /// Phi^T lambda, the generalised force of the multipliers (24).
    #[inline(always)]
    pub fn phi_transposed_times(&self, lambda: &[R; 4]) -> Coordinates<R> {
        let [h1, h2, n1, n2] = *lambda;
        let [right, left] = &self.contacts;
        let (one, other) = (right.push(0, [h1, n1]), left.push(1, [h2, n2]));
        let [x, y] = self.outward(other[0] + one[0], one[1] + other[1]);
        Coordinates {
            object: [x, y, right.moment([h1, n1]) + left.moment([h2, n2])],
            finger: [right.torque([h1, n1]), left.torque([h2, n2])],
            compression: [h1, h2],
            shear: [n1, n2],
        }
    }

    /// The generalised forces -tau_i T_i of couples tau_i = dP/d theta_pi on the tips: on the object, and on the fingers.
    #[inline(always)]
    pub fn couples(&self, [right, left]: [R; 2]) -> ([R; 3], [R; 2]) {
        if self.is_the_papers() {
            return ([R::zero(), R::zero(), right - left], [-right, -left]);
        }
        let ([one, other], [r, l]) =
            ([self.contacts[0].tilt_by(0), self.contacts[1].tilt_by(1)], [-right, -left]);
        let [x, y] = self.outward(r.dot2(one.0[0], l, other.0[0]), r.dot2(one.0[1], l, other.0[1]));
        ([x, y, r.dot2(one.1, l, other.1)], [r * one.2, l * other.2])
    }

    inlined! {
        /// (C_1^H, C_2^H, C_1^N, C_2^N).
        pub residuals(&self) -> [R; 4] = rows!(self, holonomic, nonholonomic);
        /// Phi p: the rates of C^H, then C^N.
        pub constraint_velocity(&self) -> [R; 4] = rows!(self, holonomic_rate, nonholonomic);
        /// Phi-dot p.
        pub bias(&self) -> [R; 4] = rows!(self, bias_h, bias_n);
        /// The x and y components of a vector that is given along the object's normal and across it.
        pub outward(&self, along: R, across: R) -> [R; 2] =
            [along.dot2(self.cos, -across, self.sin), along.dot2(self.sin, across, self.cos)];
        /// The components of the vector (x, y) along the object's normal and across it.
        pub inward(&self, [x, y]: [R; 2]) -> [R; 2] = [x.dot2(self.cos, y, self.sin), y.dot2(self.cos, -x, self.sin)];
        /// sin theta_p, cos theta_p, d_n and d_t of both tips, on which their elastic energies depend.
        pub tips(&self, q: &Coordinates<R>) -> [[R; 4]; 2] = {
            let [right, left] = &self.contacts;
            [
                [right.sin_tilt, right.cos_tilt, q.compression[0], q.shear[0]],
                [left.sin_tilt, left.cos_tilt, q.compression[1], q.shear[1]],
            ]
        };
        /// Whether the contacts are the paper's. Either both are, or none.
        pub is_the_papers(&self) -> bool = self.contacts[0].is_the_papers();
        /// theta_p of both tips.
        pub tilt(&self) -> [R; 2] = [self.contacts[0].tilt, self.contacts[1].tilt];
        /// sin theta_p of both tips.
        pub sin_tilt(&self) -> [R; 2] = [self.contacts[0].sin_tilt, self.contacts[1].sin_tilt];
        /// The places of both contacts along their sides, up to their signs.
        pub contact_heights(&self) -> [R; 2] = [self.contacts[0].place, self.contacts[1].place];
    }
}

impl Geometry<f64> {
    /// [`Geometry::of`] for a scene, in code that is called.
    #[inline(never)]
    pub fn of_scene(parameters: &Parameters, q: &Coordinates, p: &Coordinates) -> Self {
        Self::of(&Side::both(parameters), q, p)
    }

    /// [`Geometry::constrained`] likewise.
    #[inline(never)]
    pub fn constrain_scene(parameters: &Parameters, q: &mut Coordinates, p: &mut Coordinates) {
        Self::constrained(&Side::both(parameters), q, p);
    }

    /// Phi (25): a row for each constraint in the order (H_1, H_2, N_1, N_2), a column for each coordinate of q.
    pub fn constraint_matrix(&self) -> SMatrix<f64, 4, 9> {
        let mut rows = [Coordinates::zero(); 4];
        for (i, contact) in self.contacts.iter().enumerate() {
            for (row, unit, turn, finger) in
                [(i, [1.0, 0.0], contact.a, contact.b), (2 + i, [0.0, 1.0], contact.e, contact.f)]
            {
                let [along, across] = contact.push(i, unit);
                let [x, y] = self.outward(along, across);
                rows[row].object = [x, y, turn];
                rows[row].finger[i] = finger;
            }
            (rows[i].compression[i], rows[2 + i].shear[i]) = (1.0, 1.0);
        }
        // nalgebra's matrices are arrays of columns.
        SMatrix::<f64, 9, 4>::from(rows.map(|row| row.row())).transpose()
    }
}
