//! A state of the motion, and the typical magnitude of each of its components.

use crate::model::{Coordinates, Parameters, RELAXATIONS, each_coordinate};
use crate::number::{Lanes, Real};

/// A state in the nine coordinates. Every formulation is recorded in this form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<R> {
    /// Coordinates.
    pub q: Coordinates<R>,
    /// Velocities.
    pub p: Coordinates<R>,
    /// The controllers' memories.
    pub memory: [R; 2],
    /// The states of Maxwell branches of the tips (`contact/law/relaxation.rs`), N and m.
    pub relaxation: [R; RELAXATIONS],
}

/// Number of numbers of a motion.
pub const NUMBERS: usize = 20 + RELAXATIONS;

impl<R: Copy> From<[R; NUMBERS]> for Motion<R> {
    fn from(row: [R; NUMBERS]) -> Self {
        let (q, p) = (std::array::from_fn(|k| row[k]), std::array::from_fn(|k| row[9 + k]));
        let relaxation = std::array::from_fn(|k| row[20 + k]);
        Self { q: q.into(), p: p.into(), memory: [row[18], row[19]], relaxation }
    }
}

impl<R: Copy> Motion<R> {
    /// The numbers in the order of the fields.
    pub fn row(&self) -> [R; NUMBERS] {
        let mut row = [self.memory[0]; NUMBERS];
        row[..9].copy_from_slice(&self.q.row());
        row[9..18].copy_from_slice(&self.p.row());
        row[18..20].copy_from_slice(&self.memory);
        row[20..].copy_from_slice(&self.relaxation);
        row
    }
}

impl<R: Real> Motion<R> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        let (zero, q) = (R::zero(), Coordinates::zero());
        Self { q, p: q, memory: [zero; 2], relaxation: [zero; RELAXATIONS] }
    }

    /// The same motion in numbers of type `R`.
    pub fn constant(Motion { q, p, memory, relaxation }: &Motion<f64>) -> Self {
        let (q, p) = (each_coordinate!([q] => R::constant(q)), each_coordinate!([p] => R::constant(p)));
        Self { q, p, memory: memory.map(R::constant), relaxation: relaxation.map(R::constant) }
    }
}

impl<R: Lanes> Motion<R> {
    /// The motion of one lane.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> Motion<f64> {
        let Self { q, p, memory, relaxation } = self;
        let (q, p) = (each_coordinate!([q] => q.lane(lane)), each_coordinate!([p] => p.lane(lane)));
        let (memory, relaxation) = (memory.map(|x| x.lane(lane)), relaxation.map(|x| x.lane(lane)));
        Motion { q, p, memory, relaxation }
    }
}

impl Motion<f64> {
    /// The typical magnitude of each component in a scene. For lengths it is the larger tip's radius, for angles one,
    /// and for rates these magnitudes times sqrt(E a / M), the rate at which such a tip moves the object. A PID
    /// integral without a gain drives nothing, so its error does not matter and its magnitude is infinite.
    pub fn typical_magnitudes(parameters: &Parameters) -> Self {
        let [right, left] = &parameters.tips;
        let length = right.radius.max(left.radius);
        let pace =
            (parameters.modulus(0).max(parameters.modulus(1)) * length / parameters.grasped.mass).sqrt();
        let (compression, shear) = ([length; 2], [length; 2]);
        let finger = [0, 1].map(|i| parameters.finger_size(i, length));
        let q = Coordinates { object: [length, length, 1.0], finger, compression, shear };
        let memory =
            [0, 1].map(|i| if parameters.control[i].ki == 0.0 { f64::INFINITY } else { finger[i] / pace });
        // A branch without a share drives nothing, too.
        let mut relaxation = [f64::INFINITY; RELAXATIONS];
        for i in 0..2 {
            let branches = parameters.relaxation[i].iter().enumerate();
            for (k, _) in branches.filter(|(_, branch)| branch.share > 0.0) {
                relaxation[4 * k + i] = parameters.modulus(i) * length * length;
                relaxation[4 * k + 2 + i] = length;
            }
        }
        Self { q, p: each_coordinate!([q] => q * pace), memory, relaxation }
    }

    /// The same with smaller rates if viscosity slows the scene down: E a / c is the rate at which a tip gives way.
    pub fn slow_magnitudes(parameters: &Parameters) -> Self {
        let usual = Self::typical_magnitudes(parameters);
        let [.., mut pace] = usual.p.object;
        for (i, tip) in parameters.tips.iter().enumerate() {
            let viscosity = tip.normal_viscosity.max(tip.tangential_viscosity);
            pace = pace.min(parameters.modulus(i) * tip.radius / viscosity);
        }
        let q = usual.q;
        Self { p: each_coordinate!([q] => q * pace), ..usual }
    }
}

/// The point of the Jacobian that an implicit method still uses: time since the segment's start, and the row of the motion.
pub type Linearized = [f64; 1 + NUMBERS];

pub fn unpacked(point: &Linearized) -> (f64, Motion<f64>) {
    (point[0], std::array::from_fn::<_, NUMBERS, _>(|k| point[1 + k]).into())
}
