//! The motion linearised about one state: its Jacobian, and the eigenvalues that say how fast it is and which steps it allows.

use nalgebra::linalg::{Schur, balancing::balance_parlett_reinsch};
use nalgebra::{Complex, DMatrix};

use crate::error::Error;
use crate::formulation::{Build, Compiled, Formulation, Motion, System, compiled};
use crate::inputs::Inputs;
use crate::integrator::linearize::{Directions, Linearizable};
use crate::parameters::{Parameters, Rule, Stabilization};
use crate::simd::Level;

/// Sweeps of the QR iteration for each state: far more than it takes.
const SWEEPS: usize = 100;
/// What is below so many units in the last place of its neighbours counts as zero there; the later ones where the earlier fail.
const THRESHOLDS: [f64; 4] = [1.0, 8.0, 64.0, 4096.0];

/// The motion linearised about one state.
#[derive(Debug, Clone, PartialEq)]
pub struct Modes {
    /// The derivatives of the state's rates by the state, in the formulation's own states.
    pub jacobian: DMatrix<f64>,
    /// Its eigenvalues, 1/s; empty where an entry is not finite.
    pub rates: Vec<Complex<f64>>,
}

/// The motion about a state at time `t` (where an input jumps: just after).
pub fn modes(
    parameters: &Parameters,
    inputs: &Inputs,
    (formulation, gains, level): (Formulation, &Stabilization, Level),
    t: f64,
    motion: &Motion<f64>,
) -> Result<Modes, Error> {
    Rule::Finite.check("t", t)?;
    Ok(compiled(formulation, inputs.fingers(), About { parameters, inputs, gains, level, t, motion }))
}

/// What is linearised, and where.
struct About<'a> {
    parameters: &'a Parameters,
    inputs: &'a Inputs,
    gains: &'a Stabilization,
    level: Level,
    t: f64,
    motion: &'a Motion<f64>,
}

impl Compiled for About<'_> {
    type Output = Modes;

    fn run<B: Build<N> + Build<M>, const N: usize, const M: usize, const D: usize>(self) -> Modes {
        let Self { parameters, inputs, gains, level, t, motion } = self;
        // With the ledger, whose rows are left out: that is compiled for every processor.
        let system = <B as Build<M>>::build::<f64>(parameters, gains);
        let y: [f64; M] = system.begin(motion);
        let dual = <B as Build<M>>::rates::<Directions>(parameters, gains);
        let rows = dual.jacobian(level, &inputs.segment(t), 0.0, &y).rows;
        let jacobian = DMatrix::from_fn(N, N, |row, column| rows[row][column]);
        // Metres, radians and their rates: in the states' own sizes the entries are closer to each other, and so are the
        // errors of eigenvalues.
        let mut sizes: [f64; M] = system.begin(&Motion::sizes(parameters));
        for size in &mut sizes {
            *size = if size.is_finite() { *size } else { 1.0 };
        }
        let scaled =
            DMatrix::from_fn(N, N, |row, column| jacobian[(row, column)] * (sizes[column] / sizes[row]));
        Modes { rates: eigenvalues(scaled), jacobian }
    }
}

fn eigenvalues(mut matrix: DMatrix<f64>) -> Vec<Complex<f64>> {
    if !matrix.iter().all(|entry| entry.is_finite()) {
        return Vec::new();
    }
    balance_parlett_reinsch(&mut matrix);
    let sweeps = SWEEPS * matrix.nrows();
    // Where eigenvalues meet, round-off can keep what should vanish just above the smallest threshold for ever.
    let schur =
        THRESHOLDS.into_iter().find_map(|ulps| Schur::try_new(matrix.clone(), ulps * f64::EPSILON, sweeps));
    schur.map_or_else(Vec::new, |schur| schur.complex_eigenvalues().iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The companion matrix of (x + 1)(x + 1e6)(x^2 + 2 x + 1e8), badly scaled on purpose.
    #[test]
    fn eigenvalues_of_a_known_matrix() {
        let blocks = DMatrix::from_row_slice(
            4,
            4,
            &[-1.0, 0.0, 0.0, 0.0, 0.0, -1e6, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1e8, -2.0],
        );
        // A similarity that mixes everything.
        let mixer =
            DMatrix::from_fn(4, 4, |r, c| if r == c { 2.0 } else { 1.0 / (1.0 + (r + 2 * c) as f64) });
        let mixed = &mixer * blocks * mixer.clone().try_inverse().unwrap();
        let mut found = eigenvalues(mixed);
        found.sort_by(|a, b| (a.norm(), a.im).partial_cmp(&(b.norm(), b.im)).unwrap());
        let swing = (1e8_f64 - 1.0).sqrt();
        let expected = [(-1.0, 0.0), (-1.0, -swing), (-1.0, swing), (-1e6, 0.0)];
        for (found, (re, im)) in found.iter().zip(expected) {
            // What round-off of the matrix, whose entries go to 1e8, makes of them.
            assert!((found - Complex::new(re, im)).norm() < 1e-5 * (1.0 + re.abs().sqrt()), "{found}");
        }
        assert!(eigenvalues(DMatrix::from_element(3, 3, f64::NAN)).is_empty());
    }
}
