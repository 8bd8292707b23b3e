//! Ensembles across the border to Python.

use std::collections::HashMap;

use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::convert::{
    GivenRow, GivenRows, GivenState, collected, columns, dictionary, entries, fixed, raise, require, rows,
};
use crate::inputs::Inputs;
use crate::signals::{Failure, Signals};
use crate::simulation::GivenOptions;
use softpinch::driver::{Row, check as check_scene, ensemble, stability_warning};
use softpinch::error::{Error, lookup};
use softpinch::model::start;
use softpinch::model::{
    Coordinates, Fingers, Motion, PARAMETER_COUNT, Parameters, Scene, State, parameter_table, relaxed,
};
use softpinch::stepping::{Options, SUMMARIES, Status, VIOLATIONS, arrival};

/// Makes the coordinates of a start from the parameters.
type MakeStart = fn(&Parameters) -> Result<Coordinates, Error>;

/// The starts that follow from the parameters.
pub const STARTS: [(&str, MakeStart); 3] =
    [("contact", start::contact), ("apart", start::apart), ("touching", start::touching)];

enum Start {
    /// One that follows from the parameters, and whether driven fingers begin where the schedule has them instead.
    Made(MakeStart, bool),
    /// That of each run, or of all runs.
    At(Vec<State>),
}

/// The entry of a run, or the entry that all runs share.
fn own<T>(values: &[T], run: usize) -> &T {
    &values[if values.len() == 1 { 0 } else { run }]
}

/// The checked runs of one block.
#[pyclass(frozen, module = "softpinch._core")]
pub struct Batch {
    parameters: [f64; PARAMETER_COUNT],
    columns: Vec<(usize, Vec<f64>)>,
    inputs: Py<Inputs>,
    start: Start,
    check: bool,
    /// Whether Maxwell branches have relaxed at the start.
    relaxes: bool,
    duration: Vec<f64>,
    pub runs: usize,
    pub options: Options,
    /// Advice for steps that are too long for the gains of the stabilisation, in any run.
    #[pyo3(get)]
    warning: Option<String>,
    least_stable: (f64, usize),
}

impl Batch {
    pub fn scene(&self, run: usize) -> Result<Scene, Error> {
        let mut values = self.parameters;
        for (slot, column) in &self.columns {
            values[*slot] = column[run];
        }
        let checked = self.options.checked;
        let parameters =
            if checked { Parameters::unchecked(&values) } else { Parameters::from_array(&values)? };
        let origin = match &self.start {
            Start::At(states) => own(states, run).origin(),
            Start::Made(..) => 0.0,
        };
        let inputs = self.inputs.get().of(run, origin)?;
        let mut initial = match &self.start {
            Start::Made(_, true) if inputs.fingers == Fingers::Driven => {
                start::driven(&parameters, &inputs, 0.0, self.options.contact)?
            }
            Start::Made(make, _) => State::at_rest(make(&parameters)?),
            Start::At(states) => own(states, run).clone(),
        };
        if self.relaxes {
            initial.motion.relaxation = relaxed(&parameters, &initial.motion.q);
        }
        let duration = *own(&self.duration, run);
        Ok(Scene { parameters, inputs, initial, check: self.check, duration })
    }
}

