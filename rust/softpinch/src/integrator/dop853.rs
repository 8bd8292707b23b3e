//! The explicit Runge-Kutta method of order eight of Dormand and Prince (Prince and Dormand, "High order embedded
//! Runge-Kutta formulae", 1981), with the coefficients of Hairer's DOP853 (Hairer, Norsett and Wanner, "Solving Ordinary
//! Differential Equations I", II.5, 1993).

use crate::formulation::System;
use crate::inputs::Drive;
use crate::integrator::Integrator;
use crate::real::Real;

/// |R(z)| <= 1 on the real axis from here to 0, R of degree 12 as the coefficients below give it.
pub const REAL_STABILITY_LIMIT: f64 = 6.393_65;

const STAGES: usize = 12;

/// Where each stage stands in the step.
const C: [f64; STAGES] = [
    0.0,
    0.05260015195876773,
    0.0789002279381516,
    0.1183503419072274,
    0.2816496580927726,
    0.3333333333333333,
    0.25,
    0.3076923076923077,
    0.6512820512820513,
    0.6,
    0.8571428571428571,
    1.0,
];

/// The weights of the stages.
const B: [f64; STAGES] = [
    0.054293734116568765,
    0.0,
    0.0,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    0.3111643669578199,
    -0.1521609496625161,
    0.20136540080403034,
    0.04471061572777259,
];

/// What each stage takes of those before it.
const A: [[f64; STAGES - 1]; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.05260015195876773, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0197250569845379, 0.0591751709536137, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.02958758547680685, 0.0, 0.08876275643042054, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125, 0.0, 0.0, 0.0, 0.0, 0.0],
    [
        0.03709200011850479,
        0.0,
        0.0,
        0.17038392571223998,
        0.10726203044637328,
        -0.015319437748624402,
        0.008273789163814023,
        0.0,
        0.0,
        0.0,
        0.0,
    ],
    [
        0.6241109587160757,
        0.0,
        0.0,
        -3.3608926294469414,
        -0.868219346841726,
        27.59209969944671,
        20.154067550477894,
        -43.48988418106996,
        0.0,
        0.0,
        0.0,
    ],
    [
        0.47766253643826434,
        0.0,
        0.0,
        -2.4881146199716677,
        -0.590290826836843,
        21.230051448181193,
        15.279233632882423,
        -33.28821096898486,
        -0.020331201708508627,
        0.0,
        0.0,
    ],
    [
        -0.9371424300859873,
        0.0,
        0.0,
        5.186372428844064,
        1.0914373489967295,
        -8.149787010746927,
        -18.52006565999696,
        22.739487099350505,
        2.4936055526796523,
        -3.0467644718982196,
        0.0,
    ],
    [
        2.273310147516538,
        0.0,
        0.0,
        -10.53449546673725,
        -2.0008720582248625,
        -17.9589318631188,
        27.94888452941996,
        -2.8589982771350235,
        -8.87285693353063,
        12.360567175794303,
        0.6433927460157636,
    ],
];

/// The method.
#[derive(Debug, Clone, Copy)]
pub struct Dop853;

/// y plus h times the weighted sum of the first `count` slopes; small terms are added up first.
#[inline(always)]
fn combine<R: Real, const N: usize>(y: &[R; N], h: R, slopes: &[[R; N]; STAGES], weights: &[f64]) -> [R; N] {
    let mut sum = [R::zero(); N];
    for (slope, &weight) in slopes.iter().zip(weights) {
        if weight != 0.0 {
            let weight = R::constant(weight);
            for n in 0..N {
                sum[n] = slope[n].mul_add(weight, sum[n]);
            }
        }
    }
    for n in 0..N {
        sum[n] = sum[n].mul_add(h, y[n]);
    }
    sum
}

impl Integrator for Dop853 {
    const EVALUATIONS: u64 = 12;

    #[inline(always)]
    fn step<R: Real, const N: usize, S: System<R, N>, D: Drive<R>>(
        system: &S,
        drive: &D,
        tau: R,
        h: R,
        y: &[R; N],
        k1: &[R; N],
    ) -> [R; N] {
        let mut slopes = [*k1; STAGES];
        for stage in 1..STAGES {
            let at = combine(y, h, &slopes, &A[stage][..stage]);
            slopes[stage] = system.evaluate(&drive.at(R::constant(C[stage]).mul_add(h, tau)), &at).rate;
        }
        combine(y, h, &slopes, &B)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stage stands where its weights say, and the weights integrate 1, c, c^2, ... up to c^7 exactly: a slip in any
    /// digit shows.
    #[test]
    fn the_tableau_keeps_its_order_conditions() {
        for (row, c) in A.iter().zip(C) {
            assert!((row.iter().sum::<f64>() - c).abs() < 2e-14, "{c}");
        }
        for power in 0..8 {
            let sum: f64 = B.iter().zip(C).map(|(b, c)| b * c.powi(power)).sum();
            assert!((sum - 1.0 / f64::from(power + 1)).abs() < 1e-14, "{power} {sum}");
        }
    }
}
