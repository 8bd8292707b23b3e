//! The border between Python and the core: PyO3 and NumPy conversion, errors, nothing else.

// Python passes every argument by itself.
#![allow(clippy::too_many_arguments)]

mod batch;
mod convert;
mod inputs;
mod linear;
mod rest;
mod sensitivity;
mod signals;
mod simulation;
mod simulator;

use numpy::{Complex64, PyArray1, PyArrayMethods, ToPyArray};
use pyo3::exceptions::{PyImportError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict, PyTuple};

use batch::Batch;
use convert::{
    GivenRow, GivenRows, Numbers, Physics, Row, Rows, columns, computed, dictionary, entries, matrix, raise,
    require, rows,
};
use inputs::Inputs;
use linear::linearize;
use rest::RestScene;
use sensitivity::{Directions, gradients, sensitivities};
use simulation::Simulation;
use simulator::Simulator;
use softpinch::analysis::Terms;
use softpinch::driver::QUANTITIES;
use softpinch::error::lookup;
use softpinch::formulation::FORMULATIONS;
use softpinch::method::METHODS;
use softpinch::model::start;
use softpinch::model::{
    CONTACT_MODELS, CONTACT_MODES, FINGERS, Finger, Fingertip, Friction, Geometry, GraspedObject, Law,
    MEASURES, Maxwell, Mechanism, Noise, Parameters, PidGains, Rule, Side, Stabilization, State,
    Surroundings, parameter_table,
};
use softpinch::number::{LEVELS, Level};
use softpinch::stepping::{MAX_STEPS, RECORDABLE, STATUSES, SUMMARIES, UNITS, VIOLATIONS};

/// The public records and the rules of their fields.
fn records() -> Vec<(&'static str, Vec<(&'static str, Rule)>)> {
    let mut scene = Surroundings::FIELDS.to_vec();
    scene.push(("friction", Friction::FIELDS[0].1));
    scene.push(("duration", Rule::Positive));
    let of = |fields: &[(&'static str, Rule)], names: &[&str]| {
        fields.iter().filter(|(name, _)| names.contains(name)).copied().collect::<Vec<_>>()
    };
    let mut jaw = of(&Finger::FIELDS, &["root_offset", "half_thickness"]);
    jaw.push(("mass", Rule::Positive));
    jaw.extend(of(&Mechanism::FIELDS, &["height", "direction", "angle"]));
    let angle = of(&Mechanism::FIELDS, &["angle"]);
    let joint = of(&Mechanism::FIELDS, &["joint_friction", "creep_rate"]);
    jaw.extend(&joint);
    let link = [Finger::FIELDS.to_vec(), joint].concat();
    vec![
        ("Finger", link.clone()),
        ("Jaw", jaw),
        ("Parallelogram", [link, angle].concat()),
        ("Face", of(&Side::FIELDS, &["tilt", "height"])),
        ("Arc", of(&Side::FIELDS, &["radius", "span"])),
        ("ParallelSprings", of(&Fingertip::FIELDS, &["youngs_modulus"])),
        ("PowerLaw", of(&Law::FIELDS, &["coefficient", "exponent", "foot", "shear_factor"])),
        ("MeasuredLaw", of(&Law::FIELDS, &["shear_factor"])),
        ("Maxwell", Maxwell::FIELDS.to_vec()),
        ("Fingertip", Fingertip::FIELDS.to_vec()),
        ("GraspedObject", GraspedObject::FIELDS.to_vec()),
        ("Pid", PidGains::FIELDS.to_vec()),
        ("GainSwitch", ["at", "above", "below"].map(|name| (name, Rule::Finite)).to_vec()),
        ("Stabilization", Stabilization::FIELDS.to_vec()),
        ("Scene", scene),
    ]
}

#[pyfunction]
fn validate(record: &str, field: &str, value: f64) -> PyResult<()> {
    let rule = records()
        .into_iter()
        .find(|(name, _)| *name == record)
        .and_then(|(_, fields)| fields.into_iter().find(|(name, _)| *name == field))
        .map(|(_, rule)| rule)
        .ok_or_else(|| PyValueError::new_err(format!("{record}.{field}: no such field")))?;
    rule.check(format!("{record}.{field}"), value).map(|_| ()).map_err(raise)
}

#[pyfunction(name = "start")]
fn start_state(parameters: Physics, kind: &str) -> PyResult<Numbers<9>> {
    let begin = lookup("initial", kind, &batch::STARTS).map_err(raise)?;
    begin(&parameters.0).map(|q| Numbers(q.row())).map_err(raise)
}

/// q and p of a start with driven fingers, which are where the schedule has them at `time`.
#[pyfunction]
fn start_driven(
    parameters: Physics,
    inputs: &Inputs,
    time: f64,
    contact: &str,
) -> PyResult<(Numbers<9>, Numbers<9>)> {
    let contact = lookup("contact", contact, &CONTACT_MODELS).map_err(raise)?;
    let inputs = inputs.of(0, 0.0).map_err(raise)?;
    let State { motion, .. } = start::driven(&parameters.0, &inputs, time, contact).map_err(raise)?;
    Ok((Numbers(motion.q.row()), Numbers(motion.p.row())))
}

#[pyfunction]
fn consistent(
    parameters: Physics,
    pose: [f64; 5],
    shear: [f64; 2],
    velocity: [f64; 5],
) -> (Numbers<9>, Numbers<9>) {
    let (q, p) = start::consistent(&parameters.0, &pose, &shear, &velocity);
    (Numbers(q.row()), Numbers(p.row()))
}

#[pyfunction]
fn contacts<'py>(py: Python<'py>, parameters: Physics, q: GivenRows<'py>) -> PyResult<Rows<'py>> {
    let found = |q: [f64; 9]| softpinch::analysis::contacts(&parameters.0, &q.into());
    rows(py, columns::<9>("q", &q)?.into_iter().map(found).collect())
}

#[pyfunction]
fn residuals<'py>(
    py: Python<'py>,
    parameters: Physics,
    q: GivenRows<'py>,
    p: GivenRows<'py>,
) -> PyResult<Rows<'py>> {
    let (q, p) = (columns::<9>("q", &q)?, columns::<9>("p", &p)?);
    require(q.len() == p.len(), || format!("q has {} rows and p has {}: must be equal", q.len(), p.len()))?;
    let residuals = |(q, p): ([f64; 9], [f64; 9])| {
        Geometry::<f64>::of_scene(&parameters.0, &q.into(), &p.into()).residuals()
    };
    rows(py, q.into_iter().zip(p).map(residuals).collect())
}

