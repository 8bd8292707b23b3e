//! Signals while the interpreter's lock is released: a computation without the lock has to check for them
//! from time to time.

use std::cell::RefCell;
use std::time::{Duration, Instant};

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

/// Longest time that a computation goes on without checking for signals.
const INTERVAL: Duration = Duration::from_millis(50);

/// Checks for signals once in every [`INTERVAL`], however often it is asked.
pub struct Signals(Instant);

impl Signals {
    /// The first check comes after one interval.
    pub fn new() -> Self {
        Self(Instant::now())
    }

    /// Checks for signals if it is time to. The error is the exception that a signal handler raised.
    pub fn check(&mut self) -> PyResult<()> {
        if self.0.elapsed() < INTERVAL {
            return Ok(());
        }
        self.0 = Instant::now();
        Python::attach(|py| py.check_signals())
    }
}

/// The exception that Python raised while a run asked whether to stop.
#[derive(Default)]
pub struct Failure(RefCell<Option<PyErr>>);

impl Failure {
    /// Asks Python whether to stop. An exception is kept, and it stops the run too.
    pub fn stops(&self, ask: impl FnOnce(Python<'_>) -> PyResult<bool>) -> bool {
        Python::attach(ask).unwrap_or_else(|error| {
            self.0.replace(Some(error));
            true
        })
    }

    /// Whether Ctrl-C was pressed, which ends a run with a status. Any other exception is passed on to the caller.
    pub fn interrupted(self, py: Python<'_>) -> PyResult<bool> {
        match self.0.into_inner() {
            Some(error) if !error.is_instance_of::<PyKeyboardInterrupt>(py) => Err(error),
            other => Ok(other.is_some()),
        }
    }
}

/// Computes without the interpreter's lock. `compute` gets a function that checks for signals and says whether to stop.
/// After Ctrl-C it stops, and returns the result; any other exception of a signal handler is raised.
pub fn detached<T: Send>(py: Python<'_>, compute: impl FnOnce(&dyn Fn() -> bool) -> T + Send) -> PyResult<T> {
    let (result, failure) = py.detach(|| {
        let failure = Failure::default();
        (compute(&|| failure.stops(|py| py.check_signals().map(|()| false))), failure)
    });
    failure.interrupted(py).map(|_| result)
}
