"""The other arguments that `monte_carlo` and its result refuse, before anything is computed."""

from collections.abc import Callable

import numpy as np
import pytest

import softpinch as sp
from refusals import SCENE, refused
from softpinch import _core

OTHERS: list[tuple[dict[str, object], type[Exception], str]] = [
    ({"summaries": "peak_rotatoin"}, ValueError, 'summaries = .*did you mean "peak_rotation"'),
    ({"summaries": 3}, TypeError, "summaries = 3: must be names out of"),
    ({"sampler": "sobl"}, ValueError, 'sampler = .*did you mean "sobol"'),
    ({"stop_on": "seperated"}, ValueError, 'stop_on = .*did you mean "separated"'),
    ({"method": "rk5"}, ValueError, 'method = .*did you mean "rk4"'),
    ({"formulation": "cms"}, ValueError, 'formulation = .*did you mean "csm"'),
    ({"stabilization": (1, 2)}, TypeError, "stabilization = .*must be a Stabilization"),
    ({"dt": 0.0}, ValueError, "dt = 0.0: must be finite and > 0"),
    ({"dt": 1e-3, "tolerance": 1e-3}, ValueError, "give one of them"),
    ({"dt": 1e-300}, ValueError, "steps .* would need"),
    ({"dt": None, "tolerance": 1e-3}, ValueError, "method = 'rk4' has no error estimate"),
    (
        {"dt": None, "tolerance": 2.0, "method": "dop853"},
        ValueError,
        "^tolerance = 2.0: must be >= 1e-14 and < 1",
    ),
    (
        {"dt": None, "tolerance": 5e-14, "method": "dop853", "check_dt": True},
        ValueError,
        "check_dt: tolerance = 5.*e-15: must be",
    ),
    ({"only": []}, TypeError, r"only = \[\]: must be the numbers of runs, \(k,\)"),
    ({"only": 3}, TypeError, "only = 3"),
    ({"only": [0.0, 1.0]}, TypeError, "must be the numbers of runs"),
    ({"only": [True, False, True, False]}, TypeError, "must be the numbers of runs"),
    ({"only": [2, 1]}, ValueError, "only: must be increasing and from 0 to runs - 1 = 3"),
    ({"only": [1, 1]}, ValueError, "only: must be increasing"),
    ({"only": [-1, 1]}, ValueError, "only: must be increasing and from 0"),
    ({"only": [1, 4]}, ValueError, "only: must be increasing and from 0 to runs - 1 = 3"),
    ({"only": np.array([3, 1], np.uint64)}, ValueError, "only: must be increasing"),
    ({"only": np.array([9, 1], np.uint64)}, ValueError, "only: must be increasing"),
    ({"trajectories": (4,)}, ValueError, "trajectories = 4: must be at most 3"),
    ({"trajectories": (-1,)}, ValueError, "trajectories = -1: must be at least 0"),
    ({"trajectories": 3}, TypeError, r"trajectories = 3: must be the numbers of runs, such as \("),
    ({"trajectories": "12"}, TypeError, "trajectories = '12': must be the numbers of runs"),
    ({"trajectories": (0.5,)}, TypeError, "trajectories = 0.5: must be an integer"),
    ({"trajectories": (2,), "only": [1]}, ValueError, "run 2 is not in only"),
    ({"threads": 0}, ValueError, "threads = 0: must be at least 1"),
    ({"threads": 10_000}, ValueError, "threads = 10000: must be at most 4096"),
    ({"threads": 1.5}, TypeError, "threads = 1.5: must be an integer"),
    ({"progress": "yes"}, TypeError, "progress = 'yes': must be True, False or a function"),
    ({"seed": -1}, ValueError, "seed = -1: must be at least 0"),
    ({"seed": 2**64}, ValueError, "seed = 18446744073709551616: must be at most"),
    ({"seed": None}, TypeError, "seed = None: must be an integer"),
    ({"settling_band": 0.0}, ValueError, "settling_band = 0.0: must be finite and > 0"),
    ({"settling_band": np.nan}, ValueError, "settling_band = nan"),
    ({"summaries_after": np.inf}, ValueError, "summaries_after = inf: must be finite"),
    ({"summaries_after": "1"}, TypeError, "summaries_after = '1': must be a number"),
    ({"check_dt": 1}, TypeError, "check_dt = 1: must be True or False"),
    ({"stop_when": "completed"}, TypeError, "stop_when = 'completed': must map statuses"),
    ({"stop_when": {"complete": 0.1}}, ValueError, 'stop_when = .*did you mean "completed"'),
    ({"stop_when": {"completed": 0}}, ValueError, r"stop_when\['completed'\] = 0.0: must be"),
    ({"stop_when": {"completed": "a"}}, TypeError, r"stop_when\['completed'\] = 'a'"),
]


@pytest.mark.parametrize(("how", "error", "message"), OTHERS, ids=range(len(OTHERS)))
def test_other_arguments_are_refused(
    how: dict[str, object], error: type[Exception], message: str
) -> None:
    refused(error, message, **{"runs": 4, **how})


def test_what_is_asked_of_a_result_is_checked_too() -> None:
    ensemble = sp.monte_carlo(SCENE, 3, dt=1e-3, progress=False)
    asked: list[tuple[Callable[[], object], type[Exception], str]] = [
        (lambda: ensemble["peak_rotation"], KeyError, "was not computed: pass summaries="),
        (lambda: ensemble["peak"], KeyError, "must be one of"),
        (lambda: ensemble.mean("peak_rotation"), ValueError, '; computed columns are "run"'),
        (lambda: ensemble.quantile("peak_torque", 0.5), ValueError, "was not computed: pass"),
        (lambda: ensemble.probability("complete"), ValueError, 'did you mean "completed"'),
        (lambda: ensemble.probability(confidence=1.0), ValueError, "confidence = 1.0"),
        (lambda: ensemble.probability(np.ones(2, bool)), ValueError, r"booleans \(3,\)"),
        (lambda: ensemble.probability(np.ones(3)), ValueError, "not float64"),
        (lambda: ensemble.replay(3), IndexError, "run 3 is not among the 3 runs"),
        (lambda: ensemble.scene_of(-1), ValueError, "run = -1: must be at least 0"),
        (lambda: sp.monte_carlo("scene", 3), TypeError, "scene = 'scene': must be a Scene"),
    ]
    for ask, error, message in asked:
        with pytest.raises(error, match=message):
            ask()
    assert set(_core.STATUSES) >= set(ensemble.counts())


@pytest.mark.parametrize("ask", ["probability", "happened", "sensitivity", "stop_when"])
def test_an_unknown_event_lists_each_name_once(ask: str) -> None:
    ensemble = sp.monte_carlo(SCENE, 3, vary={"gravity": [9.0, 9.5, 10.0]}, dt=1e-3, progress=False)
    with pytest.raises((ValueError, KeyError)) as error:
        if ask == "sensitivity":
            sp.sensitivity(ensemble, "hold")
        elif ask == "stop_when":
            sp.monte_carlo(SCENE, 3, dt=1e-3, stop_when={"hold": 0.1})
        else:
            getattr(ensemble, ask)("hold")
    text, _, hint = str(error.value).partition("; did you mean ")
    assert hint == '"holds"?'
    listed = text.partition("must be one of ")[2].split(", ")
    assert len(listed) == len(set(listed)), text
