//! The options of runs across the border to Python.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{raise, select};
use softpinch::error::lookup;
use softpinch::formulation::table::FORMULATIONS;
use softpinch::method::table::METHODS;
use softpinch::model::contact_modes::CONTACT_MODELS;
use softpinch::model::parameters::Stabilization;
use softpinch::number::simd::level::Level;
use softpinch::stepping::monitor::VIOLATIONS;
use softpinch::stepping::options::{Options, Steps};
use softpinch::stepping::record::Selection;
use softpinch::stepping::summary::{SUMMARIES, Wanted};

/// The options that a run and the runs of a batch share, as Python gives them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct GivenOptions {
    dt: Option<f64>,
    tolerance: Option<f64>,
    max_steps: u64,
    method: String,
    formulation: String,
    alpha: f64,
    beta: f64,
    after: f64,
    stop_on: Vec<String>,
}

impl GivenOptions {
    /// The options of runs with this kind of contact and these summaries, of which nothing is recorded.
    pub fn checked(&self, contact: &str, summaries: &[String], band: f64) -> PyResult<Options> {
        let steps = match (self.dt, self.tolerance) {
            (Some(dt), None) => Steps::Fixed(dt),
            (None, Some(tolerance)) => Steps::Free { tolerance },
            _ => return Err(PyValueError::new_err("give dt or tolerance")),
        };
        let summaries: Vec<_> = select("summaries", summaries, &SUMMARIES)?;
        Ok(Options {
            steps,
            every: u64::MAX,
            method: lookup("method", &self.method, &METHODS).map_err(raise)?,
            formulation: lookup("formulation", &self.formulation, &FORMULATIONS).map_err(raise)?,
            contact: lookup("contact", contact, &CONTACT_MODELS).map_err(raise)?,
            stabilization: Stabilization { alpha: self.alpha, beta: self.beta },
            record: Selection::default(),
            stop_on: select("stop_on", &self.stop_on, &VIOLATIONS)?,
            summaries: Wanted::new(summaries, self.after, band),
            max_steps: self.max_steps,
            simd: Level::from_environment().map_err(raise)?,
            ..Options::default()
        })
    }
}
