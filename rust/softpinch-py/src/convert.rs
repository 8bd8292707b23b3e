//! Arrays, names and results across the border to Python. Every shape is checked here.

use std::convert::Infallible;

use numpy::ndarray::{ArrayView1, Dimension};
use numpy::{
    Element, PyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict, PyString};

use crate::signals::Signals;
use softpinch::analysis::Matrix;
use softpinch::error::{Error, lookup};
use softpinch::model::{ContactRow, Motion, Parameters, SIDES, State, relaxed};
use softpinch::stepping::{COLUMNS, Change, Column, Run, reserved};

pub type GivenRow<'py, T = f64> = PyReadonlyArray1<'py, T>;
pub type GivenRows<'py> = PyReadonlyArray2<'py, f64>;
pub type Row<'py, T = f64> = Bound<'py, PyArray1<T>>;
pub type Rows<'py, T = f64> = Bound<'py, PyArray2<T>>;

/// The core's errors mean bad input, so they become `ValueError`.
pub fn raise(error: Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Refuses what does not hold.
pub fn require(holds: bool, message: impl FnOnce() -> String) -> PyResult<()> {
    if holds { Ok(()) } else { Err(PyValueError::new_err(message())) }
}

/// An empty vector with room for `entries`, a number that a user chooses. Errors call the entries `what`.
pub fn room<T>(what: &'static str, entries: usize) -> PyResult<Vec<T>> {
    reserved(what, entries).map_err(raise)
}

pub fn collected<T>(what: &'static str, entries: impl ExactSizeIterator<Item = T>) -> PyResult<Vec<T>> {
    let mut vector = room(what, entries.len())?;
    vector.extend(entries);
    Ok(vector)
}

/// Collects entries that are computed one by one, without the interpreter's lock.
pub fn computed<T: Send>(
    py: Python<'_>,
    what: &'static str,
    entries: impl ExactSizeIterator<Item = T> + Send,
) -> PyResult<Vec<T>> {
    py.detach(|| {
        let mut vector = room(what, entries.len())?;
        let mut signals = Signals::new();
        for entry in entries {
            vector.push(entry);
            signals.check()?;
        }
        Ok(vector)
    })
}

/// Copies a user's array into a vector.
pub fn entries<T: Element + Copy>(name: &'static str, array: &GivenRow<'_, T>) -> PyResult<Vec<T>> {
    collected(name, array.as_array().iter().copied())
}

/// A few numbers for Python, which become an array there.
pub struct Numbers<const N: usize>(pub [f64; N]);

impl<'py, const N: usize> IntoPyObject<'py> for Numbers<N> {
    type Target = PyArray1<f64>;
    type Output = Row<'py>;
    type Error = Infallible;

    fn into_pyobject(self, py: Python<'py>) -> Result<Row<'py>, Infallible> {
        Ok(self.0.to_pyarray(py))
    }
}

/// The parameters of a scene, once they are checked.
pub struct Physics(pub Parameters);

impl<'py> FromPyObject<'_, 'py> for Physics {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Parameters::from_array(&fixed("parameters", &given.extract()?)?).map(Self).map_err(raise)
    }
}

/// A `State` of Python, by its attributes.
#[derive(FromPyObject)]
pub struct GivenState {
    q: [f64; 9],
    p: [f64; 9],
    integral: [f64; 2],
    time: f64,
    /// Whether it is refused if it is off the constraints.
    pub check: bool,
    grid: Option<(f64, u64)>,
    linearized: Option<Vec<f64>>,
    contact: Option<ContactRow>,
    controller: Option<Vec<f64>>,
    /// The states of Maxwell branches. If there are none, these have relaxed.
    pub relaxation: Option<Vec<f64>>,
}

impl GivenState {
    pub fn state(self, parameters: &Parameters) -> State {
        let Self { q, p, integral, time, grid, linearized, contact, controller, relaxation, .. } = self;
        let motion = motion(parameters, (q, p, integral), &relaxation.unwrap_or_default());
        let linearized = linearized.map(|point| filled([0.0; _], &point));
        State { time, motion, grid, linearized, contact, controller }
    }
}

/// The numbers with the first of them replaced.
fn filled<const N: usize>(mut numbers: [f64; N], first: &[f64]) -> [f64; N] {
    numbers.iter_mut().zip(first).for_each(|(number, first)| *number = *first);
    numbers
}

/// A motion in which Maxwell branches have these states, or have relaxed if there are none.
pub fn motion(
    parameters: &Parameters,
    (q, p, memory): ([f64; 9], [f64; 9], [f64; 2]),
    branches: &[f64],
) -> Motion<f64> {
    let q = q.into();
    Motion { q, p: p.into(), memory, relaxation: filled(relaxed(parameters, &q), branches) }
}

pub fn fixed<const N: usize>(name: &str, values: &GivenRow<'_>) -> PyResult<[f64; N]> {
    let values = values.as_array();
    require(values.len() == N, || format!("{name} has {} numbers: must have {N}", values.len()))?;
    Ok(std::array::from_fn(|k| values[k]))
}

