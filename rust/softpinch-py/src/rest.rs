//! Equilibria across the border to Python.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{columns, dictionary, fixed, matrix, raise, room, rows};
use crate::inputs::Inputs;
use crate::signals::Signals;
use softpinch::analysis::balance::{Member, RestScene as CoreRestScene, Unknowns};
use softpinch::analysis::equilibrium::{continued, find, neutral, violations};
use softpinch::analysis::reason::Reason;
use softpinch::analysis::rest::Rest;
use softpinch::analysis::wrench::largest_multiple;
use softpinch::error::lookup;
use softpinch::model::rule::Rule;
use softpinch::number::simd::level::Level;
use softpinch::stepping::monitor::VIOLATIONS;

/// Makes a member of the family of equilibria in a scene from its numbers.
type MakeMember = fn(&CoreRestScene, &PyReadonlyArray1<'_, f64>) -> PyResult<Member>;

/// The kinds of members: two numbers, or the coordinates from which the member comes.
const KINDS: [(&str, MakeMember); 3] = [
    ("grip", |_, values| Ok(Member::Grip(fixed("grip", values)?))),
    ("shear", |_, values| Ok(Member::Shear(fixed("shear", values)?))),
    ("from", |scene, values| Ok(Member::From(scene.origin(&unknowns(&fixed("near", values)?))))),
];

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
    /// The member that a kind and its numbers mean.
    fn member(&self, kind: &str, values: &PyReadonlyArray1<'_, f64>) -> PyResult<Member> {
        lookup("member", kind, &KINDS).map_err(raise)?(&self.scene, values)
    }

    /// The result as a dictionary; without an equilibrium it has only status and message.
    fn result<'py>(&self, py: Python<'py>, found: Result<Rest, Reason>) -> PyResult<Bound<'py, PyDict>> {
        let rest = match found {
            Ok(rest) => rest,
            Err(reason) => {
                return Ok(dictionary!(py, { "status": reason.name(), "message": reason.to_string() }));
            }
        };
        let (scene, balance) = (&self.scene, &rest.rows.balance);
        let (found, energies) = (violations(scene, &rest), scene.energies(balance));
        let names = VIOLATIONS.into_iter().filter(|&(_, violation)| found.contains(violation));
        Ok(dictionary!(py, {
            "status": "at_rest",
            "q": balance.q.row().to_pyarray(py),
            "integral": scene.memory(balance).to_pyarray(py),
            "torque": scene.torque(balance).to_pyarray(py),
            "multipliers": balance.multipliers.to_pyarray(py),
            "stiffness": matrix(py, &rest.stiffness().fixed_view::<3, 3>(0, 0).into_owned())?,
            "neutral": rows(py, neutral(scene, &rest).map(|slope| slope.row()).to_vec())?,
            "grip": balance.sigma.map(|sigma| -sigma).to_pyarray(py),
            "elastic": energies.elastic,
            "gravity": energies.gravity,
            "minimum": rest.is_minimum(scene),
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
