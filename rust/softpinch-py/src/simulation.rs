//! One run across the border to Python, and the options of runs.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use softpinch::driver::{Outline, outline, simulate};
use softpinch::error::lookup;
use softpinch::formulation::FORMULATIONS;
use softpinch::method::METHODS;
use softpinch::model::{CONTACT_MODELS, Scene, Stabilization};
use softpinch::number::Level;
use softpinch::stepping::{Options, RECORDABLE, SUMMARIES, Steps, VIOLATIONS, Wanted};

use crate::convert::{self, GivenRow, GivenState, Physics, dictionary, entries, raise, select};
use crate::inputs::Inputs;
use crate::signals::detached;

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
        let set = select("summaries", summaries, &SUMMARIES)?;
        Ok(Options {
            steps,
            every: u64::MAX,
            method: lookup("method", &self.method, &METHODS).map_err(raise)?,
            formulation: lookup("formulation", &self.formulation, &FORMULATIONS).map_err(raise)?,
            contact: lookup("contact", contact, &CONTACT_MODELS).map_err(raise)?,
            stabilization: Stabilization { alpha: self.alpha, beta: self.beta },
            record: [].into_iter().collect(),
            stop_on: select("stop_on", &self.stop_on, &VIOLATIONS)?,
            summaries: Wanted { set, after: self.after, band },
            max_steps: self.max_steps,
            simd: Level::from_environment().map_err(raise)?,
            ..Options::default()
        })
    }
}

/// The description of one run.
#[pyclass(frozen, module = "softpinch._core")]
pub struct Simulation {
    pub scene: Scene,
    pub options: Options,
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (parameters, inputs, initial, *, contact, duration, times, every, refine, record, summaries, options))]
    fn new(
        parameters: Physics,
        inputs: &Inputs,
        initial: GivenState,
        contact: &str,
        duration: f64,
        times: Option<GivenRow<'_>>,
        every: u64,
        refine: u32,
        record: Vec<String>,
        summaries: Vec<String>,
        options: GivenOptions,
    ) -> PyResult<Self> {
        let (check, initial) = (initial.check, initial.state(&parameters.0));
        let inputs = inputs.of(0, initial.origin()).map_err(raise)?;
        let scene = Scene { parameters: parameters.0, inputs, initial, check, duration };
        let times = times.map(|times| entries("times, in numbers,", &times)).transpose()?;
        let record = select("record", &record, &RECORDABLE)?;
        let base = options.checked(contact, &summaries, 0.0)?;
        let options = Options { every, times, refine, record, ..base };
        Ok(Self { scene, options })
    }

    /// Simulates the run. After Ctrl-C it returns the run so far; any other exception of a signal handler is raised.
    fn run<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let result = detached(py, |stops| simulate(&self.scene, &self.options, stops))?;
        let (run, warning) = result.map_err(raise)?;
        let out = convert::run(py, run, warning)?;
        out.set_item("step_to_stable_one", self.options.step_to_stable_one(&self.scene))?;
        Ok(out)
    }

    /// The numbers of segments, steps and bytes of the run, without computing it.
    fn outline<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let outline = py.detach(|| outline(&self.scene, &self.options));
        let Outline { segments, steps, bytes } = outline.map_err(raise)?;
        Ok(dictionary!(py, { "segments": segments, "steps": steps, "bytes": bytes }))
    }
}
