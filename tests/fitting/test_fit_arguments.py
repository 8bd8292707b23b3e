"""Bad input of `sp.fit` is refused before anything is computed, by name, value and rule."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from measured_motions import BOUNDS, DT, SCENE, TIMES, TRUTH, C, E, changed, columns, motion
from refusals import check_refusal
from softpinch.fitting.experiment import Experiment, FailedRun

pytest.importorskip("scipy")
DATA = {"y": np.zeros(len(TIMES))}
# The hand's acceleration jumps.
MOVED = replace(SCENE, motion=sp.HandMotion.trapezoid([0.0, 0.05], [[0, 0], [0.01, 0]], 40.0))


def fit(**other: Any) -> sp.Fit:
    given: dict[str, Any] = {
        "scene": SCENE,
        "times": TIMES,
        "measured": DATA,
        "vary": BOUNDS,
        "dt": DT,
    }
    return sp.fit(**(given | other))


BAD_VALUES: list[tuple[dict[str, Any], str]] = [
    ({"scene": [SCENE], "times": [TIMES] * 2}, "times has 2 entries: must have one for each"),
    ({"times": TIMES[::-1]}, "must be greater than the time before it, 0.1"),
    ({"times": TIMES + 0.1}, "times: must be from 0.0 to 0.1 s, the time of the scene"),
    ({"measured": {}}, "measured = {}: must have at least one observable"),
    ({"measured": {"rotatoin": TIMES}}, 'did you mean "rotation"?'),
    ({"measured": {"y": TIMES[1:]}}, 'measured["y"] has shape (45,): must have shape (46,)'),
    ({"measured": {"y": TIMES, "pose": np.ones((46, 3))}}, '"y" and "pose" both have y'),
    ({"measured": {"y": np.full(46, np.nan)}}, "measured: has no number, only NaN"),
    ({"measured": {"y": np.full(46, np.inf)}}, 'measured["y"][0] is infinite: must be finite'),
    ({"vary": {}}, "vary = {}: must have at least one path"),
    ({"vary": {"disturbances.0.force": None}}, "has shape (2,): must be one number, such as"),
    ({"vary": {"duration": None}}, 'vary: "duration": the measured times determine it'),
    ({"vary": {"disturbances.0.time": None}}, "is fitted with tolerance=, not with dt"),
    (
        {"scene": MOVED, "vary": {"motion.times.1": None}},
        "is fitted with tolerance=, not with dt",
    ),
    ({"vary": {E: (2e5, 1e5)}}, "high = 100000: must be above low = 200000"),
    ({"start": {"gravity": 1.0}}, "start = 'gravity': must be one of"),
    ({"start": {E: 1.0}}, "must be within the bounds 10000 and 1e+07"),
    ({"noise": 0.0}, "noise = 0.0: must be finite and > 0"),
    ({"noise": {"y": [1.0, 2.0]}}, 'noise["y"] has shape (2,): must be a number or 1 numbers'),
    ({"loss": "huber"}, 'loss = \'huber\': must be one of "linear", "soft_l1"'),
    ({"tolerance": 1e-6}, "dt = 0.0002 and tolerance = 1e-06: give one of them"),
    ({"times": TIMES[:2], "measured": {"y": [0.0, 1.0]}}, "2 numbers cannot determine 2 para"),
]
BAD_TYPES: list[tuple[dict[str, Any], str]] = [
    ({"scene": 3}, "scene = 3: must be a Scene, or a sequence of scenes"),
    ({"measured": [1.0]}, "measured = [1.0]: must be a mapping of observables"),
    ({"vary": {(E, C): (1.0, 2.0)}}, "must be one path; one number for several paths is not"),
    ({"vary": {E: 3.0}}, "= 3.0: must be bounds (low, high), or None"),
]


@pytest.mark.parametrize(
    ("error", "given", "message"),
    [(ValueError, *case) for case in BAD_VALUES] + [(TypeError, *case) for case in BAD_TYPES],
)
def test_bad_input_is_refused(
    error: type[Exception], given: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compute(*_: Any, **__: Any) -> None:
        raise AssertionError("a run was computed")

    monkeypatch.setattr("softpinch.fitting.experiment.computed", compute)
    check_refusal(lambda: fit(**given), error, message)


def test_a_failed_start_is_refused_with_its_values() -> None:
    """The step is too long for such viscous tips; and the fingers of a state reach no wider box."""
    with pytest.raises(ValueError, match=rf"^start: the run at {C} = 3000 fails: .*unstable"):
        fit(vary={C: None}, start={C: 3000.0})
    off = replace(SCENE, initial=replace(motion().state(-1), time=0.0, check=True))
    with pytest.raises(ValueError, match=r"^start: the run at grasped\.width = 0\.1 fails: "):
        fit(scene=off, vary={"grasped.width": (0.01, 0.2)}, start={"grasped.width": 0.1})


def test_a_failed_run_on_the_way_is_a_step_that_is_shortened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The bounds are wider than the rule of the scene, and the first steps lead beyond that."""
    simulated, failed = Experiment.simulated, []

    def counted(*args: Any, **named: Any) -> Any:
        try:
            return simulated(*args, **named)
        except FailedRun as error:
            failed.append(str(error))
            raise

    monkeypatch.setattr(Experiment, "simulated", counted)
    scene = changed(SCENE, TRUTH)
    found = sp.fit(scene, TIMES, columns(motion(), "rotation"), {C: (-5e3, 5e3)},
                   start={C: 400.0}, dt=DT)  # fmt: skip
    assert found.values[C] == pytest.approx(TRUTH[C], rel=1e-6)
    assert failed and "must be finite and >= 0" in failed[0]


def test_derivatives_that_fail_on_the_way_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    simulated = Experiment.simulated

    def failing(self: Experiment, values: Any, options: Any, slopes: bool, *rest: Any) -> Any:
        if slopes and values[C] < 50.0:
            raise FailedRun("no derivatives")
        return simulated(self, values, options, slopes, *rest)

    monkeypatch.setattr(Experiment, "simulated", failing)
    with pytest.raises(ValueError, match=r"^vary: no search came to its end: no derivatives$"):
        fit(measured=columns(motion(), "rotation"))
