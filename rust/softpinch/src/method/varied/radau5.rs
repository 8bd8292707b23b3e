//! The derivative of a step of Radau IIA.

use nalgebra::{DMatrix, Dyn, OMatrix, U8};

use crate::formulation::equations::{MAX_COMPONENTS, States};
use crate::formulation::system::{Jacobian, Linear, StageState, System};
use crate::formulation::varied_equations::{DIRECTIONS, Varied, VariedEquations};
use crate::method::newton::Newton;
use crate::method::radau5::{A, C, Pair, Radau5};
use crate::method::traits::Step;
use crate::method::varied::{Differentiable, Drives, constants, values};
use crate::model::drive::Drive;
use crate::number::lanes::Lanes;
use crate::number::real::Real;

impl<T: Linear<f64>> Differentiable for Newton<Radau5, Pair, T> {
    /// The stages are y + z_i with z_i = h sum of a_ij k_j and k_i = f(y + z_i). So
    /// dk_i - J_i h sum of a_ij dk_j is the derivative of f(y + z_i) for constant z_i, where J_i is the Jacobian
    /// at the stage.
    #[inline(always)]
    fn differentiate(
        &self,
        system: &VariedEquations,
        drives: &Drives<'_>,
        step: &Step<'_, Varied>,
        end: &States<f64>,
        next: &mut States<Varied>,
    ) {
        let size = system.size();
        let (h, n) = (step.h.value, size.states);
        let mut loads = [[Varied::zero(); MAX_COMPONENTS]; 3];
        let mut jacobians = [Jacobian::zero(); 3];
        for i in 0..3 {
            let mut z = self.scheme.stages()[i];
            z[n..].fill(0.0);
            let along = constants(&z);
            let at = StageState { from: step.y, by: Varied::constant(1.0), along: &along };
            let tau = step.tau + Varied::constant(C[i] * h);
            system.rates(&drives.varied.at(tau), &drives.varied.contacts, at, &mut loads[i]);
            let mut there = values(step.y);
            for m in 0..n {
                there[m] += z[m];
            }
            self.tangent().jacobian_into(drives.own, tau.lane(0), &there, &mut jacobians[i]);
        }
        let matrix = DMatrix::from_fn(3 * n, 3 * n, |row, column| {
            let (i, a, j, b) = (row / n, row % n, column / n, column % n);
            f64::from(row == column) - h * A[i][j] * jacobians[i].rows[a][b]
        });
        let mut slopes = OMatrix::<f64, Dyn, U8>::from_fn(3 * n, |row, k| loads[row / n][row % n].slope[k]);
        // A singular matrix would be a step without a solution, which Newton's method refuses.
        matrix.lu().solve_mut(&mut slopes);

        *next = constants(end);
        for k in 0..DIRECTIONS {
            for m in 0..n {
                let sum: f64 = (0..3).map(|j| A[2][j] * slopes[(j * n + m, k)]).sum();
                next[m].slope[k] = h.mul_add(sum, step.y[m].slope[k]);
            }
            // The works are the integrals of the powers, by the same tableau.
            for m in n..size.all() {
                let mut sum = 0.0;
                for i in 0..3 {
                    let mut power = loads[i][m].slope[k];
                    for b in 0..n {
                        let dz: f64 = (0..3).map(|j| A[i][j] * slopes[(j * n + b, k)]).sum();
                        power += jacobians[i].rows[m][b] * h * dz;
                    }
                    sum += A[2][i] * power;
                }
                next[m].slope[k] = h.mul_add(sum, step.y[m].slope[k]);
            }
        }
    }
}
