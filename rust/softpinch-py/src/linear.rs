//! Linearisations of the motion.

use numpy::{Ix2, Ix3, PyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{columns, entries, raise, room};
use crate::inputs::Inputs;
use crate::signals::Signals;
use softpinch::analysis::linear::{self, LinearModel, Setting};
use softpinch::error::lookup;
use softpinch::formulation::table::FORMULATIONS;
use softpinch::model::motion::Motion;
use softpinch::model::parameters::Stabilization;
use softpinch::number::simd::level::Level;

/// The same array of several instants, row by row.
#[derive(Default)]
struct Stack {
    rows: usize,
    columns: usize,
    numbers: Vec<f64>,
}

impl Stack {
    /// Adds a matrix, whose rows are the columns of `transposed`. The first one reserves the memory of all.
    fn push(&mut self, transposed: (usize, usize), numbers: &[f64], instants: usize) -> PyResult<()> {
        if self.numbers.capacity() == 0 {
            (self.columns, self.rows) = transposed;
            self.numbers = room("the linear models, in numbers,", instants.saturating_mul(numbers.len()))?;
        }
        self.numbers.extend(numbers);
        Ok(())
    }

    fn matrices(self, py: Python<'_>, instants: usize) -> PyResult<Bound<'_, PyArray<f64, Ix3>>> {
        PyArray1::from_vec(py, self.numbers).reshape([instants, self.rows, self.columns])
    }

    fn vectors(self, py: Python<'_>, instants: usize) -> PyResult<Bound<'_, PyArray<f64, Ix2>>> {
        PyArray1::from_vec(py, self.numbers).reshape([instants, self.columns])
    }
}

/// The linearised motion about the rows of a run: A (n, states, states), and if `whole` B, C, D and the
/// operating points too. The eigenvalues are left to LAPACK.
#[pyfunction]
#[pyo3(signature = (parameters, inputs, t, q, p, integral, formulation, alpha, beta, *, whole, open_loop, frozen))]
#[allow(clippy::too_many_arguments)] // Python passes every argument by itself
pub fn linearize<'py>(
    py: Python<'py>,
    parameters: PyReadonlyArray1<'py, f64>,
    inputs: &Inputs,
    t: PyReadonlyArray1<'py, f64>,
    q: PyReadonlyArray2<'py, f64>,
    p: PyReadonlyArray2<'py, f64>,
    integral: PyReadonlyArray2<'py, f64>,
    formulation: &str,
    alpha: f64,
    beta: f64,
    whole: bool,
    open_loop: bool,
    frozen: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let parameters = crate::parameters(&parameters)?;
    let inputs = inputs.of(0, 0.0).map_err(raise)?;
    let formulation = lookup("formulation", formulation, &FORMULATIONS).map_err(raise)?;
    let level = Level::from_environment().map_err(raise)?;
    let setting = Setting { formulation, gains: Stabilization { alpha, beta }, level, open_loop, frozen };
    let t = entries("t, in numbers,", &t)?;
    let (q, p) = (columns::<9>("q", &q)?, columns::<9>("p", &p)?);
    let memory = columns::<2>("integral", &integral)?;
    if [q.len(), p.len(), memory.len()] != [t.len(); 3] {
        return Err(PyValueError::new_err(format!(
            "t, q, p and integral have {}, {}, {} and {} rows: must be equal",
            t.len(),
            q.len(),
            p.len(),
            memory.len()
        )));
    }
    let n = t.len();
    let [mut a, mut b, mut c, mut d, mut state, mut rate, mut input, mut output] =
        std::array::from_fn::<Stack, 8, _>(|_| Stack::default());
    py.detach(|| {
        let mut signals = Signals::new();
        for (k, &t) in t.iter().enumerate() {
            signals.check()?;
            let motion = Motion { q: q[k], p: p[k], memory: memory[k] };
            if !whole {
                let jacobian =
                    linear::jacobian(&parameters, &inputs, &setting, t, &motion).map_err(raise)?.transpose();
                a.push(jacobian.shape(), jacobian.as_slice(), n)?;
                continue;
            }
            let LinearModel {
                a: own_a,
                b: own_b,
                c: own_c,
                d: own_d,
                state: x,
                rate: v,
                input: u,
                output: y,
            } = linear::linearize(&parameters, &inputs, &setting, t, &motion).map_err(raise)?;
            for (stack, matrix) in [(&mut a, own_a), (&mut b, own_b), (&mut c, own_c), (&mut d, own_d)] {
                let matrix = matrix.transpose();
                stack.push(matrix.shape(), matrix.as_slice(), n)?;
            }
            for (stack, vector) in [(&mut state, x), (&mut rate, v), (&mut input, u), (&mut output, y)] {
                stack.push(vector.shape(), vector.as_slice(), n)?;
            }
        }
        PyResult::Ok(())
    })?;
    let out = PyDict::new(py);
    out.set_item(intern!(py, "A"), a.matrices(py, n)?)?;
    if whole {
        out.set_item(intern!(py, "B"), b.matrices(py, n)?)?;
        out.set_item(intern!(py, "C"), c.matrices(py, n)?)?;
        out.set_item(intern!(py, "D"), d.matrices(py, n)?)?;
        out.set_item(intern!(py, "state"), state.vectors(py, n)?)?;
        out.set_item(intern!(py, "rate"), rate.vectors(py, n)?)?;
        out.set_item(intern!(py, "input"), input.vectors(py, n)?)?;
        out.set_item(intern!(py, "output"), output.vectors(py, n)?)?;
    }
    Ok(out)
}
