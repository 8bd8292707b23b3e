//! The derivatives of runs across the border to Python.

use numpy::{Ix3, PyArray, PyArray1, PyArrayMethods};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

use crate::batch::Batch;
use crate::convert::{GivenRow, GivenRows, columns, entries, raise, require, room, select};
use crate::inputs::Inputs;
use crate::signals::detached;
use crate::simulation::Simulation;
use softpinch::driver::{
    COMPONENTS, Derivatives, Direction, DirectionEnd, Request, Shift, derivatives, sensitivities as core,
};
use softpinch::error::lookup;
use softpinch::model::{NUMBERS, PARAMETER_COUNT, STARTS, Start};
use softpinch::stepping::{Options, SUMMARIES, Summary};

/// Derivatives with three axes.
type Numbers<'py> = Bound<'py, PyArray<f64, Ix3>>;

/// Directions in which runs are differentiated. The rows of `parameters` (d, p), `initial` (d, 28) and `impulse_times`
/// (d, impulses) and the runs of `inputs` are the directions. `shifts` (m, 11) has the direction, the time, and the shifts of
/// the targets (2), of their accelerations (2), of the forces (3) and of the hand's acceleration (2). `start` says what
/// the start follows from; None if it is given.
#[pyclass(frozen, module = "softpinch._core")]
pub struct Directions {
    directions: Vec<Direction>,
    start: Option<Start>,
}

#[pymethods]
impl Directions {
    #[new]
    #[pyo3(signature = (parameters, inputs, *, initial, shifts, impulse_times, start))]
    fn new(
        parameters: GivenRows<'_>,
        inputs: &Inputs,
        initial: GivenRows<'_>,
        shifts: GivenRows<'_>,
        impulse_times: GivenRows<'_>,
        start: Option<&str>,
    ) -> PyResult<Self> {
        let parameters = columns::<PARAMETER_COUNT>("parameters", &parameters)?;
        let initial = columns::<NUMBERS>("initial", &initial)?;
        let shifts = columns::<11>("shifts", &shifts)?;
        let impulse_times = impulse_times.as_array();
        let count = parameters.len();
        require(initial.len() == count && impulse_times.nrows() == count, || {
            "parameters, initial and impulse_times: must have equal lengths".to_owned()
        })?;
        let mut directions = room("the directions", count)?;
        for (k, (&parameters, initial)) in parameters.iter().zip(&initial).enumerate() {
            let own = shifts.iter().filter(|row| row[0] == k as f64);
            directions.push(Direction {
                parameters,
                inputs: inputs.of(k, 0.0).map_err(raise)?,
                initial: (*initial).into(),
                shifts: own.map(shift).collect(),
                impulse_times: impulse_times.row(k).to_vec(),
            });
        }
        let start = start.map(|name| lookup("start", name, &STARTS)).transpose().map_err(raise)?;
        Ok(Self { directions, start })
    }
}

fn shift(row: &[f64; 11]) -> Shift {
    let [_, time, by @ ..] = *row;
    Shift { time, by }
}

/// The derivatives of a run at the times `rows`, (directions, rows, components); `SENSITIVITIES` has the components.
/// With them comes for each direction where they end before the run, in words, or None; from there on they are NaN. And those
/// of the times of the contacts' changes until then. Without rows the run is only checked. Ctrl-C is raised.
#[pyfunction]
pub fn sensitivities<'py>(
    py: Python<'py>,
    simulation: &Simulation,
    directions: &Directions,
    rows: GivenRow<'py>,
) -> PyResult<(Numbers<'py>, Vec<DirectionEnd>)> {
    let rows = &entries("rows, in numbers,", &rows)?[..];
    let Simulation { scene, options } = simulation;
    let Directions { directions, start } = directions;
    let found = detached(py, |interrupted| {
        core(Request { scene, options, start: *start, directions, rows, summaries: &[], interrupted })
    })?;
    let found = found.map_err(raise)?.ok_or_else(|| PyKeyboardInterrupt::new_err(()))?;
    let numbers = PyArray1::from_vec(py, found.numbers);
    Ok((numbers.reshape([directions.len(), rows.len(), COMPONENTS])?, found.ends))
}

/// The derivatives of the last states and of the summaries of the runs of a batch, (runs, directions, 18 + summaries).
/// `directions` are those of all runs, or of each run. `until` has the times of the runs' last instants. With the
/// derivatives come the runs that could not be followed, whose derivatives are NaN, with the reasons. Ctrl-C is raised.
#[pyfunction]
pub fn gradients<'py>(
    py: Python<'py>,
    batch: &Batch,
    directions: Vec<Py<Directions>>,
    until: GivenRow<'py>,
    summaries: Vec<String>,
    threads: usize,
) -> PyResult<(Numbers<'py>, Vec<(usize, String)>)> {
    let until = entries("until, in numbers,", &until)?;
    let &Batch { runs, ref options, .. } = batch;
    let options = &Options { guard: false, ..options.clone() }; // The runs have been guarded.
    require(until.len() == runs, || "until: must have one time for each run".to_owned())?;
    let summaries: Vec<Summary> = select("gradients", &summaries, &SUMMARIES)?;
    let own: Vec<&Directions> = directions.iter().map(Py::get).collect();
    let count = own.first().map_or(0, |one| one.directions.len());
    let fits = own.len() == 1 || own.len() == runs;
    require(fits && own.iter().all(|one| one.directions.len() == count), || {
        "directions: must be those of all runs, or equally many of each run".to_owned()
    })?;
    let width = count * (18 + summaries.len());
    let one = |run: usize, interrupted: &dyn Fn() -> bool| {
        let Directions { directions, start } = own[if own.len() == 1 { 0 } else { run }];
        let (scene, rows, summaries) = (&batch.scene(run)?, &until[run..=run], &summaries[..]);
        core(Request { scene, options, start: *start, directions, rows, summaries, interrupted })
    };
    let found = detached(py, |stops| derivatives(runs, threads, one, &mut || stops()))?
        .map_err(raise)?
        .ok_or_else(|| PyKeyboardInterrupt::new_err(()))?;
    let mut numbers = room("the gradients, in numbers,", runs * width)?;
    let mut failed = Vec::new();
    for (run, Derivatives { numbers: end, summaries: own, ends }) in found.into_iter().enumerate() {
        for k in 0..count {
            numbers.extend(&end[k * COMPONENTS..][..18]);
            numbers.extend(&own[k * summaries.len()..][..summaries.len()]);
        }
        failed.extend(ends.into_iter().find_map(|(why, _)| why).map(|why| (run, why)));
    }
    let numbers = PyArray1::from_vec(py, numbers).reshape([runs, count, 18 + summaries.len()])?;
    Ok((numbers, failed))
}
