//! The three-stage Radau IIA method of order five, L-stable and stiffly accurate, with the transformation of Hairer and
//! Wanner: the eigenvectors of the inverse tableau split the Newton system into a real and a complex one (Hairer and
//! Wanner, "Solving Ordinary Differential Equations II", IV.8, which also has the error estimate and the dense output).

use nalgebra::Complex;

use crate::formulation::{Linear, MAX_COMPONENTS, Runs, SceneEquations, Size, StageState, States, System};
use crate::method::newton::newton;
use crate::method::{
    Adaptive, Called, Factors, Iteration, Linearization, MethodEntry, Newton, Problem, Scheme, Solved, Stats,
    Step, largest,
};
use crate::number::Bits;

pub const ENTRY: MethodEntry = MethodEntry {
    order: 5,
    real_stability_limit: None,
    // Hairer and Wanner IV.5, (5.18): the Pade approximation (2, 3).
    stability_function: |z| {
        let one = Complex::new(1.0, 0.0);
        (one + z * 0.4 + z * z / 20.0) / (one - z * 0.6 + z * z * 0.15 - z * z * z / 60.0)
    },
    keeps_jacobian: true,
    alone: |runs, system| Box::new(radau5(runs, system)),
    adaptive: Some(|runs, system| Box::new(radau5(runs, system))),
    error_order: 4.0,
    // A step that would grow by less keeps its factors, too.
    min_growth: 1.2,
};

pub(super) fn radau5(runs: Runs<'_>, system: &SceneEquations<f64>) -> Called<Newton<Radau5, Pair>> {
    newton(runs, system, Radau5::default())
}

const SQRT6: f64 = 2.449_489_742_783_178;

/// The nodes: the position of each stage within the step.
pub(super) const C: [f64; 3] = [(4.0 - SQRT6) / 10.0, (4.0 + SQRT6) / 10.0, 1.0];

/// The weights of the rates in each stage, row by row. The last stage is the end of the step.
pub(super) const A: [[f64; 3]; 3] = [
    [(88.0 - 7.0 * SQRT6) / 360.0, (296.0 - 169.0 * SQRT6) / 1800.0, (-2.0 + 3.0 * SQRT6) / 225.0],
    [(296.0 + 169.0 * SQRT6) / 1800.0, (88.0 + 7.0 * SQRT6) / 360.0, (-2.0 - 3.0 * SQRT6) / 225.0],
    [(16.0 - SQRT6) / 36.0, (16.0 + SQRT6) / 36.0, 1.0 / 9.0],
];

/// The real eigenvalue of the inverse tableau: 3 + 3^(2/3) - 3^(1/3).
const REAL: f64 = 3.637_834_252_744_496;

/// One of the two complex eigenvalues: 3 + (3^(1/3) - 3^(2/3)) / 2 - i (3^(5/6) + 3^(7/6)) / 2.
const COMPLEX: Complex<f64> = Complex::new(2.681_082_873_627_752, -3.050_430_199_247_411);

/// The eigenvectors, with real and imaginary parts in separate columns, scaled to a last row of (1, 1, 0).
const T: [[f64; 3]; 3] = [
    [0.094_438_762_488_975_24, -0.141_255_295_020_954_2, 0.030_029_194_105_147_42],
    [0.250_213_122_965_333_3, 0.204_129_352_293_799_94, -0.382_942_112_757_261_9],
    [1.0, 1.0, 0.0],
];

/// The inverse of [`T`].
const T_INVERSE: [[f64; 3]; 3] = [
    [4.178_718_591_551_904, 0.327_682_820_761_062_37, 0.523_376_445_499_449_5],
    [-4.178_718_591_551_904, -0.327_682_820_761_062_37, 0.476_623_554_500_550_44],
    [0.502_872_634_945_786_8, -2.571_926_949_855_605, 0.596_039_204_828_224_9],
];

/// The weights of the stages in the error estimate.
const E: [f64; 3] = [(-13.0 - 7.0 * SQRT6) / 3.0, (-13.0 + 7.0 * SQRT6) / 3.0, -1.0 / 3.0];

/// The collocation polynomial: for each stage the coefficients of x, x^2 and x^3.
const P: [[f64; 3]; 3] = [
    [13.0 / 3.0 + 7.0 * SQRT6 / 3.0, -23.0 / 3.0 - 22.0 * SQRT6 / 3.0, 10.0 / 3.0 + 5.0 * SQRT6],
    [13.0 / 3.0 - 7.0 * SQRT6 / 3.0, -23.0 / 3.0 + 22.0 * SQRT6 / 3.0, 10.0 / 3.0 - 5.0 * SQRT6],
    [1.0 / 3.0, -8.0 / 3.0, 10.0 / 3.0],
];