pub fn columns<const N: usize>(name: &str, values: &GivenRows<'_>) -> PyResult<Vec<[f64; N]>> {
    let values = values.as_array();
    require(values.ncols() == N, || format!("{name} has {} columns: must have {N}", values.ncols()))?;
    let array = |row: ArrayView1<'_, f64>| std::array::from_fn(|k| row[k]);
    collected("the rows of an array, in numbers,", values.rows().into_iter().map(array))
}

pub fn rows<T: Element, const N: usize>(py: Python<'_>, values: Vec<[T; N]>) -> PyResult<Rows<'_, T>> {
    let count = values.len();
    PyArray1::from_vec(py, values.into_flattened()).reshape([count, N])
}

/// A NumPy matrix with the entries of an nalgebra matrix.
pub fn matrix<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    value: &Matrix<R, C>,
) -> PyResult<Rows<'py>> {
    rows(py, (0..R).map(|r| std::array::from_fn(|c| value[(r, c)])).collect::<Vec<[f64; C]>>())
}

/// Looks up each of the names that a user gave for an option in a table.
pub fn select<T: Copy, S: FromIterator<T>>(
    field: &'static str,
    names: &[String],
    table: &[(&'static str, T)],
) -> PyResult<S> {
    names.iter().map(|name| lookup(field, name, table)).collect::<Result<S, Error>>().map_err(raise)
}

/// Makes the array of a result read-only.
fn constant<'py, T: Element, D: Dimension>(
    array: Bound<'py, PyArray<T, D>>,
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    drop(array.try_readwrite()?.make_nonwriteable());
    Ok(array)
}

/// Makes a dictionary whose keys are made only once. Making them all takes more time than a short run.
macro_rules! dictionary {
    ($py:expr, { $($name:literal: $value:expr),+ $(,)? }) => {{
        let out = PyDict::new($py);
        $(out.set_item(pyo3::intern!($py, $name), $value)?;)+
        out
    }};
}
pub(crate) use dictionary;

pub fn run(py: Python<'_>, run: Run, warning: Option<String>) -> PyResult<Bound<'_, PyDict>> {
    let violations = run.violations().into_py_dict(py)?;
    let recording = run.recording;
    let last = dictionary!(py, {
        "t": run.last.t,
        "q": run.last.motion.q.row().to_pyarray(py),
        "p": run.last.motion.p.row().to_pyarray(py),
        "integral": run.last.motion.memory.to_pyarray(py),
        "anchor": run.last.grid.0,
        "step": run.last.grid.1,
        "relaxation": run.last.motion.relaxation[..run.branches].to_pyarray(py),
        "linearized": run.last.linearized.map(|point| point[..21 + run.branches].to_pyarray(py)),
        "contacts": run.last.contact.map(|row| row.to_pyarray(py)),
        "controller": run.controller.map(|row| PyArray1::from_vec(py, row)),
    });
    let intervals = PyDict::new(py);
    for (name, times) in run.violation_intervals {
        intervals.set_item(name, rows(py, times).and_then(constant)?)?;
    }
    let changes: Vec<_> = run
        .contact_changes
        .iter()
        .map(|change| {
            let Change { time, finger, before, after, cause } = change;
            (*time, SIDES[*finger], before.code(), after.code(), cause.name())
        })
        .collect();
    let out = dictionary!(py, {
        "contact_changes": changes,
        "final": last,
        "begun": run.initial_energies.map(|energies| (energies.kinetic, energies.elastic, energies.gravity)),
        "status": run.status.name(),
        "message": run.message,
        "violations": violations,
        "violation_intervals": intervals,
        "holds": run.holds,
        "stats": run.stats.named().into_py_dict(py)?,
        "warnings": warning.into_iter().collect::<Vec<_>>(),
    });
    let columns = COLUMNS.into_iter().zip(recording.widths).zip(recording.columns);
    for (((name, column), width), numbers) in columns {
        out.set_item(PyString::intern(py, name), recorded(py, column, width, numbers)?)?;
    }
    Ok(out)
}

/// The rows of a column from all of its numbers; `None` if it was not recorded.
fn recorded(
    py: Python<'_>,
    column: Column,
    width: usize,
    numbers: Vec<f64>,
) -> PyResult<Option<Bound<'_, PyAny>>> {
    fn array<T: Element>(py: Python<'_>, width: usize, numbers: Vec<T>) -> PyResult<Bound<'_, PyAny>> {
        let shape = [numbers.len() / width, width];
        let all = PyArray1::from_vec(py, numbers);
        Ok(if width == 1 { constant(all)?.into_any() } else { constant(all.reshape(shape)?)?.into_any() })
    }
    let found = match column {
        _ if width == 0 => return Ok(None),
        Column::GridStep => array(py, width, numbers.into_iter().map(|steps| steps as u64).collect()),
        Column::Modes => array(py, width, numbers.into_iter().map(|mode| mode as u8).collect()),
        _ => array(py, width, numbers),
    };
    found.map(Some)
}
