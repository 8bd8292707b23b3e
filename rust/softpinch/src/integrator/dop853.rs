//! The explicit Runge-Kutta method of order eight of Dormand and Prince (Prince and Dormand, "High order embedded
//! Runge-Kutta formulae", 1981), with the coefficients of Hairer's DOP853 (Hairer, Norsett and Wanner, "Solving Ordinary
//! Differential Equations I", II.5, 1993), its error estimate of orders five and three and its dense output of order seven (II.6).

use std::convert::Infallible;

use crate::formulation::{BLOCK, Moved, ROOM, Size, States, System};
use crate::inputs::{Drive, SegmentDrive};
use crate::integrator::newton::largest;
use crate::integrator::{Adaptive, AdaptiveInLanes, Integrator, Runs, Stats, Step};
use crate::lanes::{Bits, Lanes};

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

/// The error estimates: the weights of order five and of order three, less the method's own.
const E5: [f64; STAGES] = [
    0.01312004499419488,
    0.0,
    0.0,
    0.0,
    0.0,
    -1.2251564463762044,
    -0.4957589496572502,
    1.6643771824549864,
    -0.35032884874997366,
    0.3341791187130175,
    0.08192320648511571,
    -0.022355307863886294,
];
const E3: [f64; STAGES] = [
    -0.18980075407240762,
    0.0,
    0.0,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    -0.4226823213237919,
    -0.1521609496625161,
    0.20136540080403034,
    0.02265179219836082,
];

/// Dense output takes three more stages, behind the slope at the step's end,
const EXTRA: usize = 3;
/// which stand here
const C_EXTRA: [f64; EXTRA] = [0.1, 0.2, 0.7777777777777778];
/// and take of all before them,
const A_EXTRA: [[f64; ALL - 1]; EXTRA] = [
    [
        0.056167502283047954,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.25350021021662483,
        -0.2462390374708025,
        -0.12419142326381637,
        0.15329179827876568,
        0.00820105229563469,
        0.007567897660545699,
        -0.008298,
        0.0,
        0.0,
    ],
    [
        0.03183464816350214,
        0.0,
        0.0,
        0.0,
        0.0,
        0.028300909672366776,
        0.053541988307438566,
        -0.05492374857139099,
        0.0,
        0.0,
        -0.00010834732869724932,
        0.0003825710908356584,
        -0.00034046500868740456,
        0.1413124436746325,
        0.0,
    ],
    [
        -0.42889630158379194,
        0.0,
        0.0,
        0.0,
        0.0,
        -4.697621415361164,
        7.683421196062599,
        4.06898981839711,
        0.3567271874552811,
        0.0,
        0.0,
        0.0,
        -0.0013990241651590145,
        2.9475147891527724,
        -9.15095847217987,
    ],
];
/// and four terms of the polynomial.
const DENSE: [[f64; ALL]; 4] = [
    [
        -8.428938276109013,
        0.0,
        0.0,
        0.0,
        0.0,
        0.5667149535193777,
        -3.0689499459498917,
        2.38466765651207,
        2.117034582445028,
        -0.871391583777973,
        2.2404374302607883,
        0.6315787787694688,
        -0.08899033645133331,
        18.148505520854727,
        -9.194632392478356,
        -4.436036387594894,
    ],
    [
        10.427508642579134,
        0.0,
        0.0,
        0.0,
        0.0,
        242.28349177525817,
        165.20045171727028,
        -374.5467547226902,
        -22.113666853125306,
        7.733432668472264,
        -30.674084731089398,
        -9.332130526430229,
        15.697238121770845,
        -31.139403219565178,
        -9.35292435884448,
        35.81684148639408,
    ],
    [
        19.985053242002433,
        0.0,
        0.0,
        0.0,
        0.0,
        -387.0373087493518,
        -189.17813819516758,
        527.8081592054236,
        -11.57390253995963,
        6.8812326946963,
        -1.0006050966910838,
        0.7777137798053443,
        -2.778205752353508,
        -60.19669523126412,
        84.32040550667716,
        11.99229113618279,
    ],
    [
        -25.69393346270375,
        0.0,
        0.0,
        0.0,
        0.0,
        -154.18974869023643,
        -231.5293791760455,
        357.6391179106141,
        93.40532418362432,
        -37.45832313645163,
        104.0996495089623,
        29.8402934266605,
        -43.53345659001114,
        96.32455395918828,
        -39.17726167561544,
        -149.72683625798564,
    ],
];

/// Slopes of a step with dense output: stages, end, extra stages.
const ALL: usize = STAGES + 1 + EXTRA;

/// The method, with the slopes of the last step.
#[derive(Debug, Clone, Copy)]
pub struct Dop853<R = f64> {
    slopes: [States<R>; ALL],
    /// The direction of the stage at hand.
    along: States<R>,
    /// The terms of the dense output.
    terms: [States<R>; 7],
}

impl<R: Lanes> Dop853<R> {
    /// Before the first step.
    #[must_use]
    #[inline(always)]
    pub fn new() -> Self {
        Self { slopes: [[R::zero(); ROOM]; ALL], along: [R::zero(); ROOM], terms: [[R::zero(); ROOM]; 7] }
    }

    /// Of the two estimates of a step of length `h` the better one, e5 / sqrt(e5^2 + (e3 / 10)^2) of it.
    #[inline(always)]
    fn estimate(&self, size: Size, h: R, weights: &States<R>) -> R {
        let mut sum = [R::zero(); ROOM];
        let mut estimate = |by: &[f64; STAGES]| {
            weighted(size, &self.slopes, by, &mut sum);
            largest(size, &sum, weights)
        };
        let (five, three) = (estimate(&E5), estimate(&E3));
        let ratio = R::constant(0.1) * three / five;
        let better = h * five / ratio.mul_add(ratio, R::constant(1.0)).sqrt();
        R::select(five.vanishes(), five, better)
    }
}

