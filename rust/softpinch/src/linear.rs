//! The small solve of a step, written out: square-root-free LDL^T in a fixed order, so that scaling by powers of
//! two is exact. Its pivots are the two fingers' own 2 x 2 blocks: two divisions one after the other instead of four,
//! which is what a lone run waits for and what lanes pay most for. nalgebra's decompositions are what the tests
//! compare it with.

use crate::real::Real;

/// The lower triangle of a symmetric 4 x 4 matrix, row by row.
pub type Lower4<R> = [R; 10];

/// The lower triangle of a symmetric 3 x 3 matrix, row by row.
pub type Lower3<R> = [R; 6];

/// a b - c c, accurate even where the products nearly cancel (Kahan; Jeannerod, Louvet and Muller, "Further analysis of
/// Kahan's algorithm for the accurate computation of 2 x 2 determinants", 2013).
#[inline(always)]
fn determinant<R: Real>(a: R, b: R, c: R) -> R {
    let square = c * c;
    let lost = c.mul_add(c, -square);
    a.mul_add(b, -square) - lost
}

/// Solves A x = b for a symmetric positive definite A.
#[inline(always)]
pub fn solve4<R: Real>(a: &Lower4<R>, b: &[R; 4]) -> [R; 4] {
    let [a00, a10, a11, a20, a21, a22, a30, a31, a32, a33] = *a;
    let one = R::constant(1.0);

    // The first block's adjugate on whatever meets it; its determinant divides once.
    let inverse = one / determinant(a00, a11, a10);
    let adjugate = |r0: R, r1: R| (r0.dot2(a11, -r1, a10), r1.dot2(a00, -r0, a10));
    let (u20, u21) = adjugate(a20, a21);
    let (u30, u31) = adjugate(a30, a31);
    let (c0, c1) = adjugate(b[0], b[1]);

    let s22 = inverse.neg_mul_add(u20.dot2(a20, u21, a21), a22);
    let s32 = inverse.neg_mul_add(u30.dot2(a20, u31, a21), a32);
    let s33 = inverse.neg_mul_add(u30.dot2(a30, u31, a31), a33);
    let t2 = inverse.neg_mul_add(c0.dot2(a20, c1, a21), b[2]);
    let t3 = inverse.neg_mul_add(c0.dot2(a30, c1, a31), b[3]);

    let inverse_s = one / determinant(s22, s33, s32);
    let x2 = t2.dot2(s33, -t3, s32) * inverse_s;
    let x3 = t3.dot2(s22, -t2, s32) * inverse_s;
    let x0 = u30.neg_mul_add(x3, u20.neg_mul_add(x2, c0)) * inverse;
    let x1 = u31.neg_mul_add(x3, u21.neg_mul_add(x2, c1)) * inverse;
    [x0, x1, x2, x3]
}

/// Solves A x = b for a symmetric positive definite A; the first two rows are one pivot.
#[inline(always)]
pub fn solve3<R: Real>(a: &Lower3<R>, b: &[R; 3]) -> [R; 3] {
    let [a00, a10, a11, a20, a21, a22] = *a;
    let one = R::constant(1.0);
    let inverse = one / determinant(a00, a11, a10);
    let adjugate = |r0: R, r1: R| (r0.dot2(a11, -r1, a10), r1.dot2(a00, -r0, a10));
    let (u0, u1) = adjugate(a20, a21);
    let (c0, c1) = adjugate(b[0], b[1]);
    let pivot = inverse.neg_mul_add(u0.dot2(a20, u1, a21), a22);
    let x2 = inverse.neg_mul_add(c0.dot2(a20, c1, a21), b[2]) / pivot;
    [u0.neg_mul_add(x2, c0) * inverse, u1.neg_mul_add(x2, c1) * inverse, x2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix4, Vector4};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_nalgebra(
            entries in prop::array::uniform16(-1.0..1.0_f64),
            scales in prop::array::uniform4(-9..9_i32),
            b in prop::array::uniform4(-1.0..1.0_f64),
        ) {
            let g = Matrix4::from_iterator(entries);
            let s = Matrix4::from_diagonal(&Vector4::from_iterator(scales.map(|e| 10f64.powi(e))));
            let a = s * (g * g.transpose() + Matrix4::identity()) * s;
            let lower = [
                a[(0, 0)], a[(1, 0)], a[(1, 1)], a[(2, 0)], a[(2, 1)], a[(2, 2)],
                a[(3, 0)], a[(3, 1)], a[(3, 2)], a[(3, 3)],
            ];
            let ours = Vector4::from_iterator(solve4(&lower, &b));
            let theirs = a.cholesky().unwrap().solve(&Vector4::from_iterator(b));
            // Scaled back, the matrix is well conditioned, whatever the scales were.
            prop_assert!((s * (ours - theirs)).amax() <= 1e-13 * (s * theirs).amax());
        }
    }
}
