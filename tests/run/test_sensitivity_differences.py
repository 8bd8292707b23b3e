"""Derivatives beside differences of runs, for random scenes."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, reject, settings
from hypothesis import strategies as st

import derivative_paths as paths_of
import softpinch as sp
from derivative_differences import of
from differences import changed, closest, states
from softpinch import _core, strategies

# Shares of a number's size.
LADDER = (1e-2, 1e-3, 1e-4, 1e-5)
DT = 5e-4
# A derivative by a whole number that changes the motion by less than this share counts as zero.
LEAST = 1e-4
# Near rest, rates have the round-off of coordinates times the rate of the fastest motions.
ROUND_OFF = np.repeat([1.0, 30.0], 9)
# Smaller examples of a failure would take minutes to find.
QUICK = (Phase.explicit, Phase.reuse, Phase.generate)


def off(
    scene: sp.Scene, path: str, index: tuple[int, ...], ladder: Any = LADDER, **how: Any
) -> float:
    """The error of the derivatives by one number, by comparison with differences."""
    # Most driven fingers soon pull at the object: such runs are compared too.
    how["stop_on"] = ()
    run = sp.simulate(scene, sensitivities=path, **how)
    assume(run.success)

    def moved(by: float) -> Any:
        other = sp.simulate(changed(scene, path, index, by), **how)
        assume(other.success)
        assert len(other.t) == len(run.t)
        return states(other)

    size = paths_of.size(scene, path, index)
    least = LEAST / size * (np.abs(states(run)) + ROUND_OFF)
    ours = of(run, "state", path, index)
    return closest(ours, moved, [share * size for share in ladder], least)


def random_number(
    data: st.DataObject, scene: sp.Scene, formulation: str
) -> tuple[sp.Scene, str, tuple[int, ...]]:
    """A number at random, and the scene from a state if it is one of that."""
    paths = [*paths_of.sided(scene), *paths_of.shared(scene), *paths_of.inputs(scene)]
    # The other formulations do not start off the constraints.
    paths += ["initial.q", "initial.p"] if formulation == "csm" else []
    if scene.fingers == "driven":
        paths = [path for path in paths if not path.startswith(("control", "initial"))]
    else:
        paths += ["initial.integral"]
    path = data.draw(st.sampled_from(paths))
    if path.startswith("initial"):
        start = data.draw(strategies.consistent_states(scene))
        scene = replace(scene, initial=replace(start, check=False))
    index = tuple(data.draw(st.integers(0, n - 1)) for n in np.shape(paths_of.value(scene, path)))
    return scene, path, index


def compared(data: st.DataObject, method: str, formulation: str, fingers: str = "pid") -> None:
    # Driven fingers that moved by 10 degrees within so short a run would throw the object away.
    change = math.radians(0.2 if fingers == "driven" else 10.0)
    scenes = strategies.scenes(duration=0.01, largest_change=change, fingers=fingers)
    scene, path, index = random_number(data, data.draw(scenes), formulation)
    how: dict[str, Any] = {"dt": DT, "method": method, "formulation": formulation}
    try:
        found = off(scene, path, index, **how)
    except ValueError as error:  # no contact, or a standard deviation below zero
        assert "reach" in str(error) or ">= 0" in str(error)
        reject()
    assert found <= 1e-6, (path, index)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize("method", _core.METHODS)
@settings(max_examples=8, phases=QUICK, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_differences_of_runs_agree(data: st.DataObject, method: str, formulation: str) -> None:
    compared(data, method, formulation)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@settings(max_examples=10, phases=QUICK, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_differences_of_runs_of_driven_fingers_agree(data: st.DataObject, formulation: str) -> None:
    compared(data, data.draw(st.sampled_from(_core.METHODS)), formulation, "driven")
