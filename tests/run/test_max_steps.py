"""`max_steps`: a run that would take for ever ends as a row, and holds up no other."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from cli_calls import call
from ensembles import computed, require_alone, require_same
from softpinch import _core
from softpinch.study import study_file

SCENE = sp.Scene(duration=0.05, disturbances=[sp.Sine(frequency_hz=40.0, force=(1.0, 2.0))])
WILD = 3
# Method, path, what calm runs have there, and what makes a run need more steps than allowed: what
# is stiff for explicit steps, and for implicit ones what they have to follow.
OUTLIERS = [
    ("dop853", "hand.tip.tangential_viscosity", 100.0, 1e6),
    ("rosenbrock", "disturbances.0.frequency_hz", 40.0, 5e4),
    ("radau5", "disturbances.0.frequency_hz", 40.0, 5e4),
]


def study(values: np.ndarray, method: str, path: str, **how: Any) -> sp.Ensemble:
    return sp.monte_carlo(
        SCENE,
        vary={path: values},
        **{
            "tolerance": 1e-6,
            "method": method,
            "formulation": "nullspace",
            "max_steps": 3000,
            "summaries": ("final_state", *_core.SUMMARIES),
            "progress": False,
            **how,
        },
    )


def attempts(run: sp.Run) -> int:
    return run.stats["steps"] + run.stats["rejected"]


@pytest.mark.parametrize(("method", "path", "calm", "wild"), OUTLIERS)
def test_an_outlier_ends_as_its_own_row_and_touches_no_other(
    method: str, path: str, calm: float, wild: float
) -> None:
    values = calm * np.linspace(0.95, 1.05, 19)
    without = study(values, method, path)
    assert without.counts() == {"completed": 19} and without.steps.max() < 500
    values[WILD] = wild
    for threads in (1, 2):
        ensemble = study(values, method, path, threads=threads)
        assert ensemble.counts() == {"completed": 18, "too_many_steps": 1}
        others = np.delete(np.arange(19), WILD)
        require_same(ensemble, study(values, method, path, only=others), others)
        for name, column in without.summaries.items():
            np.testing.assert_array_equal(ensemble[name][others], column[others])
    # The words have the limit, the instant and the step: it ended at the same attempt.
    alone = require_alone(ensemble, WILD)
    assert attempts(alone) == 3000
    assert alone.message.startswith("3000 steps, rejected ones too, were not enough: the run")
    assert 0.0 < ensemble.failure_time[WILD] < 0.05
    direct = sp.simulate(ensemble.scene_of(WILD), tolerance=1e-6, method=method,
                         formulation="nullspace", max_steps=3000)  # fmt: skip
    assert (direct.status, direct.message) == ("too_many_steps", ensemble.message[WILD])


@pytest.mark.parametrize("method", _core.ADAPTIVE_METHODS)
def test_the_last_step_allowed_may_be_the_last_needed(method: str) -> None:
    how: dict[str, Any] = {"tolerance": 1e-6, "method": method, "formulation": "nullspace"}
    needed = attempts(sp.simulate(SCENE, **how))
    for most, status in ((needed, "completed"), (needed - 1, "too_many_steps")):
        assert sp.simulate(SCENE, max_steps=most, **how).status == status
        ensemble = sp.monte_carlo(SCENE, 1, max_steps=most, progress=False, **how)
        assert ensemble.status.tolist() == [status]
        assert ensemble.provenance()["max_steps"] == most


@pytest.mark.parametrize("method", ["dop853", "rosenbrock"])
def test_check_dt_allows_its_smaller_tolerance_more_steps(method: str) -> None:
    masses = np.linspace(0.09, 0.11, 9)
    how = {"method": method, "path": "grasped.mass", "values": masses}
    free = study(**how, max_steps=None)
    finer = study(**how, tolerance=1e-7, max_steps=None)
    most, finest = (max(attempts(part.replay(k)) for k in range(9)) for part in (free, finer))
    assert most < finest
    checked = study(**how, max_steps=most, check_dt=True)
    require_same(checked, free)
    assert checked.discretisation is not None
    completed = checked.discretisation["completed"]
    assert (completed.bias, completed.runs) == (0.0, 9)
    difference = free["peak_rotation"] - finer["peak_rotation"]
    assert checked.discretisation["peak_rotation"].bias == difference.mean()


BAD: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"max_steps": 0}, ValueError, "max_steps = 0: must be at least 1"),
    ({"max_steps": 1e6}, TypeError, "max_steps = 1000000.0: must be an integer"),
    ({"max_steps": 9, "tolerance": None, "dt": 1e-3}, ValueError, "goes with tolerance"),
]


@pytest.mark.parametrize(("how", "error", "message"), BAD, ids=str)
def test_bad_values_are_refused(how: dict[str, Any], error: type[Exception], message: str) -> None:
    how = {"tolerance": 1e-6, "method": "dop853", **how}
    with pytest.raises(error, match=message):
        sp.simulate(SCENE, **how)
    with pytest.raises(error, match=message):
        sp.monte_carlo(SCENE, 2, progress=False, **how)


def test_a_study_file_has_it_and_a_step_takes_its_place(tmp_path: Path) -> None:
    pytest.importorskip("tomli_w")
    path = tmp_path / "study.toml"
    path.write_text(
        "[scene]\nduration = 0.05\n[study]\ntolerance = 1e-6\nmethod = 'dop853'\nmax_steps = 20\n"
        "runs = 3\n",
        encoding="utf-8",
    )
    given = study_file.read(path)
    assert given.options.max_steps == 20
    assert computed(given).counts() == {"too_many_steps": 3}
    assert study_file.read(path, tolerance=1e-7).options.max_steps == 20
    with pytest.raises(ValueError, match="max_steps = 7: goes with tolerance"):
        study_file.read(path, dt=1e-3, max_steps=7)
    code, said, err = call("montecarlo", path, "--out", tmp_path / "steps", "--dt", "1e-3")
    assert (code, err) == (0, "") and "3 completed" in said
