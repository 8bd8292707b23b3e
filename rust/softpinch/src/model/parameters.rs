//! Hand, tips, object and control, and the rules for their numbers. The rules are checked once, here.
//!
//! Index 0 is the paper's finger 1, the right one; index 1 is finger 2, the left one. SI units throughout.

use nalgebra::SMatrix;

use crate::error::Error;
use crate::model::contact::law::{self, BRANCHES, LawKind, WEIGHTS};
use crate::model::{Coordinates, Counterface, MechanismKind, Rule, ShapeKind};
use crate::number::{inlined, signed};

/// The mass of the object in the paper's scenes, kg. The tips' masses are the same, because the paper moves the tip with
/// the object's mass (14).
const OBJECT_MASS: f64 = 0.1;

/// Names of the fingers in messages and paths.
pub const SIDES: [&str; 2] = ["right", "left"];

/// Declares a record of numbers in one place: its fields, their meaning, their rules, and their values in the paper's
/// scenes. These values are ours, because the paper's Tables I and II are lost.
macro_rules! record {
    ($(#[$doc:meta])* $name:ident {
        $($(#[$field_doc:meta])* $field:ident: $rule:ident = $default:expr,)*
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name<R = f64> {
            $($(#[$field_doc])* pub $field: R,)*
        }

        impl $name {
            const COUNT: usize = [$(stringify!($field)),*].len();
            /// Names and rules of the fields, in order.
            pub const FIELDS: [(&'static str, Rule); Self::COUNT] = [$((stringify!($field), Rule::$rule),)*];

            /// Builds the record from the values of its fields, in order.
            pub fn from_fields(values: [f64; Self::COUNT]) -> Self {
                let [$($field),*] = values;
                Self { $($field),* }
            }

            /// The values of the fields, in order.
            pub fn fields(&self) -> [f64; Self::COUNT] {
                [$(self.$field),*]
            }
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default),* }
            }
        }
    };
}

record! {
    /// A rigid finger, turning about its root.
    Finger {
        /// L, from the root to the fingertip's centre along the finger, m.
        length: Positive = 0.0762,
        /// W_f, from the middle of the hand to the root, m.
        root_offset: NonNegative = 0.049,
        /// d_f, half the finger's thickness, m.
        half_thickness: NonNegative = 0.0045,
        /// M_i, for gravity (16), kg.
        mass: NonNegative = 0.1,
        /// I_i, about the root, kg m^2.
        inertia: Positive = 5.8e-4,
    }
}

record! {
    /// A hemispherical soft fingertip: elastic energy (5) with Voigt viscosity (44, 45).
    Fingertip {
        /// a, m.
        radius: Positive = 0.020,
        /// E, Pa.
        youngs_modulus: Positive = 0.30e6,
        /// c_n, N s/m.
        normal_viscosity: NonNegative = 100.0,
        /// c_t, N s/m.
        tangential_viscosity: NonNegative = 100.0,
        /// kappa in (5): +1 as printed, -1 from the springs and the kinematics, 0 leaves the term out.
        tilt_coupling: Finite = 1.0,
        /// m_n, the mass that moves with the compression (14), kg.
        normal_mass: Positive = OBJECT_MASS,
        /// m_t, the mass that moves with the shear (14), kg.
        tangential_mass: Positive = OBJECT_MASS,
    }
}

record! {
    /// The grasped object, with parallel faces.
    GraspedObject {
        /// W, m.
        width: Positive = 0.049,
        /// M, kg.
        mass: Positive = OBJECT_MASS,
        /// I, about the centre of gravity, kg m^2.
        inertia: Positive = 4.0e-5,
        /// w, from the middle of the object to its centre of gravity, towards finger 1, m.
        com_offset: Finite = 0.0,
        /// The height of the faces, half of it on each side of the centre of gravity, m.
        height: PositiveOrInfinite = f64::INFINITY,
    }
}

record! {
    /// The gains of the PID control (39).
    PidGains {
        /// K_P, N m/rad.
        kp: NonNegative = 100.0,
        /// K_D, N m s/rad.
        kd: NonNegative = 1.0,
        /// K_I, N m/(rad s).
        ki: NonNegative = 1000.0,
    }
}

record! {
    /// Gains of the constraint stabilisation (19, 20): numerics, not physics.
    Stabilization {
        /// alpha, 1/s.
        alpha: NonNegative = 1000.0,
        /// beta, 1/s.
        beta: NonNegative = 1000.0,
    }
}

record! {
    /// The quantities that belong to the scene as a whole.
    Surroundings {
        /// g, m/s^2, downwards (against y); Earth's unless given.
        gravity: Finite = 9.81,
    }
}

record! {
    /// The coefficients of friction mu of both contacts; infinite if the scene gives none.
    Friction {
        /// That of the right finger's contact.
        right: NonNegativeOrInfinite = f64::INFINITY,
        /// That of the left finger's contact.
        left: NonNegativeOrInfinite = f64::INFINITY,
    }
}

record! {
    /// The numbers of mechanisms that a link of [`Finger`] lacks.
    Mechanism {
        /// The number of the `MechanismKind`.
        kind: Mechanism = 0.0,
        /// Y_0, the height of a jaw's tip at the coordinate zero, m.
        height: Finite = 0.0,
        /// gamma, the direction of a jaw's travel, upwards from the direction to the middle of the hand, rad.
        direction: Finite = 0.0,
        /// phi_0, the angle of the tip's base to the upright, for mechanisms that do not turn it, rad.
        angle: Finite = 0.0,
        /// Whether the joint has dry friction: 1, or 0.
        rubs: Count = 0.0,
        /// f, the torque of this friction in a quick motion, N m; a jaw's force, N.
        joint_friction: NonNegative = 0.0,
        /// v, the rate at which it is f / sqrt(2), rad/s; of a jaw m/s.
        creep_rate: Positive = 0.01,
    }
}

record! {
    /// One side of the object.
    Side {
        /// The number of the `ShapeKind`.
        kind: Shape = 0.0,
        /// The number of the `Counterface` by which curvature changes the tip's energy.
        counterface: Counterface = 0.0,
        /// beta, the tilt of a face, positive where the object is wider at its upper end, rad.
        tilt: Tilt = 0.0,
        /// The height of this face, m.
        height: PositiveOrInfinite = f64::INFINITY,
        /// R, the radius of an arc, m.
        radius: Positive = 1.0,
        /// K_x, from the centre of gravity to the arc's centre, towards finger 1, m.
        center_x: Finite = 0.0,
        /// K_y, likewise upwards, m.
        center_y: Finite = 0.0,
        /// The angle between the ends of an arc, rad.
        span: Span = std::f64::consts::PI,
    }
}

record! {
    /// The law of a tip, and the numbers that (5) lacks.
    Law {
        /// The number of the `LawKind`.
        kind: Law = 0.0,
        /// c of F = c d_n^n, N/m^n.
        coefficient: Positive = 1.0,
        /// n.
        exponent: AboveOne = 2.0,
        /// epsilon, the foot of a power law, m.
        foot: NonNegative = 0.0,
        /// eta, the stiffness of the shear as a share of F'.
        shear_factor: NonNegative = 1.0,
        /// The largest compression of a measured law, m.
        range: Positive = 1.0,
        /// The number of Maxwell branches.
        branches: Count = 0.0,
    }
}

record! {
    /// A Maxwell branch of a tip.
    Maxwell {
        /// g, what it adds to the law at once, as a share of the law.
        share: NonNegative = 0.0,
        /// tau, in which that relaxes, s.
        time: Positive = 1.0,
    }
}

/// Number of parameters of a scene with the paper's parts. They come first.
pub const PAPERS: usize = 38;

/// Number of parameters that describe the physics of a scene.
pub const PARAMETER_COUNT: usize =
    PAPERS + 2 * (Mechanism::COUNT + Side::COUNT + Law::COUNT + WEIGHTS + BRANCHES * Maxwell::COUNT);

/// The physics of a scene. [`Parameters::from_array`] and [`Parameters::checked`] validate it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[allow(missing_docs)] // of fields that their types explain, each first for the right finger
pub struct Parameters {
    pub fingers: [Finger; 2],
    pub tips: [Fingertip; 2],
    pub grasped: GraspedObject,
    pub control: [PidGains; 2],
    pub surroundings: Surroundings,
    pub friction: Friction,
    pub mechanisms: [Mechanism; 2],
    /// The object's right and left side.
    pub shapes: [Side; 2],
    pub laws: [Law; 2],
    /// The weights of measured laws: the density of their springs, N/m^2, in Bernstein polynomials over the range.
    pub weights: [[f64; WEIGHTS]; 2],
    pub relaxation: [[Maxwell; BRANCHES]; 2],
}

/// Names and rules of a record's fields.
type Fields = &'static [(&'static str, Rule)];

/// The records of a scene in the order of [`Parameters::from_array`], each with the prefix of its fields'
/// paths.
const RECORDS: [(&str, Fields); 17 + 2 * BRANCHES] = [
    ("hand.right.", &Finger::FIELDS),
    ("hand.left.", &Finger::FIELDS),
    ("hand.tip.right.", &Fingertip::FIELDS),
    ("hand.tip.left.", &Fingertip::FIELDS),
    ("grasped.", &GraspedObject::FIELDS),
    ("control.right.", &PidGains::FIELDS),
    ("control.left.", &PidGains::FIELDS),
    ("", &Surroundings::FIELDS),
    ("friction.", &Friction::FIELDS),
    ("hand.right.", &Mechanism::FIELDS),
    ("hand.left.", &Mechanism::FIELDS),
    ("grasped.right.", &Side::FIELDS),
    ("grasped.left.", &Side::FIELDS),
    ("hand.tip.right.law.", &Law::FIELDS),
    ("hand.tip.left.law.", &Law::FIELDS),
    ("hand.tip.right.law.", &[("weights", Rule::NonNegative); WEIGHTS]),
    ("hand.tip.left.law.", &[("weights", Rule::NonNegative); WEIGHTS]),
    ("hand.tip.right.relaxation.0.", &Maxwell::FIELDS),
    ("hand.tip.right.relaxation.1.", &Maxwell::FIELDS),
    ("hand.tip.left.relaxation.0.", &Maxwell::FIELDS),
    ("hand.tip.left.relaxation.1.", &Maxwell::FIELDS),
];

/// The path of every parameter with its rule, in the order of [`Parameters::from_array`].
pub fn parameter_table() -> Vec<(String, Rule)> {
    let named = |(prefix, fields): (&'static str, Fields)| {
        fields.iter().map(move |(name, rule)| (format!("{prefix}{name}"), *rule))
    };
    RECORDS.into_iter().flat_map(named).collect()
}

/// Removes the first `N` numbers from a slice that has at least so many, and returns them.
fn take<const N: usize>(values: &mut &[f64]) -> [f64; N] {
    let mut taken = [0.0; N];
    let (head, tail) = values.split_at(N.min(values.len()));
    taken[..head.len()].copy_from_slice(head);
    *values = tail;
    taken
}

impl Parameters {
    /// Builds parameters from the flat array whose entries [`parameter_table`] names, and checks every rule.
    pub fn from_array(values: &[f64; PARAMETER_COUNT]) -> Result<Self, Error> {
        let fields = RECORDS.into_iter().flat_map(|(_, fields)| fields);
        if fields.zip(values).any(|((_, rule), &value)| !rule.holds(value)) {
            // The paths are built only if a rule is broken.
            for ((path, rule), &value) in parameter_table().into_iter().zip(values) {
                rule.check(path, value)?;
            }
        }
        Ok(Self::unchecked(values))
    }

    /// Builds parameters from the flat array without a check, because they keep every rule or lie between others that
    /// do.
    #[inline(never)]
    pub fn unchecked(values: &[f64; PARAMETER_COUNT]) -> Self {
        let mut rest = &values[..];
        let rest = &mut rest;
        Self {
            fingers: [Finger::from_fields(take(rest)), Finger::from_fields(take(rest))],
            tips: [Fingertip::from_fields(take(rest)), Fingertip::from_fields(take(rest))],
            grasped: GraspedObject::from_fields(take(rest)),
            control: [PidGains::from_fields(take(rest)), PidGains::from_fields(take(rest))],
            surroundings: Surroundings::from_fields(take(rest)),
            friction: Friction::from_fields(take(rest)),
            mechanisms: [Mechanism::from_fields(take(rest)), Mechanism::from_fields(take(rest))],
            shapes: [Side::from_fields(take(rest)), Side::from_fields(take(rest))],
            laws: [Law::from_fields(take(rest)), Law::from_fields(take(rest))],
            weights: [take(rest), take(rest)],
            relaxation: [(); 2].map(|()| [(); BRANCHES].map(|()| Maxwell::from_fields(take(rest)))),
        }
    }

    inlined! {
        pub(crate) mechanism(&self, i: usize) -> MechanismKind = MechanismKind::of(self.mechanisms[i].kind);
        pub(crate) shape(&self, i: usize) -> ShapeKind = ShapeKind::of(self.shapes[i].kind);
        pub(crate) law(&self, i: usize) -> LawKind = LawKind::of(self.laws[i].kind);
        /// How curvature changes the energy of tip `i`.
        pub counterface(&self, i: usize) -> Counterface = Counterface::of(self.shapes[i].counterface);
        /// The number of Maxwell branches of the tip that has more of them.
        pub branches(&self) -> usize = self.laws[0].branches.max(self.laws[1].branches) as usize;
    }

    /// Whether mechanisms and sides are the paper's, joints without friction, and tips without relaxation.
    #[inline]
    pub fn has_the_papers_geometry(&self) -> bool {
        (0..2).all(|i| {
            let Mechanism { kind, rubs, .. } = self.mechanisms[i];
            [kind, rubs, self.shapes[i].kind, self.laws[i].branches] == [0.0; 4]
        })
    }

    /// Whether the elastic energy of both tips is (5), which relaxation and arcs change, too.
    #[inline]
    pub fn has_the_papers_laws(&self) -> bool {
        (0..2).all(|i| {
            let Law { kind, branches, .. } = self.laws[i];
            [kind, branches] == [0.0; 2] && self.shape(i) != ShapeKind::Arc
        })
    }

    /// Takes the kinds of other parameters, whose derivatives these are.
    pub(crate) fn of_the_kinds(mut self, other: &Self) -> Self {
        for i in 0..2 {
            self.mechanisms[i].kind = other.mechanisms[i].kind;
            self.mechanisms[i].rubs = other.mechanisms[i].rubs;
            self.shapes[i].kind = other.shapes[i].kind;
            self.shapes[i].counterface = other.shapes[i].counterface;
            self.laws[i].kind = other.laws[i].kind;
            self.laws[i].branches = other.laws[i].branches;
        }
        self
    }

    /// The inertia of finger `i` in its coordinate: that about its root, or the mass of a jaw.
    fn finger_inertia(&self, i: usize) -> f64 {
        let finger = &self.fingers[i];
        if self.mechanism(i) == MechanismKind::Jaw { finger.mass } else { finger.inertia }
    }

    /// The diagonal of the mass matrix (14).
    pub(crate) fn masses(&self) -> Coordinates {
        let ([right, left], object) = (&self.tips, &self.grasped);
        Coordinates {
            object: [object.mass, object.mass, object.inertia],
            finger: [self.finger_inertia(0), self.finger_inertia(1)],
            compression: [right.normal_mass, left.normal_mass],
            shear: [right.tangential_mass, left.tangential_mass],
        }
    }

    /// The mass matrix (14).
    pub fn mass_matrix(&self) -> SMatrix<f64, 9, 9> {
        SMatrix::from_diagonal(&self.masses().row().into())
    }

    /// The flat array that [`Parameters::from_array`] takes.
    pub fn to_array(&self) -> [f64; PARAMETER_COUNT] {
        let Self { fingers, tips, grasped, control, surroundings, friction, .. } = self;
        let Self { mechanisms, shapes, laws, weights, relaxation, .. } = self;
        let mut values = Vec::with_capacity(PARAMETER_COUNT);
        values.extend(fingers.iter().flat_map(Finger::fields));
        values.extend(tips.iter().flat_map(Fingertip::fields));
        values.extend(grasped.fields());
        values.extend(control.iter().flat_map(PidGains::fields));
        values.extend(surroundings.fields().into_iter().chain(friction.fields()));
        values.extend(mechanisms.iter().flat_map(Mechanism::fields));
        values.extend(shapes.iter().flat_map(Side::fields));
        values.extend(laws.iter().flat_map(Law::fields));
        values.extend(weights.iter().flatten());
        values.extend(relaxation.iter().flatten().flat_map(Maxwell::fields));
        take(&mut &values[..])
    }

    /// Returns the same parameters if they keep every rule; parameters that are written field by field are
    /// not checked before. The error names the first number that breaks its rule.
    pub fn checked(self) -> Result<Self, Error> {
        Self::from_array(&self.to_array())
    }

    /// The modulus E of tip `i` by which its stiffness is judged: with it (5) is as stiff at full compression, Pa.
    pub fn modulus(&self, i: usize) -> f64 {
        law::modulus(self, i)
    }

    /// The length of a way of tip `i` for a unit of its finger's coordinate: at most this one.
    pub fn lever(&self, i: usize) -> f64 {
        let Finger { length, half_thickness, .. } = self.fingers[i];
        if self.mechanism(i) == MechanismKind::Jaw { 1.0 } else { length + half_thickness }
    }

    /// The size of the coordinate of finger `i` that counts as one: a radian, or the `length` of a jaw's travel.
    pub fn finger_size(&self, i: usize, length: f64) -> f64 {
        if self.mechanism(i) == MechanismKind::Jaw { length } else { 1.0 }
    }

    /// The sum of the lengths that the place of contact `i` is made of, m.
    pub(crate) fn reach(&self, i: usize) -> f64 {
        let (finger, side) = (&self.fingers[i], &self.shapes[i]);
        let arm = match self.mechanism(i) {
            MechanismKind::Jaw => self.mechanisms[i].height.abs() + finger.half_thickness,
            _ => finger.length + finger.half_thickness,
        };
        let object = match self.shape(i) {
            ShapeKind::Arc => side.radius + side.center_x.abs() + side.center_y.abs(),
            _ => self.grasped.width + self.grasped.com_offset.abs(),
        };
        finger.root_offset + arm + self.tips[i].radius + object
    }

    /// W/2 + s_i w, the distance of face `i` from the centre of gravity at its middle; of an arc the distance of its
    /// apex.
    pub(crate) fn half_width(&self, i: usize) -> f64 {
        let side = &self.shapes[i];
        match self.shape(i) {
            ShapeKind::Arc => side.radius - signed(i, side.center_x),
            _ => 0.5 * self.grasped.width + signed(i, self.grasped.com_offset),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_names_every_entry_and_each_lands_in_its_field() {
        let table = parameter_table();
        assert_eq!(table.len(), PARAMETER_COUNT);
        let values: [f64; PARAMETER_COUNT] = std::array::from_fn(|k| 1.0 + k as f64);
        let p = Parameters::unchecked(&values);
        let at = |path: &str| values[table.iter().position(|(name, _)| name == path).unwrap()];
        assert_eq!(p.fingers[1].half_thickness, at("hand.left.half_thickness"));
        assert_eq!(p.tips[0].tangential_mass, at("hand.tip.right.tangential_mass"));
        assert_eq!(p.grasped.com_offset, at("grasped.com_offset"));
        assert_eq!(p.control[1].ki, at("control.left.ki"));
        assert_eq!(p.friction.left, at("friction.left"));
        assert_eq!(p.shapes[1].span, at("grasped.left.span"));
        assert_eq!(p.weights[1][0], at("hand.tip.left.law.weights"));
        assert_eq!(p.to_array(), values);
    }

    #[test]
    fn parameters_written_field_by_field_can_be_checked() {
        let light = GraspedObject { mass: 0.01, ..GraspedObject::default() };
        let mut parameters = Parameters { grasped: light, ..Parameters::default() };
        assert_eq!(parameters.checked().as_ref(), Ok(&parameters));
        parameters.tips[1].radius = -0.02;
        let message = parameters.checked().unwrap_err().to_string();
        assert_eq!(message, "hand.tip.left.radius = -0.02: must be finite and > 0");
    }

    #[test]
    fn each_error_names_the_field_the_value_and_the_rule() {
        let mut values = Parameters::default().to_array();
        values[4] = 0.0;
        let message = Parameters::from_array(&values).unwrap_err().to_string();
        assert_eq!(message, "hand.right.inertia = 0.0: must be finite and > 0");
        values[4] = 1.0;
        values[36] = f64::INFINITY;
        assert!(Parameters::from_array(&values).is_ok());
        values[35] = f64::NAN;
        assert!(Parameters::from_array(&values).is_err());
    }
}
