//! Signals while the interpreter's lock is released: whoever computes without it has to look at them now and then.

use std::cell::RefCell;
use std::time::{Duration, Instant};

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

/// How long a computation may go on without a look at signals.
const INTERVAL: Duration = Duration::from_millis(50);

/// Looks at signals every [`INTERVAL`], however often it is asked.
pub struct Signals(Instant);

impl Signals {
    /// The first look comes after an interval.
    pub fn new() -> Self {
        Self(Instant::now())
    }

    /// Gives what a handler raises.
    pub fn check(&mut self) -> PyResult<()> {
        if self.0.elapsed() < INTERVAL {
            return Ok(());
        }
        self.0 = Instant::now();
        Python::attach(|py| py.check_signals())
    }
}

/// What Python has raised while a run asked whether to stop.
#[derive(Default)]
pub struct Failure(RefCell<Option<PyErr>>);

impl Failure {
    /// Asks Python whether to stop; an exception is kept, and stops, too.
    pub fn stops(&self, ask: impl FnOnce(Python<'_>) -> PyResult<bool>) -> bool {
        Python::attach(ask).unwrap_or_else(|error| {
            self.0.replace(Some(error));
            true
        })
    }

    /// Whether it was Ctrl-C, which ends a run with a status. Any other exception goes on to the caller.
    pub fn interrupted(self, py: Python<'_>) -> PyResult<bool> {
        match self.0.into_inner() {
            Some(error) if !error.is_instance_of::<PyKeyboardInterrupt>(py) => Err(error),
            other => Ok(other.is_some()),
        }
    }
}