#[pyfunction]
fn evaluate<'py>(
    py: Python<'py>,
    parameters: Physics,
    inputs: &Inputs,
    t: f64,
    q: [f64; 9],
    p: [f64; 9],
    integral: [f64; 2],
    formulation: &str,
    alpha: f64,
    beta: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let formulation = lookup("formulation", formulation, &FORMULATIONS).map_err(raise)?;
    let motion = convert::motion(&parameters.0, (q, p, integral), &[]);
    let (gains, inputs) =
        (formulation.gains(&Stabilization { alpha, beta }), inputs.of(0, 0.0).map_err(raise)?);
    let found = softpinch::analysis::evaluate(&parameters.0, &inputs, &gains, t, &motion);
    let Terms { mass_matrix, constraint_matrix, vectors, energies } = found.map_err(raise)?;
    let out = dictionary!(py, {
        "mass_matrix": matrix(py, &mass_matrix)?,
        "constraint_matrix": matrix(py, &constraint_matrix)?,
        "kinetic_energy": energies.kinetic,
        "elastic_energy": energies.elastic,
        "gravity_energy": energies.gravity,
    });
    for (name, vector) in vectors {
        out.set_item(name, PyArray1::from_vec(py, vector))?;
    }
    Ok(out)
}

/// For each of these eigenvalues the longest step of a method with which its mode does not grow, (n,), s;
/// infinite if any step will do.
#[pyfunction]
fn stable_step<'py>(py: Python<'py>, method: &str, rates: GivenRow<'py, Complex64>) -> PyResult<Row<'py>> {
    let method = lookup("method", method, &METHODS).map_err(raise)?;
    let rates = entries("the eigenvalues, in numbers,", &rates)?;
    let steps = rates.into_iter().map(|rate| method.longest_stable_step(rate));
    Ok(PyArray1::from_vec(py, computed(py, "the steps, in numbers,", steps)?))
}