impl<R: Lanes> Default for Dop853<R> {
    fn default() -> Self {
        Self::new()
    }
}

/// The slopes times their weights, added up. The weights are constants where this is inlined, so that their loop is unrolled and the
/// sums of a block stay in registers.
#[inline(always)]
fn weighted<R: Lanes>(size: Size, slopes: &[States<R>], weights: &[f64], sum: &mut States<R>) {
    for block in 0..size.blocks() {
        let mut sums = [R::zero(); BLOCK];
        for (slope, &weight) in slopes.iter().zip(weights) {
            if weight != 0.0 {
                for k in 0..BLOCK {
                    sums[k] = slope[BLOCK * block + k].mul_add(R::constant(weight), sums[k]);
                }
            }
        }
        sum[BLOCK * block..BLOCK * (block + 1)].copy_from_slice(&sums);
    }
}

/// Does the same for each stage but the first, whose number is a constant there.
macro_rules! each_stage {
    ($stage:ident => $body:expr) => {
        each_stage!($stage => $body; 1 2 3 4 5 6 7 8 9 10 11)
    };
    ($stage:ident => $body:expr; $($number:literal)*) => {
        $({
            const $stage: usize = $number;
            $body
        })*
    };
}

impl<R: Lanes, S: System<R>> Integrator<R, S> for Dop853<R> {
    type Failure = Infallible;

    #[inline(always)]
    fn step(
        &mut self,
        system: &S,
        drive: &SegmentDrive<R>,
        step: &Step<'_, R>,
        next: &mut States<R>,
        stats: &mut Stats,
    ) -> Result<(), Infallible> {
        let &Step { tau, h, y, rate, .. } = step;
        let Self { slopes, along, .. } = self;
        let size = system.size();
        stats.evaluations += STAGES as u64 - 1;
        slopes[0] = *rate;
        each_stage!(STAGE => {
            weighted(size, slopes, &A[STAGE][..STAGE], along);
            let input = drive.at(R::constant(C[STAGE]).mul_add(h, tau));
            system.rates(&input, Moved { from: y, by: h, along }, &mut slopes[STAGE]);
        });
        weighted(size, slopes, &B, along);
        size.each(|n| next[n] = along[n].mul_add(h, y[n]));
        Ok(())
    }
}

impl<R: Lanes, S: System<R>> Adaptive<R, S> for Dop853<R> {
    const ERROR_ORDER: f64 = 8.0;

    #[inline(always)]
    fn error(&mut self, system: &S, _: &SegmentDrive<R>, step: &Step<'_, R>, _: Bits, _: &mut Stats) -> R {
        self.estimate(system.size(), step.h, &step.weights())
    }

    #[inline(always)]
    fn prepare(
        &mut self,
        system: &S,
        drive: &SegmentDrive<R>,
        step: &Step<'_, R>,
        next: &States<R>,
        stats: &mut Stats,
    ) {
        let &Step { tau, h, y, .. } = step;
        let size = system.size();
        stats.evaluations += 1 + EXTRA as u64;
        let Self { slopes, along, terms } = self;
        let there = Moved { from: next, by: R::zero(), along: y };
        system.rates(&drive.at(tau + h), there, &mut slopes[STAGES]);
        for k in 0..EXTRA {
            weighted(size, slopes, &A_EXTRA[k][..=STAGES + k], along);
            let input = drive.at(R::constant(C_EXTRA[k]).mul_add(h, tau));
            system.rates(&input, Moved { from: y, by: h, along }, &mut slopes[STAGES + 1 + k]);
        }
        let (first, last) = (&slopes[0], &slopes[STAGES]);
        size.each(|n| {
            let change = next[n] - y[n];
            terms[0][n] = change;
            terms[1][n] = h.mul_add(first[n], -change);
            terms[2][n] = R::constant(2.0).mul_add(change, -h * (last[n] + first[n]));
        });
        for (term, weights) in terms[3..].iter_mut().zip(DENSE) {
            weighted(size, slopes, &weights, term);
            size.each(|n| term[n] = term[n].mul_add(h, R::zero()));
        }
    }

    #[inline(always)]
    fn interpolate(&self, step: &Step<'_, R>, _: &States<R>, x: R) -> States<R> {
        let mut at = [R::zero(); ROOM];
        for (k, term) in self.terms.iter().enumerate().rev() {
            let factor = if k % 2 == 0 { x } else { R::constant(1.0) - x };
            for n in 0..ROOM {
                at[n] = (at[n] + term[n]) * factor;
            }
        }
        for n in 0..ROOM {
            at[n] = at[n] + step.y[n];
        }
        at
    }
}

/// Names the method for lanes.
pub struct InDop853;

impl AdaptiveInLanes for InDop853 {
    type Method<R: Lanes> = Dop853<R>;

    #[inline(always)]
    fn new<R: Lanes>(_: Runs<'_>, _: Size) -> Dop853<R> {
        Dop853::new()
    }
}

/// R(z) from the tableau: 1 + z b^T (I - z A)^-1 1, by substitution.
pub(super) fn stability_function(z: nalgebra::Complex<f64>) -> nalgebra::Complex<f64> {
    let mut stages = [nalgebra::Complex::new(1.0, 0.0); STAGES];
    for k in 1..STAGES {
        for j in 0..k {
            let earlier = stages[j];
            stages[k] += z * earlier * A[k][j];
        }
    }
    stages.iter().zip(B).fold(nalgebra::Complex::new(1.0, 0.0), |sum, (stage, b)| sum + z * stage * b)
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
