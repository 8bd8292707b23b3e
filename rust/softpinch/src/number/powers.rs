//! Our own powers, logarithms and angles, in vectors and with the same bits everywhere, as `trigonometry.rs` has sines.
//!
//! The kernels have the published coefficients of fdlibm (Sun Microsystems, e_log.c, e_exp.c and s_atan.c, 1993). Errors are
//! below two units in the last place, those of powers up to the exponent 4, and grow with larger ones.

use crate::number::Lanes;

/// Adding this number rounds to an integer and leaves that integer in the lowest bits.
pub const ROUNDER: f64 = 6_755_399_441_055_744.0;
/// 2^52: from this number to twice as much the last bit counts 1.
const UNIT: f64 = 4_503_599_627_370_496.0;
const FRACTION: u64 = (1 << 52) - 1;
const ROOT: u64 = std::f64::consts::FRAC_1_SQRT_2.to_bits();

// ln 2 in two parts, of which the first times an exponent is exact.
const LN2: [f64; 2] = [f64::from_bits(0x3FE6_2E42_FEE0_0000), f64::from_bits(0x3DEA_39EF_3579_3C76)];
#[rustfmt::skip]
const LOG: [f64; 7] = [
    6.666_666_666_666_735e-1, 3.999_999_999_940_942e-1, 2.857_142_874_366_239e-1, 2.222_219_843_214_978_4e-1,
    1.818_357_216_161_805e-1, 1.531_383_769_920_937_3e-1, 1.479_819_860_511_658_6e-1,
];
#[rustfmt::skip]
const EXP: [f64; 5] = [
    1.666_666_666_666_660_2e-1, -2.777_777_777_701_559_3e-3, 6.613_756_321_437_934e-5, -1.653_390_220_546_525_2e-6,
    4.138_136_797_057_238_5e-8,
];
#[rustfmt::skip]
const ATAN: [f64; 11] = [
    3.333_333_333_333_293e-1, -1.999_999_999_987_648_3e-1, 1.428_571_427_250_346_6e-1, -1.111_111_040_546_235_6e-1,
    9.090_887_133_436_507e-2, -7.691_876_205_044_83e-2, 6.661_073_137_387_531e-2, -5.833_570_133_790_573_5e-2,
    4.976_877_994_615_932e-2, -3.653_157_274_421_691_6e-2, 1.628_582_011_536_578_2e-2,
];

/// Computes the bits of a number from those of two others, lane by lane.
#[inline(always)]
pub fn bits<R: Lanes>(a: R, b: R, of: impl Fn(u64, u64) -> u64) -> R {
    R::from_fn(|lane| f64::from_bits(of(a.lane(lane).to_bits(), b.lane(lane).to_bits())))
}

/// e and m of a normal x = 2^e m > 0, with m from 1/sqrt(2) to sqrt(2).
#[inline(always)]
pub fn split<R: Lanes>(x: R) -> (R, R) {
    // The bits of the exponent become the lowest bits of a number that is so large that its last bit counts 1.
    let up = 1.0f64.to_bits() - ROOT;
    let e = bits(x, x, |x, _| (x.wrapping_add(up) >> 52) | UNIT.to_bits()) - R::constant(UNIT + 1023.0);
    (e, bits(x, x, |x, _| (x.wrapping_add(up) & FRACTION) + ROOT))
}

/// The polynomial with these coefficients, the lowest first.
#[inline(always)]
fn polynomial<R: Lanes, const N: usize>(coefficients: &[f64; N], z: R) -> R {
    let mut sum = R::constant(coefficients[N - 1]);
    for n in (0..N - 1).rev() {
        sum = sum.mul_add(z, R::constant(coefficients[n]));
    }
    sum
}

/// e and ln m of a normal x > 0, as in [`split`].
#[inline(always)]
fn logarithm<R: Lanes>(x: R) -> (R, R) {
    let c = R::constant;
    let (e, m) = split(x);
    let f = m - c(1.0);
    let s = f / (f + c(2.0));
    let (z, half) = (s * s, c(0.5) * f * f);
    (e, f - s.neg_mul_add(z.mul_add(polynomial(&LOG, z), half), half))
}

/// ln x; zero where x is not positive.
#[inline(always)]
pub fn ln<R: Lanes>(x: R) -> R {
    let (e, log) = logarithm(x);
    let found = e.mul_add(R::constant(LN2[0]), e.mul_add(R::constant(LN2[1]), log));
    R::select(R::zero().less(x), found, R::zero())
}

/// The nearest integer.
#[inline(always)]
fn round<R: Lanes>(x: R) -> R {
    (x + R::constant(ROUNDER)) - R::constant(ROUNDER)
}

/// x 2^k for an integer k, if both are normal.
#[inline(always)]
fn shifted<R: Lanes>(x: R, k: R) -> R {
    bits(x, k + R::constant(ROUNDER), |x, k| x.wrapping_add(k << 52))
}

