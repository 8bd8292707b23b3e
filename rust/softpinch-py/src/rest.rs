//! Equilibria across the border to Python.

use numpy::{PyArray1, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{
    GivenRow, GivenRows, Physics, Row, Rows, columns, computed, dictionary, fixed, matrix, raise, rows,
};
use crate::inputs::Inputs;
use softpinch::analysis::{
    Load, Member, Reason, Rest, RestScene as CoreRestScene, Unknowns, continued, find, largest_multiple,
    neutral, violations,
};
use softpinch::error::lookup;
use softpinch::model::Rule;
use softpinch::stepping::VIOLATIONS;

/// Makes a member of the family of equilibria in a scene from its numbers.
type MakeMember = fn(&CoreRestScene, &GivenRow<'_>) -> PyResult<Member>;

/// The kinds of members: two numbers, or the coordinates from which the member comes.
const KINDS: [(&str, MakeMember); 3] = [
    ("grip", |_, values| Ok(Member::Grip(fixed("grip", values)?))),
    ("shear", |_, values| Ok(Member::Shear(fixed("shear", values)?))),
    ("from", |scene, values| Ok(Member::From(scene.origin(&unknowns(&fixed("near", values)?))))),
];

/// Multiples, names of limits and coordinates.
type Limits<'py> = (Row<'py>, Vec<&'static str>, Rows<'py>);

/// A scene at rest under the inputs of one instant.
#[pyclass(frozen, module = "softpinch._core")]
pub struct RestScene(CoreRestScene);

fn unknowns(q: &[f64; 9]) -> Unknowns {
    let [x, y, theta, right, left, _, _, shear1, shear2] = *q;
    [x, y, theta, right, left, shear1, shear2]
}

impl RestScene {
    fn member(&self, kind: &str, values: &GivenRow<'_>) -> PyResult<Member> {
        lookup("member", kind, &KINDS).map_err(raise)?(&self.0, values)
    }

    /// The result as a dictionary; without an equilibrium it has only status and message.
    fn result<'py>(&self, py: Python<'py>, found: Result<Rest, Reason>) -> PyResult<Bound<'py, PyDict>> {
        let rest = match found {
            Ok(rest) => rest,
            Err(reason) => {
                return Ok(dictionary!(py, { "status": reason.name(), "message": reason.to_string() }));
            }
        };
        let (scene, balance) = (&self.0, &rest.rows.balance);
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
    fn new(parameters: Physics, inputs: &Inputs, time: f64) -> PyResult<Self> {
        Rule::Finite.check("time", time).map_err(raise)?;
        let inputs = inputs.of(0, 0.0).map_err(raise)?.frozen(time);
        Ok(Self(CoreRestScene::new(&parameters.0, inputs.fingers, &inputs.segment(time))))
    }

    /// The equilibrium of a member of the family, near the coordinates `start` if they are given.
    #[pyo3(signature = (kind, values, start=None))]
    fn equilibrium<'py>(
        &self,
        py: Python<'py>,
        kind: &str,
        values: GivenRow<'py>,
        start: Option<[f64; 9]>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let member = self.member(kind, &values)?;
        self.result(py, find(&self.0, &member, start.as_ref().map(unknowns).as_ref()))
    }

    /// The equilibrium that continues that of another scene, near its coordinates `start`, while that scene becomes
    /// this one. `values` and `values_before` are those of the members.
    fn continued<'py>(
        &self,
        py: Python<'py>,
        kind: &str,
        values: GivenRow<'py>,
        before: &Self,
        values_before: GivenRow<'py>,
        start: [f64; 9],
    ) -> PyResult<Bound<'py, PyDict>> {
        let (first, last) = (before.member(kind, &values_before)?, self.member(kind, &values)?);
        self.result(py, continued((&before.0, &first), &unknowns(&start), (&self.0, &last)))
    }

    /// For each load the largest multiple that the equilibrium at the coordinates `q` bears (n,), the names of the limits,
    /// and the coordinates there (n, 9). Loads are wrenches (n, 3), or accelerations of the hand along fixed axes (n, 2).
    fn limits<'py>(&self, py: Python<'py>, q: [f64; 9], loads: GivenRows<'py>) -> PyResult<Limits<'py>> {
        let z = unknowns(&q);
        let loads: Vec<_> = if loads.as_array().ncols() == 3 {
            columns("wrenches", &loads)?.into_iter().map(Load::Wrench).collect()
        } else {
            columns("accelerations", &loads)?.into_iter().map(Load::Acceleration).collect()
        };
        let member = Member::From(self.0.origin(&z));
        let rest = Rest::solve(&self.0, &member, &z)
            .ok_or_else(|| PyValueError::new_err("q: the forces do not balance there"))?;
        let limits = loads.into_iter().map(|load| largest_multiple(&self.0, &rest, load));
        let found = computed(py, "the limits, in numbers,", limits)?;
        let multiples = found.iter().map(|(multiple, ..)| *multiple);
        let names = found.iter().map(|(_, limit, _)| limit.name());
        Ok((
            PyArray1::from_iter(py, multiples),
            names.collect(),
            rows(py, found.iter().map(|(.., q)| q.row()).collect())?,
        ))
    }
}