/// Samples of held noise, for inspection.
#[pyfunction]
fn noise<'py>(
    py: Python<'py>,
    std: (f64, f64, f64),
    key: (u64, u64),
    stream: u64,
    first: u64,
    count: usize,
) -> PyResult<Rows<'py>> {
    let (seed, run) = key;
    let (std, acceleration, end) = (std.into(), [0.0; 2], f64::INFINITY);
    let noise = Noise { std, acceleration, rate: 1.0, start: 0.0, end, key: [seed, run], stream };
    let samples = (0..count).map(|number| noise.sample(first.saturating_add(number as u64)));
    rows(py, computed(py, "the samples, in numbers,", samples)?)
}

#[pyfunction]
fn simd_level() -> PyResult<&'static str> {
    Level::from_environment().map(Level::name).map_err(raise)
}

/// What Python imports as `softpinch._core`.
#[pymodule]
pub mod _core {
    #[pymodule_export]
    use super::{
        Batch, Directions, Inputs, RestScene, Simulation, Simulator, consistent, contacts, evaluate,
        gradients, linearize, noise, residuals, sensitivities, simd_level, stable_step, start_driven,
        start_state, validate,
    };

    #[pymodule_init]
    fn init(module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
        super::fill(module)
    }
}

/// Checks the processor, and adds the constants of the core.
fn fill(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    Level::detect().require().map_err(|error| PyImportError::new_err(error.to_string()))?;
    // The numpy crate looks up NumPy's functions and its own record of borrows when an array is first made
    // and read. It panics if that fails, as it does when a signal handler raises an exception in the middle
    // of it. The lookup is therefore done here, after Python's own import, which lets such an exception pass
    // through.
    py.import("numpy")?;
    PyArray1::<f64>::zeros(py, 0, false).try_readonly()?;
    let rules = PyDict::new(py);
    for (record, fields) in records() {
        let texts = fields.into_iter().map(|(field, rule)| (field, rule.text()));
        rules.set_item(record, texts.into_py_dict(py)?)?;
    }
    module.add("RULES", rules)?;
    module.add("PARAMETERS", PyTuple::new(py, parameter_table().into_iter().map(|(path, _)| path))?)?;
    module.add("DEFAULTS", Parameters::default().to_array().to_pyarray(py))?;
    module.add("METHODS", PyTuple::new(py, METHODS.map(|(name, _)| name))?)?;
    let adaptive =
        METHODS.into_iter().filter(|(_, method)| method.entry().adaptive.is_some()).map(|(name, _)| name);
    module.add("ADAPTIVE_METHODS", PyTuple::new(py, adaptive.collect::<Vec<_>>())?)?;
    module.add("FORMULATIONS", PyTuple::new(py, FORMULATIONS.map(|(name, _)| name))?)?;
    module.add("FINGERS", PyTuple::new(py, FINGERS.map(|(name, _)| name))?)?;
    module.add("MEASURES", MEASURES.map(|(name, measure)| (name, measure.width())).into_py_dict(py)?)?;
    module.add("CONTACT_MODELS", PyTuple::new(py, CONTACT_MODELS.map(|(name, _)| name))?)?;
    module.add("CONTACT_MODES", CONTACT_MODES.into_py_dict(py)?)?;
    module.add("RECORDABLE", PyTuple::new(py, RECORDABLE.map(|(name, _)| name))?)?;
    module.add("SIMD_LEVELS", PyTuple::new(py, LEVELS.map(|(name, _)| name))?)?;
    module.add("STATUSES", PyTuple::new(py, STATUSES.map(|(name, _)| name))?)?;
    module.add(
        "SUMMARIES",
        SUMMARIES.into_iter().zip(UNITS).map(|((name, _), unit)| (name, unit)).into_py_dict(py)?,
    )?;
    module.add("SENSITIVITIES", QUANTITIES.into_py_dict(py)?)?;
    let differentiable = SUMMARIES.into_iter().filter(|(_, summary)| summary.is_differentiable());
    module.add("GRADIENTS", PyTuple::new(py, differentiable.map(|(name, _)| name).collect::<Vec<_>>())?)?;
    module.add("VIOLATIONS", PyTuple::new(py, VIOLATIONS.map(|(name, _)| name))?)?;
    module.add("MAX_STEPS", MAX_STEPS)?;
    module.add("ORDERS", METHODS.map(|(name, method)| (name, method.entry().order)).into_py_dict(py)?)?;
    module.add("RESULTS_VERSION", softpinch::RESULTS_VERSION)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    Ok(())
}
