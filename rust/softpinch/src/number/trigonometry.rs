//! Our own sine and cosine, so that every machine and every SIMD level gives the same bits.
//!
//! The argument is reduced by multiples of pi/2 in three parts (Cody and Waite, "Software Manual for the
//! Elementary Functions", 1980). The first part is exact because of the fused multiply-add. The kernels on
//! [-pi/4, pi/4] have the published coefficients of fdlibm (Sun Microsystems, k_sin.c and k_cos.c, 1993). The
//! error is below one unit in the last place. Angles beyond [`REDUCIBLE`] go to the `libm` crate (Payne and
//! Hanek's reduction), which is plain Rust and therefore as reproducible.
//!
//! Angles below pi/4 need no reduction, and shorter forms of the kernels take a third of the operations:
//! fingers, tips and object rarely turn further.

use crate::number::powers::ROUNDER;
use crate::number::{Bits, LaneTask, Lanes, Real, each, task};

/// The elementary functions of [`Real`] that are computed alike in all lanes.
macro_rules! elementary {
    () => {
        $crate::number::real::inlined! {
            sin_cos(self) -> (Self, Self) = $crate::number::trigonometry::sin_cos(self);
            angle(self, cos: Self) -> Self = $crate::number::powers::angle(self, cos);
            power(self, n: Self) -> Self = $crate::number::powers::power(self, n);
            ln(self) -> Self = $crate::number::powers::ln(self);
        }
    };
}
pub(crate) use elementary;

/// Largest |x| that the three-part reduction serves: k = x / (pi/2) stays below 2^28, far from the size at
/// which k times the truncation error of pi/2 would show.
pub const REDUCIBLE: f64 = 268_435_456.0;

// pi/2 in three parts. Each part is the double nearest to the remainder that the parts before it leave.
const PIO2_1: f64 = f64::from_bits(0x3FF9_21FB_5444_2D18);
const PIO2_2: f64 = f64::from_bits(0x3C91_A626_3314_5C07);
const PIO2_3: f64 = f64::from_bits(0xB91F_1976_B7ED_8FBC);

const S: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
const C: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Angles below this, which is just below pi / 4, need no reduction: k is 0.
const SMALL: f64 = 0.785;

/// (sin x, cos x) with an error below one unit in the last place for every finite x, NaN otherwise. The
/// result in a lane depends on the angle of that lane only.
#[inline(always)]
pub fn sin_cos<R: Lanes>(x: R) -> (R, R) {
    let large = R::ALL & !x.abs().less(R::constant(SMALL));
    if large == 0 { sin_cos_small(x) } else { R::outlined(Mixed { x, large }) }
}

task! {
    /// [`sin_cos`] where the angles in the lanes of `large` are not small.
    [R: Lanes] Mixed<R>(x: R, large: Bits) for R => (R, R) = {
        let (sin, cos) = sin_cos_reduced(x);
        let (sin, cos) = if large == R::ALL {
            (sin, cos)
        } else {
            let (small_sin, small_cos) = sin_cos_small(x);
            (R::select(large, sin, small_sin), R::select(large, cos, small_cos))
        };
        let wild = R::ALL & !x.abs().less(R::constant(REDUCIBLE));
        if wild == 0 { (sin, cos) } else { replace_with_libm(x, wild, (sin, cos)) }
    }
}

/// Both kernels without a reduction, in shorter forms: x - x^3 (1/6 - ...) and 1 - z (1/2 - z (1/24 - ...)) with z =
/// x^2. The polynomials are added up in pairs of terms. The errors stay below 0.74 and 0.87 units in the last place.
#[inline(always)]
fn sin_cos_small<R: Real>(x: R) -> (R, R) {
    let c = R::constant;
    let z = x * x;
    // Adding zero to the product keeps the sign of a sine that is zero.
    let sin = x - (z * x).neg_mul_add(in_pairs(&S, z), R::zero());
    (sin, z.mul_add(z.mul_add(in_pairs(&C, z), c(-0.5)), c(1.0)))
}

/// Evaluates the polynomial with the coefficients `k` at z.
#[inline(always)]
fn in_pairs<R: Real>(k: &[f64; 6], z: R) -> R {
    let c = R::constant;
    let w = z * z;
    let high = w.mul_add(z.mul_add(c(k[5]), c(k[4])), z.mul_add(c(k[3]), c(k[2])));
    w.mul_add(high, z.mul_add(c(k[1]), c(k[0])))
}

