//! Small linear systems, with the operations written out. The system of every evaluation is solved by a
//! square-root-free LDL^T decomposition in a fixed order, so that scaling by powers of two is exact. The implicit
//! methods use an LU decomposition with row pivots. The tests compare both with nalgebra's decompositions.

use std::ops::{Add, Div, Mul, Sub};

use nalgebra::Complex;

use crate::number::real::{inlined, operators};
use crate::number::{Bits, Lanes, Real};

/// Solves the symmetric positive definite system with the lower triangle (a00, a10, a11).
#[inline(always)]
pub fn solve2<R: Real>(a: &[R; 3], b: &[R; 2]) -> [R; 2] {
    let [a00, a10, a11] = *a;
    let i0 = R::constant(1.0) / a00;
    let l10 = a10 * i0;
    let x1 = l10.neg_mul_add(b[0], b[1]) / l10.neg_mul_add(a10, a11);
    [l10.neg_mul_add(x1, b[0] * i0), x1]
}

/// The lower triangle of a symmetric 3 x 3 matrix, row by row.
pub type Lower3<R> = [R; 6];

/// Solves A x = b for a symmetric positive definite A. `scale` must bring the leading entries of A near one,
/// or at least no further from one than they are from each other: then products of two entries neither
/// overflow nor underflow, whatever their size.
#[inline(always)]
pub fn solve3<R: Real>(a: &Lower3<R>, b: &[R; 3], scale: R) -> [R; 3] {
    let [a00, a10, a11, a20, a21, a22] = *a;
    let one = R::constant(1.0);
    let i0 = one / a00;
    let (l10, l20) = (a10 * i0, a20 * i0);
    let m21 = l20.neg_mul_add(a10, a21);
    // The second pivot is multiplied by the first one, so that this division need not wait for the one above.
    let (s00, s10) = (a00 * scale, a10 * scale);
    let i1 = s00 / s10.neg_mul_add(a10, s00 * a11);
    let l21 = m21 * i1;
    let d2 = l21.neg_mul_add(m21, l20.neg_mul_add(a20, a22));

    let y1 = l10.neg_mul_add(b[0], b[1]);
    let y2 = l21.neg_mul_add(y1, l20.neg_mul_add(b[0], b[2]));
    let x2 = y2 / d2;
    let x1 = l21.neg_mul_add(x2, y1 * i1);
    let x0 = l20.neg_mul_add(x2, l10.neg_mul_add(x1, b[0] * i0));
    [x0, x1, x2]
}

/// Number of rows of the largest system.
pub const MOST_ROWS: usize = 9;

/// A square matrix, row by row. A system uses only as many of the rows and columns as it needs.
pub type Square<T> = [[T; MOST_ROWS]; MOST_ROWS];

/// The arithmetic that an LU decomposition needs of its entries.
pub trait Entry:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The real numbers that an entry consists of.
    type Part: Real;
    /// A record of which rows were exchanged.
    type Exchange: Copy + Default + std::fmt::Debug;

    fn of(part: Self::Part) -> Self;
    /// self - a * b.
    fn less_product(self, a: Self, b: Self) -> Self;
    /// self + a * b with a real a.
    fn plus(self, a: Self::Part, b: Self) -> Self;
    /// Of row `k` and the rows below it, brings the row with the largest entry in column `k` to place `k`.
    /// Among equally large entries the first one wins.
    fn pivot(rows: &mut Square<Self>, size: usize, k: usize) -> Self::Exchange;
    /// Repeats the row exchange of step `k` in a column vector.
    fn exchange(column: &mut [Self; MOST_ROWS], size: usize, k: usize, exchanged: &Self::Exchange);
    /// The real number itself, or the real part of a complex number.
    fn real(self) -> Self::Part;
}

macro_rules! scalar_pivots {
    ($size:expr) => {
        type Exchange = usize;

        #[inline(always)]
        fn pivot(rows: &mut Square<Self>, size: usize, k: usize) -> usize {
            let mut pivot = k;
            for r in k + 1..size {
                if $size(rows[r][k]) > $size(rows[pivot][k]) {
                    pivot = r;
                }
            }
            rows.swap(k, pivot);
            pivot
        }

        #[inline(always)]
        fn exchange(column: &mut [Self; MOST_ROWS], _: usize, k: usize, exchanged: &usize) {
            column.swap(k, *exchanged);
        }
    };
}

