//! Linearisations of the motion.

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{GivenRow, GivenRows, Physics, columns, entries, motion, raise, require, room};
use crate::inputs::Inputs;
use crate::signals::Signals;
use softpinch::analysis::{LinearModel, Problem, Setting};
use softpinch::error::lookup;
use softpinch::formulation::FORMULATIONS;
use softpinch::model::Stabilization;

/// The arrays of a linear model, and the numbers of their axes.
const ARRAYS: [(&str, usize); 8] =
    [("A", 2), ("B", 2), ("C", 2), ("D", 2), ("state", 1), ("rate", 1), ("input", 1), ("output", 1)];

/// The linearised motion about the rows of a run: A (n, states, states), and if `whole` B, C, D and the
/// operating points too. Unilateral contacts are in the modes of the rows of `contacts` (n, 4). The eigenvalues are left to LAPACK.
#[pyfunction]
#[pyo3(signature = (parameters, inputs, t, q, p, integral, formulation, alpha, beta, *, contacts, whole, open_loop, frozen))]
pub fn linearize<'py>(
    py: Python<'py>,
    parameters: Physics,
    inputs: &Inputs,
    t: GivenRow<'py>,
    q: GivenRows<'py>,
    p: GivenRows<'py>,
    integral: GivenRows<'py>,
    formulation: &str,
    alpha: f64,
    beta: f64,
    contacts: Option<GivenRows<'py>>,
    whole: bool,
    open_loop: bool,
    frozen: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let inputs = inputs.of(0, 0.0).map_err(raise)?;
    let formulation = lookup("formulation", formulation, &FORMULATIONS).map_err(raise)?;
    let setting = Setting { formulation, gains: Stabilization { alpha, beta }, open_loop, frozen };
    let t = entries("t, in numbers,", &t)?;
    let (q, p) = (columns::<9>("q", &q)?, columns::<9>("p", &p)?);
    let memory = integral.as_array();
    require(memory.ncols() >= 2, || "integral: must have two columns".to_owned())?;
    let (n, others) = (t.len(), [q.len(), p.len(), memory.nrows()]);
    require(others == [n; 3], || {
        let [q, p, memory] = others;
        format!("t, q, p and integral have {n}, {q}, {p} and {memory} rows: must be equal")
    })?;
    let contacts = contacts.map(|rows| columns::<4>("contacts", &rows)).transpose()?;
    require(contacts.as_ref().is_none_or(|rows| rows.len() == n), || {
        format!("contacts: must have {n} rows, as t has")
    })?;
    // For each array its shape, and its numbers at all instants.
    let mut stacks = ARRAYS.map(|(_, axes)| (vec![0; axes], Vec::new()));
    let mut push = |place: usize, own: &[usize], numbers: &[f64]| {
        let (shape, stack) = &mut stacks[place];
        if stack.capacity() == 0 {
            *shape = own.to_vec();
            *stack = room("the linear models, in numbers,", n.saturating_mul(numbers.len()))?;
        }
        stack.extend_from_slice(numbers);
        PyResult::Ok(())
    };
    py.detach(|| {
        let mut signals = Signals::new();
        for (k, &t) in t.iter().enumerate() {
            signals.check()?;
            // After the integrals the states of Maxwell branches, if they are given.
            let all = memory.row(k).to_vec();
            let motion = motion(&parameters.0, (q[k], p[k], [all[0], all[1]]), &all[2..]);
            let contact = contacts.as_ref().map(|rows| &rows[k]);
            let problem =
                Problem::new(&parameters.0, &inputs, &setting, t, &motion, contact).map_err(raise)?;
            if !whole {
                let a = problem.jacobian();
                push(0, &[a.nrows(), a.ncols()], a.transpose().as_slice())?;
                continue;
            }
            let LinearModel { matrices, vectors } = problem.model().map_err(raise)?;
            for (place, matrix) in matrices.into_iter().enumerate() {
                push(place, &[matrix.nrows(), matrix.ncols()], matrix.transpose().as_slice())?;
            }
            for (place, vector) in vectors.into_iter().enumerate() {
                push(4 + place, &[vector.len()], vector.as_slice())?;
            }
        }
        PyResult::Ok(())
    })?;
    let out = PyDict::new(py);
    for ((name, _), (shape, numbers)) in ARRAYS.into_iter().zip(stacks).take(if whole { 8 } else { 1 }) {
        let shape: Vec<usize> = [n].into_iter().chain(shape).collect();
        out.set_item(name, PyArray1::from_vec(py, numbers).reshape(shape)?)?;
    }
    Ok(out)
}