/// x^n; zero where x is not positive. It is exact for powers of two, if n is an integer.
#[inline(always)]
pub fn power<R: Lanes>(x: R, n: R) -> R {
    let c = R::constant;
    let (e, log) = logarithm(x);
    // 2^(n e) = 2^k 2^f, in which f has what the product lost.
    let exponent = n * e;
    let k = round(exponent);
    let f = (exponent - k) + n.mul_add(e, -exponent);
    let t = n.mul_add(log, f * c(std::f64::consts::LN_2));
    let j = round(t * c(std::f64::consts::LOG2_E));
    let (high, low) = (j.neg_mul_add(c(LN2[0]), t), j * c(LN2[1]));
    let r = high - low;
    let z = r * r;
    let even = z.neg_mul_add(polynomial(&EXP, z), r);
    let exp = c(1.0) - ((low - (r * even) / (c(2.0) - even)) - high);
    // In two factors, so that results which are too large or too small for a number become infinite or zero.
    let total = (k + j).max_in(c(-2000.0), R::ALL).min_in(c(2000.0), R::ALL);
    let half = round(c(0.5) * total);
    let found = shifted(exp, half) * shifted(c(1.0), total - half);
    R::select(R::zero().less(x), found, R::zero())
}

/// The angle whose sine and cosine have the ratio of `sin` to `cos`, in the quarter that their signs say.
#[inline(always)]
pub fn angle<R: Lanes>(sin: R, cos: R) -> R {
    let c = R::constant;
    // t = tan(angle / 2) for the angle with the sizes of both; atan t = pi/4 + atan((t - 1) / (t + 1)).
    let (y, x) = (sin.abs(), sin.dot2(sin, cos, cos).sqrt() + cos.abs());
    let steep = (x * c(0.414_213_562_373_095_03)).less(y);
    let w = R::select(steep, y - x, y) / R::select(steep, y + x, x);
    let z = w * w;
    let half = (z * w).neg_mul_add(polynomial(&ATAN, z), w);
    let found = c(2.0) * (half + R::select(steep, c(std::f64::consts::FRAC_PI_4), R::zero()));
    let found = R::select(cos.less(R::zero()), c(std::f64::consts::PI) - found, found);
    R::select(sin.less(R::zero()), -found, found)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::number::row::Row4;

    fn ulps(a: f64, b: f64) -> f64 {
        (a - b).abs() / (f64::EPSILON * b.abs().max(f64::MIN_POSITIVE)) * 2.0
    }

    proptest! {
        #[test]
        fn agree_with_libm_and_in_lanes(
            size in -300.0..300.0_f64,
            x in 1.0..10.0_f64,
            n in -4.0..4.0_f64,
            turn in -4.0..4.0_f64,
        ) {
            let base = x * libm::pow(10.0, size / 4.0);
            prop_assert!(ulps(power(base, n), libm::pow(base, n)) <= 4.0, "{base}^{n}");
            prop_assert!(ulps(ln(base), libm::log(base)) <= 3.0, "ln {base}");
            let (sin, cos) = (x * libm::sin(turn), x * libm::cos(turn));
            prop_assert!(ulps(angle(sin, cos), libm::atan2(sin, cos)) <= 4.0, "{sin} {cos}");
            let beside = |own: f64| Row4::from_fn(|lane| [1e-300, own, -2.0, f64::NAN][lane]);
            prop_assert_eq!(power(beside(base), beside(n)).lane(1).to_bits(), power(base, n).to_bits());
            prop_assert_eq!(ln(beside(base)).lane(1).to_bits(), ln(base).to_bits());
            prop_assert_eq!(angle(beside(sin), beside(cos)).lane(1).to_bits(), angle(sin, cos).to_bits());
            // Powers of two are exact.
            let scaled = power(base * 0.25, n.round());
            prop_assert_eq!(scaled * libm::pow(4.0, n.round()), power(base, n.round()));
            prop_assert_eq!(angle(4.0 * sin, 4.0 * cos).to_bits(), angle(sin, cos).to_bits());
        }
    }

    #[test]
    fn ends_of_the_range() {
        for (x, n) in [(1e-300, 0.5), (1e-200, 2.0), (1e200, 2.0), (1e-200, -2.0), (3.0, 1e4)] {
            let (found, expected) = (power(x, n), libm::pow(x, n));
            assert!(found == expected || ulps(found, expected) < 4.0, "{x}^{n}: {found} {expected}");
        }
        for x in [0.0, -0.0, -1.0, f64::NAN] {
            assert_eq!((power(x, 2.0), power(x, -0.5), ln(x)), (0.0, 0.0, 0.0));
        }
        assert_eq!((power(0.3, 0.0), power(1.0, 7.3), ln(1.0)), (1.0, 1.0, 0.0));
        let pi = std::f64::consts::PI;
        for (sin, cos, expected) in
            [(0.0, 1.0, 0.0), (1.0, 0.0, 0.5 * pi), (0.0, -1.0, pi), (-1.0, -1.0, -0.75 * pi)]
        {
            assert_eq!(angle(sin, cos), expected);
        }
    }
}