impl Entry for f64 {
    type Part = f64;

    inlined! {
        of(part: f64) -> Self = part;
        less_product(self, a: Self, b: Self) -> Self = a.neg_mul_add(b, self);
        plus(self, a: f64, b: Self) -> Self = a.mul_add(b, self);
        real(self) -> f64 = self;
    }

    scalar_pivots!(f64::abs);
}

/// The sum of the absolute real and imaginary parts, by which pivots are chosen.
#[inline(always)]
fn magnitude(x: Complex<f64>) -> f64 {
    x.re.abs() + x.im.abs()
}

impl Entry for Complex<f64> {
    type Part = f64;

    inlined! {
        of(part: f64) -> Self = Self { re: part, im: 0.0 };
        less_product(self, a: Self, b: Self) -> Self = Self {
            re: a.im.mul_add(b.im, a.re.neg_mul_add(b.re, self.re)),
            im: a.im.neg_mul_add(b.re, a.re.neg_mul_add(b.im, self.im)),
        };
        plus(self, a: f64, b: Self) -> Self =
            Self { re: a.mul_add(b.re, self.re), im: a.mul_add(b.im, self.im) };
        real(self) -> f64 = self.re;
    }

    scalar_pivots!(magnitude);
}

/// Lanes as matrix entries, where each lane chooses its own pivots.
#[derive(Debug, Clone, Copy)]
pub struct LaneEntry<R>(pub R);

operators! {
    [R: Real] LaneEntry<R>, |own, other|
    Self(own.0 + other.0), Self(own.0 - other.0), Self(own.0 * other.0), Self(own.0 / other.0)
}

impl<R: Lanes> Entry for LaneEntry<R> {
    type Part = R;
    /// For each row, the set of lanes that exchanged row `k` with it.
    type Exchange = [Bits; MOST_ROWS];

    inlined! {
        of(part: R) -> Self = Self(part);
        less_product(self, a: Self, b: Self) -> Self = Self(a.0.neg_mul_add(b.0, self.0));
        plus(self, a: R, b: Self) -> Self = Self(a.mul_add(b.0, self.0));
        real(self) -> R = self.0;
    }

    #[inline(always)]
    fn pivot(rows: &mut Square<Self>, size: usize, k: usize) -> [Bits; MOST_ROWS] {
        let mut chosen = [0; MOST_ROWS];
        let mut largest = rows[k][k].0.abs();
        for r in k + 1..size {
            let own = rows[r][k].0.abs();
            let larger = largest.less(own);
            largest = R::select(larger, own, largest);
            for earlier in &mut chosen[k + 1..r] {
                *earlier &= !larger;
            }
            chosen[r] = larger;
        }
        for r in k + 1..size {
            if chosen[r] != 0 {
                for c in 0..size {
                    let (top, own) = (rows[k][c].0, rows[r][c].0);
                    rows[k][c] = Self(R::select(chosen[r], own, top));
                    rows[r][c] = Self(R::select(chosen[r], top, own));
                }
            }
        }
        chosen
    }

    #[inline(always)]
    fn exchange(column: &mut [Self; MOST_ROWS], size: usize, k: usize, exchanged: &[Bits; MOST_ROWS]) {
        for r in k + 1..size {
            let (bits, top, own) = (exchanged[r], column[k].0, column[r].0);
            column[k] = Self(R::select(bits, own, top));
            column[r] = Self(R::select(bits, top, own));
        }
    }
}

/// The LU decomposition of a square matrix with row pivots. A singular matrix gives infinities; the caller
/// must check the solution for them.
#[derive(Debug, Clone, Copy)]
pub struct Lu<T: Entry> {
    /// Row by row: the factors of the elimination below the diagonal, the inverse pivots on it, and U above it.
    rows: Square<T>,
    exchanged: [T::Exchange; MOST_ROWS],
}