pub struct Radau5 {
    /// Each stage's difference from the state at the step's start.
    pub(super) stages: [States<f64>; 3],
    /// The length of the step that the stages belong to, if they can predict the next step.
    length: Option<f64>,
}

impl Default for Radau5 {
    #[inline(always)]
    fn default() -> Self {
        Self { stages: [[0.0; MAX_COMPONENTS]; 3], length: None }
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Pair {
    real: Factors<f64>,
    complex: Factors<Complex<f64>>,
}

#[inline(always)]
fn slopes<S: System<f64>, F>(
    problem: &Problem<'_, S, F>,
    stages: &[States<f64>; 3],
    stats: &mut Stats,
) -> [States<f64>; 3] {
    let mut slopes = [[0.0; MAX_COMPONENTS]; 3];
    for i in 0..3 {
        slopes[i] = problem.rates(C[i], &stages[i], stats);
    }
    slopes
}

/// A 3 x 3 matrix times the three stages.
#[inline(always)]
fn transform(size: Size, matrix: &[[f64; 3]; 3], stages: &[States<f64>; 3]) -> [States<f64>; 3] {
    let mut out = [[0.0; MAX_COMPONENTS]; 3];
    for (row, out) in matrix.iter().zip(&mut out) {
        size.each(|n| {
            out[n] = row[2].mul_add(stages[2][n], row[1].mul_add(stages[1][n], row[0] * stages[0][n]));
        });
    }
    out
}

/// The collocation polynomial through `stages`, less its value at 0. `x` is measured in lengths of the step.
#[inline(always)]
fn polynomial(stages: &[States<f64>; 3], x: f64) -> States<f64> {
    let mut weights = [0.0; 3];
    for (weight, row) in weights.iter_mut().zip(P) {
        *weight = x * x.mul_add(x.mul_add(row[2], row[1]), row[0]);
    }
    let mut value = [0.0; MAX_COMPONENTS];
    for (weight, stage) in weights.iter().zip(stages) {
        for n in 0..MAX_COMPONENTS {
            value[n] = weight.mul_add(stage[n], value[n]);
        }
    }
    value
}

impl Radau5 {
    /// The start of the iteration: the polynomial of the last step if it can predict this step, else the
    /// direction of the rates if they can, else zero.
    #[inline(always)]
    fn guess<S: System<f64>, F>(&self, problem: &Problem<'_, S, F>) -> [States<f64>; 3] {
        let step = problem.step;
        let size = step.system.size();
        let mut z = [[0.0; MAX_COMPONENTS]; 3];
        match self.length {
            Some(length) => {
                for (z, c) in z.iter_mut().zip(C) {
                    *z = polynomial(&self.stages, 1.0 + c * step.h / length);
                    size.each(|n| z[n] -= self.stages[2][n]);
                }
            }
            None if problem.is_smooth() => {
                for (z, c) in z.iter_mut().zip(C) {
                    for n in 0..size.states {
                        z[n] = c * step.h * step.rate[n];
                    }
                }
            }
            None => {}
        }
        z
    }
}

impl<S: System<f64>> Scheme<S> for Radau5 {
    type Factors = Pair;
    const FACTORISATIONS: u64 = 2;

    #[inline(always)]
    fn factor(linearization: &Linearization, h: f64) -> Pair {
        Pair { real: linearization.factor(REAL / h), complex: linearization.factor(COMPLEX / h) }
    }

    #[inline(always)]
    fn solve(&mut self, problem: &Problem<'_, S, Pair>, stats: &mut Stats) -> Solved {
        let step = problem.step;
        let size = step.system.size();
        let (real, complex) = (REAL / step.h, COMPLEX / step.h);
        let mut z = self.guess(problem);
        let mut w = transform(size, &T_INVERSE, &z);
        let mut iteration = Iteration::new(step.allowed);
        loop {
            stats.iterations += 1;
            let f = transform(size, &T_INVERSE, &slopes(problem, &z, stats));
            let mut alone = f[0];
            let mut pair = [Complex::new(0.0, 0.0); MAX_COMPONENTS];
            for n in 0..size.states {
                alone[n] = real.mul_add(-w[0][n], f[0][n]);
                pair[n] = Complex::new(f[1][n], f[2][n]) - complex * Complex::new(w[1][n], w[2][n]);
            }
            let alone = problem.linearization.solve(&problem.factors.real, &alone);
            let pair = problem.linearization.solve(&problem.factors.complex, &pair);
            let mut corrections = [alone, [0.0; MAX_COMPONENTS], [0.0; MAX_COMPONENTS]];
            for n in 0..size.states {
                corrections[1][n] = pair[n].re;
                corrections[2][n] = pair[n].im;
            }
            let mut largest = 0.0;
            for (w, correction) in w.iter_mut().zip(&corrections) {
                for n in 0..size.states {
                    w[n] += correction[n];
                }
                let own = problem.size(correction);
                if own > largest || own.is_nan() {
                    largest = own;
                }
            }
            z = transform(size, &T, &w);
            if iteration.judge(largest)? {
                break;
            }
        }
        if size.all() > size.states {
            // The works are the integrals of the powers, by the same tableau.
            let works = transform(size, &A, &slopes(problem, &z, stats));
            for (z, works) in z.iter_mut().zip(works) {
                for n in size.states..size.all() {
                    z[n] = step.h * works[n];
                }
            }
        }
        let mut next = *step.y;
        size.each(|n| next[n] += z[2][n]);
        // The stages may predict the next step once this step is accepted.
        (self.stages, self.length) = (z, None);
        Ok((next, iteration.rate))
    }

    #[inline(always)]
    fn restart(&mut self) {
        self.length = None;
    }
}

impl<S: System<f64>, T: Linear<f64>> Adaptive<f64, S> for Newton<Radau5, Pair, T> {
    /// (REAL/h - J)^-1 (f_0 + sum of e_i z_i / h). After a rejected step this estimate is added to the state,
    /// and a second estimate is computed there, which damps the stiff part of the first.
    #[inline(always)]
    fn error(&mut self, step: &Step<'_, f64, S>, retried: Bits, stats: &mut Stats) -> f64 {
        let &Step { system, drive, .. } = step;
        let Some((linearization, factors)) = self.last() else { return f64::NAN };
        let weights = step.weights();
        let size = system.size();
        let mut sum = [0.0; MAX_COMPONENTS];
        for (e, stage) in E.iter().zip(&self.scheme.stages) {
            size.each(|n| sum[n] = (e / step.h).mul_add(stage[n], sum[n]));
        }
        let estimate = |rate: &States<f64>| {
            let mut both = sum;
            size.each(|n| both[n] += rate[n]);
            linearization.solve(&factors.real, &both)
        };
        let first = estimate(step.rate);
        let error = largest(size, &first, &weights);
        if error <= 1.0 || retried == 0 {
            return error;
        }
        stats.evaluations += 1;
        let mut rate = *step.rate;
        let perturbed = StageState { from: step.y, by: 1.0, along: &first };
        system.rates(&drive.at(step.tau), drive, perturbed, &mut rate);
        largest(size, &estimate(&rate), &weights)
    }

    #[inline(always)]
    fn accepted(&mut self, h: f64) {
        self.scheme.length = Some(h);
    }

    #[inline(always)]
    fn interpolate(&self, y: &States<f64>, _: &States<f64>, x: f64) -> States<f64> {
        let mut at = polynomial(&self.scheme.stages, x);
        for n in 0..MAX_COMPONENTS {
            at[n] += y[n];
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
        Matrix3::from_fn(|r, c| rows[r][c])
    }

    /// The transformation splits the inverse tableau into its blocks, and the tableau is that of the
    /// collocation method at its nodes. An error in any digit shows.
    #[test]
    fn the_tableau_and_its_transformation_are_consistent() {
        let transformed = matrix(&T_INVERSE) * matrix(&A).try_inverse().unwrap() * matrix(&T);
        let blocks = Matrix3::new(REAL, 0.0, 0.0, 0.0, COMPLEX.re, -COMPLEX.im, 0.0, COMPLEX.im, COMPLEX.re);
        assert!((transformed - blocks).amax() < 2e-14, "{transformed}");
        assert!((matrix(&T) * matrix(&T_INVERSE) - Matrix3::identity()).amax() < 1e-15);
        for (row, c) in A.iter().zip(C) {
            for power in 1..=3 {
                let sum: f64 = row.iter().zip(C).map(|(a, c)| a * c.powi(power - 1)).sum();
                assert!((sum - c.powi(power) / f64::from(power)).abs() < 1e-15, "{c} {power}");
            }
        }
        // The weights integrate powers up to the fourth exactly.
        for power in 1..=5 {
            let sum: f64 = A[2].iter().zip(C).map(|(b, c)| b * c.powi(power - 1)).sum();
            assert!((sum - 1.0 / f64::from(power)).abs() < 1e-15, "{power}");
        }
        // The formula of the error estimate has order three: with the rate at the start it vanishes for
        // polynomials up to the cubic.
        for power in 1..=3 {
            let start = if power == 1 { 1.0 } else { 0.0 };
            let sum: f64 = E.iter().zip(C).map(|(e, c)| e * c.powi(power)).sum();
            assert!((sum + start).abs() < 1e-14, "{power} {sum}");
        }
    }
}
