"""Rules of `monte_carlo`'s arguments; `test_arguments` asks every one for wrong types."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

import softpinch as sp
from refusals import SCENE, refused
from softpinch import _core
from softpinch.study import compute
from softpinch.study.spec import SUMMARIES
from softpinch.support.progress import Report

OTHERS: list[tuple[dict[str, object], type[Exception], str]] = [
    ({"summaries": "peak_rotatoin"}, ValueError, 'summaries = .*did you mean "peak_rotation"'),
    ({"sampler": "sobl"}, ValueError, 'sampler = .*did you mean "sobol"'),
    ({"dt": 1e-3, "tolerance": 1e-3}, ValueError, "give one of them"),
    ({"dt": 1e-300}, ValueError, "steps .* would need"),
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
    ({"only": [0.0, 1.0]}, TypeError, "must be the numbers of runs"),
    ({"only": [1, 4]}, ValueError, "only: must be increasing and from 0 to runs - 1 = 3"),
    ({"only": np.array([3, 1], np.uint64)}, ValueError, "only: must be increasing"),
    ({"trajectories": (4,)}, ValueError, "trajectories = 4: must be at most 3"),
    ({"trajectories": (2,), "only": [1]}, ValueError, "run 2 is not in only"),
    ({"every": 2}, ValueError, "^every: for the runs in trajectories, and there are none"),
    ({"seed": 2**64}, ValueError, "seed = 18446744073709551616: must be at most"),
    ({"stop_when": {"complete": 0.1}}, ValueError, 'stop_when = .*did you mean "completed"'),
    ({"stop_when": {"completed": 0}}, ValueError, r"stop_when\['completed'\] = 0.0: must be"),
]


@pytest.mark.parametrize(("how", "error", "message"), OTHERS, ids=range(len(OTHERS)))
def test_other_arguments_are_refused(
    how: dict[str, object], error: type[Exception], message: str
) -> None:
    refused(error, message, **{"runs": 4, **how})


def test_arguments_of_results_are_checked() -> None:
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
    ]
    for ask, error, message in asked:
        with pytest.raises(error, match=message):
            ask()
    assert set(_core.STATUSES) >= set(ensemble.counts())


def test_more_runs_than_memory_are_refused_before_anything_is_drawn() -> None:
    def drawn(_: np.random.Generator) -> float:
        raise AssertionError("a run was drawn")

    how = {"dt": 1e-3, "summaries": SUMMARIES, "progress": False}
    message = r"^runs = 1000000000000: must be at most \d+ in memory, .* pass store=, which keeps"
    with pytest.raises(ValueError, match=message):
        sp.monte_carlo(SCENE, 10**12, vary={"grasped.mass": drawn}, **how)


def test_the_bar_also_shows_the_check_of_more_runs_than_one_call_computes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counts: dict[str, list[tuple[int, int]]] = {}

    @contextmanager
    def bar(progress: object, what: str) -> Iterator[Report]:
        yield lambda *count: counts.setdefault(what, []).append(count) if progress else None

    monkeypatch.setattr(compute, "reporting", bar)
    monkeypatch.setattr(compute, "MOST_BLOCKS", 1)
    scene = sp.Scene(duration=1e-3)
    for runs in (1025, 1024):
        counts.clear()
        sp.monte_carlo(scene, runs, dt=1e-3, summaries=())
        assert counts.get("checking", []) == [(0, 1025), (1024, 1025)][: 2 * (runs > 1024)]
        assert counts["simulating"][-1] == (runs, runs)