#[cfg(test)]
thread_local! {
    /// How many lanes of this thread have taken their sine and cosine from `libm`.
    pub static LIBM_LANES: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

/// Replaces the results in the lanes of `wild`, whose angles are too large to reduce or not finite. `libm` is
/// slow, so the other lanes keep their results.
#[cold]
#[inline(never)]
fn replace_with_libm<R: Lanes>(x: R, wild: Bits, (mut sin, mut cos): (R, R)) -> (R, R) {
    for lane in each(wild) {
        #[cfg(test)]
        LIBM_LANES.set(LIBM_LANES.get() + 1);
        let (s, c) = libm::sincos(x.lane(lane));
        sin.set(lane, s);
        cos.set(lane, c);
    }
    (sin, cos)
}

#[inline(always)]
fn sin_cos_reduced<R: Lanes>(x: R) -> (R, R) {
    let rounder = R::constant(ROUNDER);
    let rounded = x.mul_add(R::constant(std::f64::consts::FRAC_2_PI), rounder);
    let k = rounded - rounder;
    // x - k PIO2_1 is a multiple of 2^-53 below 1, so the first step is exact.
    let r1 = k.neg_mul_add(R::constant(PIO2_1), x);
    // These differences may cancel near a multiple of pi/2, so the errors of the product and of the difference are kept.
    let product = k * R::constant(PIO2_2);
    let product_error = k.mul_add(R::constant(PIO2_2), -product);
    let hi = r1 - product;
    let shift = hi - r1;
    let difference_error = (r1 - (hi - shift)) - (product + shift);
    let lo = k.neg_mul_add(R::constant(PIO2_3), difference_error - product_error);
    R::rotate_quadrants(rounded, kernel_sin(hi, lo), kernel_cos(hi, lo))
}

#[inline(always)]
fn kernel_sin<R: Real>(x: R, y: R) -> R {
    let c = R::constant;
    let z = x * x;
    let w = z * z;
    let r = w.mul_add(z * z.mul_add(c(S[5]), c(S[4])), z.mul_add(z.mul_add(c(S[3]), c(S[2])), c(S[1])));
    let v = z * x;
    let t = v.neg_mul_add(r, c(0.5) * y);
    x - (v.neg_mul_add(c(S[0]), z.mul_add(t, -y)))
}

#[inline(always)]
fn kernel_cos<R: Real>(x: R, y: R) -> R {
    let c = R::constant;
    let one = c(1.0);
    let z = x * x;
    let w = z * z;
    let low = z.mul_add(z.mul_add(c(C[2]), c(C[1])), c(C[0]));
    let r = z.mul_add(low, (w * w) * z.mul_add(z.mul_add(c(C[5]), c(C[4])), c(C[3])));
    let half = c(0.5) * z;
    let head = one - half;
    head + (((one - head) - half) + z.mul_add(r, -(x * y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::number::row::Row4;

    fn ulps(a: f64, b: f64) -> f64 {
        (a - b).abs() / (f64::EPSILON * b.abs().max(f64::MIN_POSITIVE)) * 2.0
    }

    #[test]
    fn a_small_angle_has_the_same_sine_beside_a_large_one() {
        for n in -1000..1000_i32 {
            let x = f64::from(n) * (SMALL / 1000.0);
            let (sin, cos) = sin_cos(Row4::from_fn(|lane| if lane == 2 { 1.0 } else { x }));
            let ((s, c), (large, other)) = (sin_cos(x), sin_cos(1.0));
            assert_eq!((sin.lane(0).to_bits(), cos.lane(3).to_bits()), (s.to_bits(), c.to_bits()), "{x}");
            assert_eq!((sin.lane(2), cos.lane(2)), (large, other));
        }
    }

    #[test]
    fn a_sine_that_is_zero_has_the_sign_of_its_angle() {
        for x in [0.0, -0.0, 5e-324, -1e-310, 1e-160] {
            let (sin, cos) = sin_cos(x);
            assert_eq!((sin.to_bits(), cos), (x.to_bits(), 1.0), "{x}");
        }
    }

    // libm's error is below one unit in the last place too, so both results differ by at most two units.
    #[test]
    fn agrees_with_libm_over_the_reducible_range() {
        for n in -40_000..40_000_i32 {
            let x = f64::from(n) * 1.234_567e-3 + f64::from(n).powi(3) * 1e-7;
            let (s, c) = sin_cos(x);
            assert!(ulps(s, libm::sin(x)) <= 2.0, "sin {x}: {s} {}", libm::sin(x));
            assert!(ulps(c, libm::cos(x)) <= 2.0, "cos {x}: {c} {}", libm::cos(x));
        }
    }

    #[test]
    fn sine_is_odd_cosine_is_even_and_both_are_right_at_multiples_of_half_pi() {
        for n in 0..2000_u32 {
            let x = f64::from(n) * std::f64::consts::FRAC_PI_2;
            let (s, c) = sin_cos(x);
            let (ms, mc) = sin_cos(-x);
            assert_eq!((s, c), (-ms, mc));
            assert!(ulps(s, libm::sin(x)) <= 2.0 && ulps(c, libm::cos(x)) <= 2.0, "{x}");
        }
    }

    #[test]
    fn only_the_lanes_with_huge_or_non_finite_angles_use_libm() {
        let angles = [0.3, 1e9, -2.0, f64::NAN];
        LIBM_LANES.set(0);
        let (sin, cos) = sin_cos(Row4::from_fn(|lane| angles[lane]));
        assert_eq!(LIBM_LANES.get(), 2);
        for (lane, angle) in angles.into_iter().enumerate() {
            let (s, c) = sin_cos(angle);
            assert_eq!((sin.lane(lane).to_bits(), cos.lane(lane).to_bits()), (s.to_bits(), c.to_bits()));
        }
    }

    #[test]
    fn huge_angles_agree_with_libm_and_non_finite_ones_give_nan() {
        for x in [1e9, -1e22, 1e300, f64::MAX] {
            assert_eq!(sin_cos(x), (libm::sin(x), libm::cos(x)));
        }
        for x in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
            let (s, c) = sin_cos(x);
            assert!(s.is_nan() && c.is_nan());
        }
    }
}
