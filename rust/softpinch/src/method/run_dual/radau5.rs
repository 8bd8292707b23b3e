//! The derivative of a step of Radau IIA.

use std::ops::Range;

use nalgebra::DMatrix;

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::run_dual::RunDual;
use crate::formulation::system::{Jacobian, Linear, System};
use crate::method::newton::Newton;
use crate::method::radau5::{A, C, Pair, Radau5};
use crate::method::run_dual::{Differentiable, SolvedStep, add_scaled};
use crate::model::source::DIRECTIONS;
use crate::number::lanes::Lanes;
use crate::number::real::Real;

/// The stages' derivatives of the rates, at first for constant z_i, in the end all.
type Stages<R> = [States<RunDual<R>>; 3];

impl<R: Lanes, T: Linear<f64>> Differentiable<R> for Newton<Radau5, Pair, T> {
    /// The stages are y + z_i with z_i = h sum of a_ij k_j and k_i = f(y + z_i). So dk_i is the derivative of
    /// f(y + z_i) for constant z_i, plus J_i h sum of a_ij dk_j, where J_i is the Jacobian at the stage.
    ///
    /// As in `linearize.rs`, the rates of the coordinates x are v, and those of the remaining states r depend on x
    /// and v only. So only the derivatives of the rates of v are unknowns of the linear system; those of x and
    /// r follow from them.
    #[inline(always)]
    fn differentiate(&self, solved: &SolvedStep<'_, R>) -> States<RunDual<R>> {
        let SolvedStep { equations, step, .. } = solved;
        let size = equations.system.size();
        let (h, d, states) = (step.h.lane(0), size.degrees, size.states);
        let mut jacobians = [Jacobian::zero(); 3];
        let mut slopes = [[RunDual::zero(); MAX_COMPONENTS]; 3];
        for i in 0..3 {
            let mut z = self.scheme.stages[i];
            z[states..].fill(0.0);
            (slopes[i], jacobians[i]) = solved.stage(&self.tangent, C[i], &z);
            for slope in &mut slopes[i] {
                slope.value = R::zero();
            }
        }
        let lu = velocity_system(&jacobians, h, d, states).lu();

        // What x and r contribute if the rates of v do not change.
        let mut still = slopes;
        for stage in &mut still {
            stage[d..2 * d].fill(RunDual::zero());
        }
        let moved = weighted(h, &still);
        multiply(&jacobians, (2 * d..states, 0..d), &moved, &mut still);
        let moved = weighted(h, &still);
        let mut loads = slopes;
        multiply(&jacobians, (d..2 * d, 0..d), &moved, &mut loads);
        multiply(&jacobians, (d..2 * d, 2 * d..states), &moved, &mut loads);
        let right = DMatrix::from_fn(3 * d, DIRECTIONS, |row, k| loads[row / d][d + row % d].direction(k));
        // A singular matrix belongs to a step without a solution, which Newton's method refuses.
        let solution = lu.solve(&right).unwrap_or(right);
        for row in 0..3 * d {
            let own: [f64; DIRECTIONS] = std::array::from_fn(|k| solution[(row, k)]);
            slopes[row / d][d + row % d] = RunDual::varied(0.0, &own);
        }

        // The rates of x, then those of r, then the powers, which are the rates of the works.
        let changes = weighted(h, &slopes);
        for i in 0..3 {
            for n in 0..d {
                slopes[i][n] = slopes[i][n] + changes[i][d + n];
            }
        }
        let changes = weighted(h, &slopes);
        multiply(&jacobians, (2 * d..states, 0..2 * d), &changes, &mut slopes);
        let changes = weighted(h, &slopes);
        multiply(&jacobians, (states..size.all(), 0..states), &changes, &mut slopes);
        let [_, _, change] = weighted(h, &slopes);
        let mut next = *step.y;
        for n in 0..size.all() {
            next[n] = step.y[n] + change[n];
        }
        next
    }
}

/// For each stage i the sum of h a_ij k_j.
#[inline(always)]
fn weighted<R: Lanes>(h: f64, of: &Stages<R>) -> Stages<R> {
    let mut sums = [[RunDual::zero(); MAX_COMPONENTS]; 3];
    for i in 0..3 {
        for j in 0..3 {
            let weight = R::constant(h * A[i][j]);
            for n in 0..MAX_COMPONENTS {
                add_scaled(&mut sums[i][n], weight, &of[j][n]);
            }
        }
    }
    sums
}

/// Adds to these rows of `to` these columns of each stage's Jacobian times `of`.
#[inline(always)]
fn multiply<R: Lanes>(
    jacobians: &[Jacobian; 3],
    (rows, columns): (Range<usize>, Range<usize>),
    of: &Stages<R>,
    to: &mut Stages<R>,
) {
    for i in 0..3 {
        for n in rows.clone() {
            for m in columns.clone() {
                let entry = R::constant(jacobians[i].rows[n][m]);
                add_scaled(&mut to[i][n], entry, &of[i][m]);
            }
        }
    }
}

/// The matrix of the linear system for the derivatives of the three stages' rates of v.
fn velocity_system(jacobians: &[Jacobian; 3], h: f64, d: usize, states: usize) -> DMatrix<f64> {
    let b = |i: usize, j: usize| h * A[i][j];
    let mut twice = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            twice[i][j] = (0..3).map(|k| b(i, k) * b(k, j)).sum();
        }
    }
    let mut matrix = DMatrix::identity(3 * d, 3 * d);
    for i in 0..3 {
        let rows = &jacobians[i].rows;
        for l in 0..3 {
            // How the remaining states follow the rates of v: their own rates depend on x and v.
            let mut follow = [[0.0; MAX_COMPONENTS]; MAX_COMPONENTS];
            for r in 2 * d..states {
                for j in 0..3 {
                    let inner = &jacobians[j].rows[r];
                    let (by_x, by_v) = (b(i, j) * twice[j][l], b(i, j) * b(j, l));
                    for n in 0..d {
                        follow[r][n] += by_x * inner[n] + by_v * inner[d + n];
                    }
                }
            }
            for n in 0..d {
                for m in 0..d {
                    let row = &rows[d + m];
                    let mut entry = twice[i][l] * row[n] + b(i, l) * row[d + n];
                    for r in 2 * d..states {
                        entry += row[r] * follow[r][n];
                    }
                    matrix[(i * d + m, l * d + n)] -= entry;
                }
            }
        }
    }
    matrix
}
