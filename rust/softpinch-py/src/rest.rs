//! Equilibria across the border to Python.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{columns, dictionary, fixed, matrix, raise, room, rows};
use crate::inputs::Inputs;
use crate::signals::Signals;
use softpinch::analysis::balance::{Member, RestScene as CoreRestScene, Unknowns};
use softpinch::analysis::equilibrium::{Equilibrium, continued, find};
use softpinch::analysis::reason::Reason;
use softpinch::analysis::rest::Rest;
use softpinch::analysis::wrench::largest_multiple;
use softpinch::error::lookup;
use softpinch::model::rule::Rule;
use softpinch::number::simd::level::Level;
use softpinch::stepping::monitor::VIOLATIONS;

/// The kinds of members of the family of equilibria.
#[derive(Clone, Copy)]
enum Kind {
    Grip,
    Shear,
    From,
}

const KINDS: [(&str, Kind); 3] = [("grip", Kind::Grip), ("shear", Kind::Shear), ("from", Kind::From)];

/// Multiples, names of limits and coordinates.
type WrenchLimits<'py> = (Bound<'py, PyArray1<f64>>, Vec<&'static str>, Bound<'py, PyArray2<f64>>);

/// A scene at rest under the inputs of one instant.
#[pyclass(frozen, module = "softpinch._core")]
pub struct RestScene {
    scene: CoreRestScene,
}

/// The unknowns of a row of coordinates.
fn unknowns(q: &[f64; 9]) -> Unknowns {
    let [x, y, theta, right, left, _, _, shear1, shear2] = *q;
    [x, y, theta, right, left, shear1, shear2]
}

impl RestScene {
    /// The member that a kind and its numbers mean: two numbers, or the coordinates from which it comes.
    fn member(&self, kind: &str, values: &PyReadonlyArray1<'_, f64>) -> PyResult<Member> {
        Ok(match lookup("member", kind, &KINDS).map_err(raise)? {
            Kind::Grip => Member::Grip(fixed("grip", values)?),
            Kind::Shear => Member::Shear(fixed("shear", values)?),
            Kind::From => Member::From(self.scene.origin(&unknowns(&fixed("near", values)?))),
        })
    }

    /// The result as a dictionary; without an equilibrium it has only status and message.
    fn result<'py>(&self, py: Python<'py>, found: Result<Rest, Reason>) -> PyResult<Bound<'py, PyDict>> {
        let rest = match found {
            Ok(rest) => rest,
            Err(reason) => {
                return Ok(dictionary!(py, { "status": reason.name(), "message": reason.to_string() }));
            }
        };
        let equilibrium = Equilibrium::new(&self.scene, &rest);
        let names =
            VIOLATIONS.into_iter().filter(|&(_, violation)| equilibrium.violations.contains(violation));
        Ok(dictionary!(py, {
            "status": "at_rest",
            "q": equilibrium.q.row().to_pyarray(py),
            "integral": PyArray1::from_slice(py, &equilibrium.memory),
            "torque": PyArray1::from_slice(py, &equilibrium.torque),
            "multipliers": PyArray1::from_slice(py, &equilibrium.multipliers),
            "stiffness": matrix(py, &equilibrium.stiffness)?,
            "neutral": rows(py, equilibrium.neutral.map(|slope| slope.row()).to_vec())?,
            "grip": PyArray1::from_slice(py, &equilibrium.grip),
            "elastic": equilibrium.energies.elastic,
            "gravity": equilibrium.energies.gravity,
            "minimum": equilibrium.minimum,
            "violations": names.map(|(name, _)| name).collect::<Vec<_>>(),
        }))
    }
}

#[pymethods]
impl RestScene {
    #[new]
    fn new(parameters: PyReadonlyArray1<'_, f64>, inputs: &Inputs, time: f64) -> PyResult<Self> {
        Rule::Finite.check("time", time).map_err(raise)?;
        let parameters = crate::parameters(&parameters)?;
        let inputs = inputs.of(0, 0.0).map_err(raise)?.frozen(time);
        let level = Level::from_environment().map_err(raise)?;
        let input = inputs.segment(time).at(0.0);
        let scene = CoreRestScene::new(level, &parameters, inputs.fingers(), input).map_err(raise)?;
        Ok(Self { scene })
    }

    /// The equilibrium of a member of the family, near the coordinates `start` if they are given.
    #[pyo3(signature = (kind, values, start=None))]
    fn equilibrium<'py>(
        &self,
        py: Python<'py>,
        kind: &str,
        values: PyReadonlyArray1<'py, f64>,
        start: Option<PyReadonlyArray1<'py, f64>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let member = self.member(kind, &values)?;
        let start = start.map(|q| fixed("near", &q)).transpose()?.map(|q| unknowns(&q));
        self.result(py, find(&self.scene, &member, start.as_ref()))
    }

    /// The equilibrium that continues that of another scene, near its coordinates `start`, while that scene becomes
    /// this one. `values` and `values_before` are those of the members.
    fn continued<'py>(
        &self,
        py: Python<'py>,
        kind: &str,
        values: PyReadonlyArray1<'py, f64>,
        before: &Self,
        values_before: PyReadonlyArray1<'py, f64>,
        start: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (first, last) = (before.member(kind, &values_before)?, self.member(kind, &values)?);
        let start = unknowns(&fixed("start", &start)?);
        self.result(py, continued((&before.scene, &first), &start, (&self.scene, &last)))
    }

    /// For each wrench (n, 3) the largest multiple that the equilibrium at the coordinates `q` bears (n,), the names of
    /// the limits, and the coordinates there (n, 9).
    fn wrench_limits<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray1<'py, f64>,
        wrenches: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<WrenchLimits<'py>> {
        let z = unknowns(&fixed("q", &q)?);
        let member = Member::From(self.scene.origin(&z));
        let wrenches = columns::<3>("wrenches", &wrenches)?;
        let found = py.detach(|| {
            let Some(rest) = Rest::solve(&self.scene, &member, &z) else {
                return Err(PyValueError::new_err("q: the forces do not balance there"));
            };
            let mut signals = Signals::new();
            let mut found = room("the limits, in numbers,", wrenches.len())?;
            for wrench in wrenches {
                signals.check()?;
                found.push(largest_multiple(&self.scene, &rest, wrench));
            }
            Ok(found)
        })?;
        let multiples = found.iter().map(|(multiple, ..)| *multiple);
        let names = found.iter().map(|(_, limit, _)| limit.name());
        Ok((
            PyArray1::from_iter(py, multiples),
            names.collect(),
            rows(py, found.iter().map(|(.., q)| q.row()).collect())?,
        ))
    }
}