impl<T: Entry> Lu<T> {
    #[inline(always)]
    pub fn new(size: usize, mut rows: Square<T>) -> Self {
        let mut exchanged = [T::Exchange::default(); MOST_ROWS];
        let one = T::of(T::Part::constant(1.0));
        for k in 0..size {
            exchanged[k] = T::pivot(&mut rows, size, k);
            let inverse = one / rows[k][k];
            rows[k][k] = inverse;
            let (above, below) = rows.split_at_mut(k + 1);
            for row in &mut below[..size - k - 1] {
                row[k] = row[k] * inverse;
                for c in k + 1..size {
                    row[c] = row[c].less_product(row[k], above[k][c]);
                }
            }
        }
        Self { rows, exchanged }
    }

    #[inline(always)]
    pub fn solve(&self, size: usize, b: &[T; MOST_ROWS]) -> [T; MOST_ROWS] {
        let mut x = *b;
        for k in 0..size {
            T::exchange(&mut x, size, k, &self.exchanged[k]);
        }
        for k in 0..size {
            for r in k + 1..size {
                x[r] = x[r].less_product(self.rows[r][k], x[k]);
            }
        }
        for k in (0..size).rev() {
            x[k] = x[k] * self.rows[k][k];
            for r in 0..k {
                x[r] = x[r].less_product(self.rows[r][k], x[k]);
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_nalgebra(
            entries in prop::array::uniform9(-1.0..1.0_f64),
            scales in prop::array::uniform3(-9..9_i32),
            b in prop::array::uniform3(-1.0..1.0_f64),
        ) {
            let g = Matrix3::from_iterator(entries);
            let s = Matrix3::from_diagonal(&Vector3::from_iterator(scales.map(|e| 10f64.powi(e))));
            let a = s * (g * g.transpose() + Matrix3::identity()) * s;
            let lower = [a[(0, 0)], a[(1, 0)], a[(1, 1)], a[(2, 0)], a[(2, 1)], a[(2, 2)]];
            let ours = Vector3::from_iterator(solve3(&lower, &b, 1.0 / a[(0, 0)]));
            let theirs = a.cholesky().unwrap().solve(&Vector3::from_iterator(b));
            // After scaling back, the matrix is well conditioned for any scales.
            prop_assert!((s * (ours - theirs)).amax() <= 1e-13 * (s * theirs).amax());
        }
    }

    proptest! {
        #[test]
        fn lu_agrees_with_nalgebra(
            re in prop::collection::vec(-1.0..1.0_f64, 30), im in prop::collection::vec(-1.0..1.0_f64, 30),
        ) {
            let entry = |k: usize| Complex::new(re[k], im[k]);
            let zero = Complex::new(0.0, 0.0);
            let mut a = [[zero; MOST_ROWS]; MOST_ROWS];
            let mut b = [zero; MOST_ROWS];
            for r in 0..5 {
                b[r] = entry(25 + r);
                for c in 0..5 {
                    a[r][c] = entry(5 * r + c);
                }
            }
            let theirs = SMatrix::<_, 5, 5>::from_fn(|r, c| a[r][c]);
            let size = theirs.try_inverse().map_or(f64::INFINITY, |inverse| inverse.norm());
            prop_assume!(size < 1e4);
            let theirs = theirs.lu().solve(&SVector::<_, 5>::from_column_slice(&b[..5])).unwrap();
            let ours = SVector::<_, 5>::from_column_slice(&Lu::new(5, a).solve(5, &b)[..5]);
            prop_assert!((ours - theirs).norm() <= 1e-14 * size * theirs.norm());

            let a = a.map(|row| row.map(|x| x.re));
            let theirs = SMatrix::<_, 5, 5>::from_fn(|r, c| a[r][c]);
            let size = theirs.try_inverse().map_or(f64::INFINITY, |inverse| inverse.norm());
            prop_assume!(size < 1e4);
            let b = b.map(|x| x.re);
            let theirs = theirs.lu().solve(&SVector::<_, 5>::from_column_slice(&b[..5])).unwrap();
            let ours = SVector::<_, 5>::from_column_slice(&Lu::new(5, a).solve(5, &b)[..5]);
            prop_assert!((ours - theirs).norm() <= 1e-14 * size * theirs.norm());
        }
    }
}