#[pymethods]
impl Batch {
    #[new]
    #[pyo3(signature = (parameters, columns, inputs, *, runs, start, initial, time, q, p, integral, contact, duration, summaries, band, options))]
    fn new(
        py: Python<'_>,
        parameters: GivenRow<'_>,
        columns: Vec<(usize, GivenRow<'_>)>,
        inputs: Py<Inputs>,
        runs: usize,
        start: &str,
        initial: GivenState,
        time: GivenRow<'_>,
        q: GivenRows<'_>,
        p: GivenRows<'_>,
        integral: GivenRows<'_>,
        contact: &str,
        duration: GivenRow<'_>,
        summaries: Vec<String>,
        band: f64,
        options: GivenOptions,
    ) -> PyResult<Self> {
        let length = |name: &str, length: usize| {
            require(length == 1 || length == runs, || {
                format!("{name} has {length} entries: must have one for each of {runs} runs")
            })
        };
        let columns: Vec<_> = columns
            .iter()
            .map(|(slot, column)| Ok((*slot, entries("a column of parameters", column)?)))
            .collect::<PyResult<_>>()?;
        for (slot, column) in &columns {
            let table = parameter_table();
            let Some((path, _)) = table.get(*slot) else {
                return Err(PyValueError::new_err(format!("there is no parameter {slot}")));
            };
            if column.len() != runs {
                length(path, 0)?;
            }
        }
        let (check, relaxes) = (initial.check, initial.relaxation.is_none());
        let initial = initial.state(&Parameters::default());
        let start = match lookup("start", start, &STARTS) {
            Ok(make) => Start::Made(make, start != "touching"),
            Err(_) => {
                let (q, p) = (self::columns("initial.q", &q)?, self::columns("initial.p", &p)?);
                let memory = self::columns("initial.integral", &integral)?;
                let time = entries("initial.time", &time)?;
                let lengths = [
                    ("initial.q", q.len()),
                    ("initial.p", p.len()),
                    ("initial.integral", memory.len()),
                    ("initial.time", time.len()),
                ];
                lengths.iter().try_for_each(|&(name, found)| length(name, found))?;
                let state = |run: usize| State {
                    time: *own(&time, run),
                    motion: Motion {
                        q: (*own(&q, run)).into(),
                        p: (*own(&p, run)).into(),
                        memory: *own(&memory, run),
                        ..initial.motion
                    },
                    ..initial.clone()
                };
                let count = if lengths.iter().all(|&(_, found)| found == 1) { 1 } else { runs };
                Start::At(collected("the initial states", (0..count).map(state))?)
            }
        };
        let duration = entries("duration", &duration)?;
        length("duration", duration.len())?;
        let options = options.checked(contact, &summaries, band)?;
        let parameters = fixed("parameters", &parameters)?;
        let mut batch = Self {
            parameters,
            columns,
            inputs,
            start,
            check,
            relaxes,
            duration,
            runs,
            options,
            warning: None,
            least_stable: (0.0, 0),
        };
        let (longest, least_stable) = py.detach(|| {
            let (mut longest, mut least_stable) = (0.0f64, (0.0, 0));
            let mut signals = Signals::new();
            for run in 0..runs {
                signals.check()?;
                let step = batch.scene(run).and_then(|scene| {
                    let ratio = batch.options.step_to_stable_one(&scene);
                    if ratio > least_stable.0 {
                        least_stable = (ratio, run);
                    }
                    check_scene(&scene, &batch.options)
                });
                longest = longest.max(step.map_err(|error| raise(error.of_run(run)))?);
            }
            PyResult::Ok((longest, least_stable))
        })?;
        batch.warning = stability_warning(&batch.options, longest);
        let guard =
            least_stable.0 > 1.0 && batch.options.guards(&batch.scene(least_stable.1).map_err(raise)?);
        (batch.options.guard, batch.options.checked) = (guard, true);
        batch.least_stable = least_stable;
        Ok(batch)
    }

    /// The run whose step is the longest by the one that is stable by a bound on the rates: this ratio, above 1 if the run
    /// may be unstable, and its place among the runs.
    #[getter]
    fn least_stable(&self) -> (f64, usize) {
        self.least_stable
    }

    /// Simulates all runs. `watch(done)` is called from time to time and stops the runs by returning True.
    /// Ctrl-C stops them too. After a stop the rows are those of the finished runs.
    fn run<'py>(&self, py: Python<'py>, threads: usize, watch: Py<PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let (result, failure) = py.detach(|| {
            let failure = Failure::default();
            let scenes = |run: usize| self.scene(run);
            let mut asked = |done: usize| {
                failure.stops(|py| {
                    py.check_signals()?;
                    watch.call1(py, (done,))?.is_truthy(py)
                })
            };
            let result = ensemble(&scenes, self.runs, &self.options, threads, &mut asked);
            (result, failure)
        });
        let interrupted = failure.interrupted(py)?;
        let rows = result.map_err(raise)?;
        let out = table(py, &rows)?;
        out.set_item("interrupted", interrupted)?;
        Ok(out)
    }
}

fn table<'py>(py: Python<'py>, all: &[Row]) -> PyResult<Bound<'py, PyDict>> {
    let numbers = |of: &dyn Fn(&Row) -> f64| PyArray1::from_iter(py, all.iter().map(of));
    let counts = |of: &dyn Fn(&Row) -> u64| PyArray1::from_iter(py, all.iter().map(of));
    // Runs that reach the same end share one message.
    let mut ends: HashMap<u64, u64> = HashMap::new();
    let mut messages: Vec<String> = Vec::new();
    let mut say = |row: &Row| {
        let new = messages.len() as u64;
        let place = match row.status {
            Status::Completed => *ends.entry(row.t.to_bits()).or_insert(new),
            _ => new,
        };
        if place == new {
            messages.push(match row.status {
                Status::Completed => arrival(row.t),
                _ => row.message.clone(),
            });
        }
        place
    };
    let said: Vec<u64> = all.iter().map(&mut say).collect();
    let state = |row: &Row| -> [f64; 18] {
        let (q, p) = (row.motion.q.row(), row.motion.p.row());
        std::array::from_fn(|k| if k < 9 { q[k] } else { p[k - 9] })
    };
    let violations =
        VIOLATIONS.iter().enumerate().map(|(k, (name, _))| (name, numbers(&|row| row.violations[k])));
    let summaries =
        SUMMARIES.iter().enumerate().map(|(k, (name, _))| (name, numbers(&|row| row.summaries[k])));
    Ok(dictionary!(py, {
        "run": counts(&|row| row.run as u64),
        "status": counts(&|row| row.status as u64),
        "message": PyArray1::from_vec(py, said),
        "messages": messages,
        "t": numbers(&|row| row.t),
        "steps": counts(&|row| row.steps),
        "final_state": rows(py, all.iter().map(state).collect())?,
        "holds": PyArray1::from_iter(py, all.iter().map(|row| row.holds)),
        "violations": violations.into_py_dict(py)?,
        "summaries": summaries.into_py_dict(py)?,
    }))
}
