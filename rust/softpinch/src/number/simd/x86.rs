//! The vectors of x86 as [`Lanes`].
//!
//! Safety: these types have no name outside of the SIMD module, so that only code which
//! [`dispatch`](super::dispatch) has made generic over them can make a value or call a task of them. It runs such code
//! only after [`Level::require`](super::level::Level::require) has found the instructions of the very type. The type
//! itself is the proof. The code of a single run, whose numbers prove nothing, checks for the lowest level at each call.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::number::trigonometry::elementary;
use crate::number::{Bits, Compose, LaneTask, Lanes, Real, inlined};

/// Declares functions of an implementation that are inlined and consist of instructions.
macro_rules! instructions {
    ($($name:ident($($arguments:tt)*) -> $output:ty { $($body:tt)* })*) => {$(
        #[inline(always)]
        fn $name($($arguments)*) -> $output {
            // SAFETY: see the module's documentation.
            unsafe { $($body)* }
        }
    )*};
}

macro_rules! vector {
    ($(#[$doc:meta])* $name:ident, $register:ident, $width:literal, $set1:ident, $fma:ident, $fnma:ident, $xor:ident,
     $sqrt:ident, $features:literal, $varied_parts:literal,
     $($operator:ident, $method:ident, $instruction:ident;)*) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy)]
        #[repr(transparent)]
        pub(in crate::number::simd) struct $name($register);

        $(impl $operator for $name {
            type Output = Self;

            instructions! { $method(self, other: Self) -> Self { Self($instruction(self.0, other.0)) } }
        })*

        impl Neg for $name {
            type Output = Self;

            instructions! { neg(self) -> Self { Self($xor(self.0, $set1(-0.0))) } }
        }

        impl $name {
            #[inline(always)]
            fn numbers(self) -> [f64; $width] {
                // SAFETY: the vector and the array both consist of $width doubles in a row.
                unsafe { std::mem::transmute(self.0) }
            }

            #[inline(always)]
            fn numbers_mut(&mut self) -> &mut [f64; $width] {
                // SAFETY: the vector and the array both consist of $width doubles in a row, and the vector
                // has the stricter alignment.
                unsafe { &mut *std::ptr::from_mut(self).cast() }
            }

            #[inline(always)]
            fn of(numbers: [f64; $width]) -> Self {
                // SAFETY: the array and the vector both consist of $width doubles in a row.
                Self(unsafe { std::mem::transmute::<[f64; $width], $register>(numbers) })
            }
        }

        impl Compose for $name {}

        impl Real for $name {
            const VARIED_PARTS: bool = $varied_parts;

            instructions! {
                constant(x: f64) -> Self { Self($set1(x)) }
                mul_add(self, a: Self, b: Self) -> Self { Self($fma(self.0, a.0, b.0)) }
                neg_mul_add(self, a: Self, b: Self) -> Self { Self($fnma(self.0, a.0, b.0)) }
                sqrt(self) -> Self { Self($sqrt(self.0)) }
            }

            inlined! {
                select(bits: Bits, a: Self, b: Self) -> Self = Self::blend(bits, a, b);
                less(self, other: Self) -> Bits = self.below(other);
            }

            elementary!();

            #[inline(always)]
            fn outlined<K: LaneTask<Self>>(task: K) -> K::Output {
                #[inline(never)]
                #[target_feature(enable = $features)]
                fn call<R, K: LaneTask<R>>(task: K) -> K::Output {
                    task.run()
                }
                // SAFETY: see the module's documentation.
                unsafe { call(task) }
            }
        }
    };
}

vector! {
    /// Eight lanes of AVX-512.
    Zmm, __m512d, 8, _mm512_set1_pd, _mm512_fmadd_pd, _mm512_fnmadd_pd, _mm512_xor_pd,
    _mm512_sqrt_pd, "avx512f,avx512dq,avx512vl,avx2,fma", false,
    Add, add, _mm512_add_pd; Sub, sub, _mm512_sub_pd; Mul, mul, _mm512_mul_pd; Div, div, _mm512_div_pd;
}

vector! {
    /// Four lanes of AVX2.
    Ymm, __m256d, 4, _mm256_set1_pd, _mm256_fmadd_pd, _mm256_fnmadd_pd, _mm256_xor_pd,
    _mm256_sqrt_pd, "avx2,fma", true,
    Add, add, _mm256_add_pd; Sub, sub, _mm256_sub_pd; Mul, mul, _mm256_mul_pd; Div, div, _mm256_div_pd;
}

