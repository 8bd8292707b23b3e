"""`stop_on`: a run ends at the first instant that shows one of its violations."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from ensembles import require_alone
from scenes import jerked
from softpinch import _core, paper, strategies
from violations import HEIGHTS, RECORD, shown

HOW: list[dict[str, Any]] = [
    {"dt": 5e-4},
    {"dt": 5e-4, "formulation": "nullspace"},
    {"tolerance": 1e-6, "method": "dop853"},
    {"tolerance": 1e-6, "method": "rosenbrock"},
]
SOME = st.sets(st.sampled_from(_core.VIOLATIONS), min_size=1)


@given(strategies.scenes(duration=0.05, force=60.0), HEIGHTS, SOME, st.sampled_from(HOW))
def test_a_run_ends_at_the_first_instant_of_what_it_stops_on(
    scene: sp.Scene, height: float | None, stop_on: set[str], how: dict[str, Any]
) -> None:
    scene = replace(scene, grasped=replace(scene.grasped, height=height))
    free = sp.simulate(scene, **how, stop_on=(), record=RECORD)
    found = {name: rows for name, rows in shown(free).items() if rows.any()}
    if "dt" in how:  # every watched instant is a row
        assert found.keys() == free.violations.keys()
    for name, rows in found.items():
        first = free.t[np.argmax(rows)]
        assert free.violations[name] == first if "dt" in how else free.violations[name] <= first
    run = sp.simulate(scene, **how, stop_on=stop_on, record=RECORD)
    assert run.check(residual=np.inf, closure=np.inf) is run
    seen = {name: time for name, time in free.violations.items() if name in stop_on}
    if not seen:
        assert (run.status, run.t.tolist()) == (free.status, free.t.tolist())
        return
    end = min(seen.values())
    # Of several violations at one instant the first in the table gives the status.
    assert run.status == next(name for name in _core.VIOLATIONS if seen.get(name) == end)
    assert run.t[-1] == end
    rows = int(np.searchsorted(free.t, end))
    assert np.array_equal(run.t[:rows], free.t[:rows])
    assert np.array_equal(run.q[:rows], free.q[:rows])
    assert run.violations == {k: t for k, t in free.violations.items() if t <= end}


def tilted() -> sp.Scene:
    """Soft tips that are pressed deep while they are tilted, until a contact is on the rim."""
    tip = sp.Fingertip(youngs_modulus=2e4)
    angles = np.deg2rad([[25.0, 25.0]])
    return sp.Scene(hand=sp.Hand(tip=tip), schedule=sp.Schedule.steps([0.0], angles), duration=0.2)


NUMBER = r"(-?\d\.\d+e[+-]?\d+|-?[\d.]+)"


@pytest.mark.parametrize("how", HOW, ids=str)
@pytest.mark.parametrize("name", ["pulling", "slipping", "rim", "off_face"])
def test_the_message_has_the_numbers_of_the_last_row(name: str, how: dict[str, Any]) -> None:
    low = replace(jerked(), grasped=sp.GraspedObject(height=3e-3))
    scene = {"rim": tilted(), "off_face": low}.get(name, jerked())
    run = sp.simulate(scene, **how, stop_on=name, record=RECORD)
    assert run.status == name
    assert not run.success
    words = re.search(r"the (right|left) fingertip", run.message)
    assert words, run.message
    i = ("right", "left").index(words[1])
    force, across = run.multipliers[-1, i], abs(run.multipliers[-1, 2 + i])
    d_n = run.q[-1, 5 + i]
    tilt = run.q[-1, 3 + i] + (-1, 1)[i] * run.q[-1, 2]
    matrix = sp.evaluate(scene, run.t[-1], run.q[-1], run.p[-1]).constraint_matrix
    expected = {
        "off_face": [abs(matrix[i, 2]), 1.5e-3],
        "pulling": [force],
        "slipping": [across, 0.6, 0.6 * force],
        "rim": [abs(np.sin(tilt)), d_n, 1.0 - d_n / 0.02],
    }[name]
    time, *numbers = map(float, re.findall(rf"(?:= |at |is |friction ){NUMBER}", run.message))
    assert time == float(f"{run.t[-1]:.6g}")
    np.testing.assert_allclose(numbers, expected, rtol=1e-3)
    assert shown(run)[name][-1]


@pytest.mark.parametrize("how", HOW, ids=str)
@pytest.mark.usefixtures("simd_level")
def test_lanes_end_where_lone_runs_do(how: dict[str, Any]) -> None:
    study = sp.monte_carlo(
        paper.disturbance("ii", duration=1.03),
        21,
        seed=3,
        vary={
            "disturbances.0.force": sp.Uniform((-200.0, -200.0), (200.0, 200.0)),
            "friction": sp.Uniform(0.3, 3.0),
            "grasped.height": sp.Uniform(1e-3, 2e-2),
        },
        stop_on=_core.VIOLATIONS,
        progress=False,
        **how,
    )
    assert len(study.counts()) > 1
    for run in range(0, 21, 4):
        require_alone(study, run)
