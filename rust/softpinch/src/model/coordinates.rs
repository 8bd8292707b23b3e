//! The record that has one number for each coordinate.

use crate::number::{Bits, Real, inlined};

/// One number for each of the nine coordinates: their values, rates or accelerations, or forces or masses. Rows and
/// arrays at the border have the numbers in the order of these fields.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Coordinates<R = f64> {
    /// The object: x and y of the centre of gravity, and its angle theta.
    pub object: [R; 3],
    /// theta_1 and theta_2: the angles of the right and the left finger.
    pub finger: [R; 2],
    /// d_n1 and d_n2: the compressions of the right and the left tip.
    pub compression: [R; 2],
    /// d_t1 and d_t2: the shears of the right and the left tip.
    pub shear: [R; 2],
}

/// The record of the values that an expression has for the numbers of some records, coordinate by coordinate. It is
/// written out, because a closure that computes would be compiled without the instructions of the lanes.
macro_rules! each_coordinate {
    ($records:tt => $value:expr) => {
        $crate::model::coordinates::Coordinates::from([
            each_coordinate!($records object[0] $value),
            each_coordinate!($records object[1] $value),
            each_coordinate!($records object[2] $value),
            each_coordinate!($records finger[0] $value),
            each_coordinate!($records finger[1] $value),
            each_coordinate!($records compression[0] $value),
            each_coordinate!($records compression[1] $value),
            each_coordinate!($records shear[0] $value),
            each_coordinate!($records shear[1] $value),
        ])
    };
    ([$($record:ident),+] $part:ident[$i:literal] $value:expr) => {{
        $(let $record = $record.$part[$i];)+
        $value
    }};
}
pub(crate) use each_coordinate;

impl<R: Copy> From<[R; 9]> for Coordinates<R> {
    #[inline(always)]
    fn from([x, y, theta, right, left, d_n1, d_n2, d_t1, d_t2]: [R; 9]) -> Self {
        Self { object: [x, y, theta], finger: [right, left], compression: [d_n1, d_n2], shear: [d_t1, d_t2] }
    }
}

impl<R: Copy> Coordinates<R> {
    /// The numbers as a row.
    #[inline(always)]
    pub fn row(&self) -> [R; 9] {
        let Self { object: [x, y, theta], finger, compression, shear } = *self;
        [x, y, theta, finger[0], finger[1], compression[0], compression[1], shear[0], shear[1]]
    }
}

impl<R: Real> Coordinates<R> {
    inlined! {
        /// Zeros.
        pub zero() -> Self = [R::zero(); 9].into();
        /// `a` in the lanes of `bits`, `b` in all other lanes.
        pub select(bits: Bits, a: &Self, b: &Self) -> Self = each_coordinate!([a, b] => R::select(bits, a, b));
    }
}
