//! The motion linearised about one state: the Jacobian whose eigenvalues say how fast it is and which steps it allows.

use nalgebra::DMatrix;

use crate::error::Error;
use crate::formulation::{Build, Compiled, Formulation, Motion, System, compiled};
use crate::inputs::Inputs;
use crate::integrator::linearize::{Directions, Linearizable};
use crate::parameters::{Parameters, Rule, Stabilization};
use crate::simd::Level;

/// The derivatives of the state's rates by the state, in the formulation's own states, at time `t` (where an input jumps:
/// just after).
pub fn jacobian(
    parameters: &Parameters,
    inputs: &Inputs,
    (formulation, gains, level): (Formulation, &Stabilization, Level),
    t: f64,
    motion: &Motion<f64>,
) -> Result<DMatrix<f64>, Error> {
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
    type Output = DMatrix<f64>;

    fn run<B: Build<N> + Build<M>, const N: usize, const M: usize, const D: usize>(self) -> DMatrix<f64> {
        let Self { parameters, inputs, gains, level, t, motion } = self;
        // With the ledger, whose rows are left out: that is compiled for every processor.
        let system = <B as Build<M>>::build::<f64>(parameters, gains);
        let y: [f64; M] = system.begin(motion);
        let dual = <B as Build<M>>::rates::<Directions>(parameters, gains);
        let rows = dual.jacobian(level, &inputs.segment(t), 0.0, &y).rows;
        DMatrix::from_fn(N, N, |row, column| rows[row][column])
    }
}
