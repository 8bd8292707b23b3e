//! The derivatives of a run across the border to Python.

use numpy::{Ix3, PyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::{PyKeyboardInterrupt, PyValueError};
use pyo3::prelude::*;

use crate::convert::{columns, entries, raise, room};
use crate::inputs::Inputs;
use crate::signals::Failure;
use crate::simulation::Simulation;
use softpinch::driver::sensitivities::{COMPONENTS, Direction, Shift, sensitivities as core};
use softpinch::error::lookup;
use softpinch::model::motion::Motion;
use softpinch::model::parameters::PARAMETER_COUNT;
use softpinch::model::start::STARTS;

/// The derivatives of a run at the times `rows` in the directions that the rows of `parameters` (d, 38), `initial`
/// (d, 20) and `impulse_times` (d, impulses) and the runs of `inputs` give. `shifts` (m, 9) has the direction, the
/// time, and the shifts of the targets (2), of their accelerations (2) and of the forces (3). The result is (rows,
/// components, d); `SENSITIVITIES` has the components.
#[pyfunction]
#[pyo3(signature = (simulation, parameters, inputs, *, initial, shifts, impulse_times, start, rows))]
#[allow(clippy::too_many_arguments)] // Python passes every argument by itself
pub fn sensitivities<'py>(
    py: Python<'py>,
    simulation: &Simulation,
    parameters: PyReadonlyArray2<'py, f64>,
    inputs: &Inputs,
    initial: PyReadonlyArray2<'py, f64>,
    shifts: PyReadonlyArray2<'py, f64>,
    impulse_times: PyReadonlyArray2<'py, f64>,
    start: Option<&str>,
    rows: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray<f64, Ix3>>> {
    let parameters = columns::<PARAMETER_COUNT>("parameters", &parameters)?;
    let initial = columns::<20>("initial", &initial)?;
    let shifts = columns::<9>("shifts", &shifts)?;
    let impulse_times = impulse_times.as_array();
    let count = parameters.len();
    if initial.len() != count || impulse_times.nrows() != count {
        return Err(PyValueError::new_err("parameters, initial and impulse_times: must have equal lengths"));
    }
    let start = start.map(|name| lookup("start", name, &STARTS)).transpose().map_err(raise)?;
    let rows = entries("rows, in numbers,", &rows)?;
    let mut directions = room("the directions", count)?;
    for k in 0..count {
        let [q, p, memory] = [0..9, 9..18, 18..20].map(|part| initial[k][part].to_vec());
        let take = |numbers: &[f64], n: usize| numbers.get(n).copied().unwrap_or(0.0);
        directions.push(Direction {
            parameters: parameters[k],
            inputs: inputs.of(k, 0.0).map_err(raise)?,
            initial: Motion {
                q: std::array::from_fn(|n| take(&q, n)),
                p: std::array::from_fn(|n| take(&p, n)),
                memory: std::array::from_fn(|n| take(&memory, n)),
            },
            shifts: shifts.iter().filter(|row| row[0] == k as f64).map(shift).collect(),
            impulse_times: impulse_times.row(k).to_vec(),
        });
    }
    let (scene, options) = simulation.parts();
    let (found, failure) = py.detach(|| {
        let failure = Failure::default();
        let interrupted = || failure.stops(|py| py.check_signals().map(|()| false));
        (core(scene, options, start, &directions, &rows, &interrupted), failure)
    });
    if failure.interrupted(py)? {
        return Err(PyKeyboardInterrupt::new_err(()));
    }
    PyArray1::from_vec(py, found.map_err(raise)?).reshape([rows.len(), COMPONENTS, count])
}

/// A shift of inputs from its row.
fn shift(row: &[f64; 9]) -> Shift {
    let [_, time, right, left, right_rate, left_rate, x, y, moment] = *row;
    Shift { time, target: [right, left], acceleration: [right_rate, left_rate], force: [x, y, moment] }
}