impl Zmm {
    instructions! {
        below(self, other: Self) -> Bits { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, other.0) }
        blend(bits: Bits, a: Self, b: Self) -> Self { Self(_mm512_mask_blend_pd(bits, b.0, a.0)) }
    }
}

/// The functions of [`Lanes`] that are alike for all vectors: the numbers of single lanes.
macro_rules! alike {
    ($width:literal) => {
        const WIDTH: usize = $width;

        inlined! {
            from_fn(f: impl FnMut(usize) -> f64) -> Self = Self::of(std::array::from_fn(f));
            lane(self, lane: usize) -> f64 = self.numbers()[lane];
            set(&mut self, lane: usize, value: f64) -> () = self.numbers_mut()[lane] = value;
        }
    };
}

impl Lanes for Zmm {
    alike!(8);

    instructions! {
        at_most(self, other: Self) -> Bits { _mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, other.0) }
        abs(self) -> Self { Self(_mm512_abs_pd(self.0)) }
        rotate_quadrants(quadrants: Self, sin: Self, cos: Self) -> (Self, Self) {
            let quadrants = _mm512_castpd_si512(quadrants.0);
            let odd = _mm512_test_epi64_mask(quadrants, _mm512_set1_epi64(1));
            let (s, c) = (_mm512_mask_blend_pd(odd, sin.0, cos.0), _mm512_mask_blend_pd(odd, cos.0, sin.0));
            let two = _mm512_set1_epi64(2);
            let sin_sign = _mm512_slli_epi64::<62>(_mm512_and_si512(quadrants, two));
            let next = _mm512_add_epi64(quadrants, _mm512_set1_epi64(1));
            let cos_sign = _mm512_slli_epi64::<62>(_mm512_and_si512(next, two));
            (
                Self(_mm512_xor_pd(s, _mm512_castsi512_pd(sin_sign))),
                Self(_mm512_xor_pd(c, _mm512_castsi512_pd(cos_sign))),
            )
        }
    }
}

/// For each set of lanes, a mask with all bits of these lanes set.
const MASKS: [[i64; 4]; 16] = {
    let mut masks = [[0; 4]; 16];
    let mut bits = 0;
    while bits < 16 {
        let mut lane = 0;
        while lane < 4 {
            masks[bits][lane] = -((bits >> lane & 1) as i64);
            lane += 1;
        }
        bits += 1;
    }
    masks
};

impl Ymm {
    instructions! {
        below(self, other: Self) -> Bits {
            _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(self.0, other.0)) as Bits
        }
        blend(bits: Bits, a: Self, b: Self) -> Self {
            // The mask and the vector both consist of four times 64 bits.
            let mask = std::mem::transmute::<[i64; 4], __m256d>(MASKS[usize::from(bits & 15)]);
            Self(_mm256_blendv_pd(b.0, a.0, mask))
        }
    }
}

impl Lanes for Ymm {
    alike!(4);

    instructions! {
        at_most(self, other: Self) -> Bits {
            _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(self.0, other.0)) as Bits
        }
        abs(self) -> Self { Self(_mm256_andnot_pd(_mm256_set1_pd(-0.0), self.0)) }
        rotate_quadrants(quadrants: Self, sin: Self, cos: Self) -> (Self, Self) {
            let quadrants = _mm256_castpd_si256(quadrants.0);
            let odd = _mm256_castsi256_pd(_mm256_slli_epi64::<63>(quadrants));
            let (s, c) = (_mm256_blendv_pd(sin.0, cos.0, odd), _mm256_blendv_pd(cos.0, sin.0, odd));
            let two = _mm256_set1_epi64x(2);
            let sin_sign = _mm256_slli_epi64::<62>(_mm256_and_si256(quadrants, two));
            let next = _mm256_add_epi64(quadrants, _mm256_set1_epi64x(1));
            let cos_sign = _mm256_slli_epi64::<62>(_mm256_and_si256(next, two));
            (
                Self(_mm256_xor_pd(s, _mm256_castsi256_pd(sin_sign))),
                Self(_mm256_xor_pd(c, _mm256_castsi256_pd(cos_sign))),
            )
        }
    }
}
