//! Newton's method for the balance of forces at rest.

use nalgebra::{DMatrix, SMatrix, SVector};

use crate::analysis::balance::{FINGER, Rows};
use crate::analysis::{Member, RestScene, UNKNOWNS, Unknowns};

/// Most iterations from one start.
const ITERATIONS: usize = 60;
/// Longest step of an unknown, in its scale: half a tip's radius, or half a radian.
const LONGEST: f64 = 0.5;
/// A row counts as zero below this share of its terms.
const ROUND_OFF: f64 = 1e-11;
const HALVINGS: usize = 8;

pub(super) type Matrix7 = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
pub(super) type Vector7 = SVector<f64, UNKNOWNS>;

/// A state in which all forces balance.
#[derive(Debug, Clone, Copy)]
pub struct Rest {
    /// The unknowns.
    pub z: Unknowns,
    /// The rows and their derivatives there.
    pub rows: Rows,
}

impl Rest {
    /// Solves the balance from a start. `None` if Newton's method does not converge.
    pub fn solve(scene: &RestScene, member: &Member, start: &Unknowns) -> Option<Self> {
        let (unit, scale) = scene.scales();
        let size = |rows: &Rows| largest(&rows.values, &scale);
        let mut now = Self { z: *start, rows: scene.rows(member, start) };
        let mut error = size(&now.rows);
        for _ in 0..ITERATIONS {
            if !error.is_finite() {
                return None;
            }
            let Some(step) = now.newton_step(&unit, &scale) else { break };
            let longest = step.amax();
            let mut share = if longest > LONGEST { LONGEST / longest } else { 1.0 };
            let mut next = None;
            for _ in 0..HALVINGS {
                let z = scene.moved(&now.z, &step, share, &unit);
                let rows = scene.rows(member, &z);
                let found = size(&rows);
                if found < error * (1.0 - 1e-3 * share) {
                    next = Some((Self { z, rows }, found));
                    break;
                }
                share *= 0.5;
            }
            // Round-off alone is left, or a minimum of the rows that is not zero.
            let Some((better, smaller)) = next else { break };
            (now, error) = (better, smaller);
            if error == 0.0 {
                break;
            }
        }
        now.balances(scene).then_some(now)
    }

    fn newton_step(&self, unit: &Unknowns, scale: &Unknowns) -> Option<Vector7> {
        let matrix = Matrix7::from_fn(|r, c| self.rows.jacobian[r][c] * unit[c] / scale[r]);
        let load = Vector7::from_fn(|r, _| -self.rows.values[r] / scale[r]);
        matrix.lu().solve(&load).filter(|step| step.iter().all(|x| x.is_finite()))
    }

    /// Whether the rows are zero but for round-off.
    pub fn balances(&self, scene: &RestScene) -> bool {
        let terms = scene.terms(&self.rows.balance);
        self.rows.values.iter().zip(terms).all(|(row, term)| row.abs() <= ROUND_OFF * term)
    }

    /// Whether both tips are compressed, by less than their radius, and tilted by less than a right angle.
    pub fn is_grasp(&self, scene: &RestScene) -> bool {
        let balance = &self.rows.balance;
        (0..2).all(|i| {
            let compression = balance.q.compression[i];
            compression > 0.0
                && compression < scene.parameters.tips[i].radius
                && balance.tilt[i].abs() < std::f64::consts::FRAC_PI_2
        })
    }

    /// The stiffness of the grasp: minus the derivatives of the five forces by the pose, while the shears follow
    /// from the no-slip constraint. The torques of the fingers are constant. The first three rows and columns are the force
    /// and moment by which the object, between held fingers, resists a displacement in x, y and theta.
    pub fn stiffness(&self) -> SMatrix<f64, 5, 5> {
        let Rows { forces, no_slip, .. } = &self.rows;
        SMatrix::from_fn(|r, c| {
            -(forces[r][c] + (forces[r][5] * no_slip[0][c] + forces[r][6] * no_slip[1][c]))
        })
    }

    /// The energy's second derivatives, in the scale of the unknowns, by the displacements that the no-slip constraint
    /// admits: of the object, and of the fingers that are not held. Where its determinant changes its sign, slow
    /// displacements begin to grow.
    pub fn free_stiffness(&self, scene: &RestScene) -> DMatrix<f64> {
        let held = scene.held();
        let mut stiffness = self.stiffness();
        for i in 0..2 {
            stiffness[(FINGER + i, FINGER + i)] += scene.torque_slope(i);
        }
        let (unit, scale) = scene.scales();
        let free: Vec<usize> = (0..5).filter(|&k| k < FINGER || !held[k - FINGER]).collect();
        let energy = scale[0] * unit[0];
        DMatrix::from_fn(free.len(), free.len(), |r, c| {
            stiffness[(free[r], free[c])] * (unit[free[r]] * unit[free[c]] / energy)
        })
    }

    /// Whether the energy has a minimum here along every displacement that the no-slip constraint admits: the symmetric
    /// part of the stiffness is positive definite.
    pub fn is_minimum(&self, scene: &RestScene) -> bool {
        let stiffness = self.free_stiffness(scene);
        (&stiffness + stiffness.transpose()).cholesky().is_some()
    }
}

impl RestScene {
    /// Unknowns after a share of a step. A whole step brings held fingers to their targets without round-off.
    fn moved(&self, z: &Unknowns, step: &Vector7, share: f64, unit: &Unknowns) -> Unknowns {
        let mut next: Unknowns = std::array::from_fn(|k| z[k] + share * step[k] * unit[k]);
        for (i, held) in self.held().into_iter().enumerate() {
            if held && share == 1.0 {
                next[FINGER + i] = self.input.target[i];
            }
        }
        next
    }
}

/// The largest of these numbers in their scales.
pub(super) fn largest(values: &Unknowns, scale: &Unknowns) -> f64 {
    // `max` would ignore NaN.
    values
        .iter()
        .zip(scale)
        .map(|(value, scale)| (value / scale).abs())
        .fold(0.0, |most, size| if size > most || size.is_nan() { size } else { most })
}
