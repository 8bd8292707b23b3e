"""Exact properties of derivatives: symmetries, sums, and the same bits in other ways."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import derivative_paths as paths_of
import softpinch as sp
from derivative_differences import of
from derivative_scenes import LOADS, uneven
from differences import changed
from softpinch import _core, strategies
from softpinch.run.ledger import LEDGER
from softpinch.run.options import STOP_ON

RECORD = ("state", "multipliers", "torque", "energy", "residuals")
ALL = ("state", "integral", "multipliers", "torque")
DT = 5e-4
few = settings(max_examples=20)
scenes = strategies.scenes(duration=0.02)
methods = st.sampled_from(_core.METHODS)
formulations = st.sampled_from(_core.FORMULATIONS)
# Powers of two, so that the remaining time after each of them is exact.
BREAKS = tuple(k / 4096 for k in (23, 34, 46))
END = 82 / 4096
IMPULSES = (
    sp.Impulse(time=BREAKS[0], impulse=(0.02, -0.01), angular_impulse=3e-4),
    sp.Impulse(time=BREAKS[2], impulse=(-0.02, 0.01)),
)


def simulated(scene: sp.Scene, method: str, formulation: str, paths: Any, **more: Any) -> sp.Run:
    how = {"dt": DT, "record": RECORD, "stop_on": (), **more}
    return sp.simulate(scene, method=method, formulation=formulation, sensitivities=paths, **how)


def require_same_bits(ours: sp.Run, theirs: sp.Run, path: str, rows: Any = slice(None)) -> None:
    """All derivatives of both runs by a path are equal."""
    for name in ALL:
        np.testing.assert_array_equal(of(ours, name, path), of(theirs, name, path)[rows], name)
    for name, column in ours.sensitivity.energy.items():
        np.testing.assert_array_equal(column[path], theirs.sensitivity.energy[name][path][rows])


@few
@given(st.data(), methods, formulations)
def test_a_run_that_goes_on_has_the_bits_of_the_whole_derivatives(
    data: st.DataObject, method: str, formulation: str
) -> None:
    schedule = sp.Schedule.steps([0.0, BREAKS[1]], np.deg2rad([[4, 5], [8, 3]]))
    scene = uneven(disturbances=(*IMPULSES, *LOADS), schedule=schedule, duration=END)
    paths = ["hand.right.length", "grasped.mass", "schedule.angles", "disturbances.0.impulse"]
    paths += ["schedule.times", "disturbances.1.time", "disturbances.2.duration", "control.left.ki"]
    run = simulated(scene, method, formulation, paths)
    at_breaks = [int(k) for k in np.flatnonzero(np.isin(run.t, BREAKS))]
    assert len(at_breaks) == 3
    k = data.draw(st.one_of(st.sampled_from(at_breaks), st.integers(0, len(run.t) - 2)))
    left = END - float(run.t[k])
    # Else the last step has another length, by round-off.
    assume(run.t[k] + left == END)
    rest = replace(scene, initial=run.state(k), duration=left)
    again = simulated(rest, method, formulation, run.sensitivity.at(k))
    np.testing.assert_array_equal(again.q, run.q[k:])
    for path in paths:
        for name in ("state", "integral", "multipliers", "torque"):
            ours, theirs = of(again, name, path), of(run, name, path)[k:]
            np.testing.assert_array_equal(ours, theirs, f"{name} by {path} from row {k}")


@few
@given(scenes, methods, formulations, st.booleans())
def test_a_run_has_the_same_bits_with_derivatives_and_without(
    scene: sp.Scene, method: str, formulation: str, free: bool
) -> None:
    how: dict[str, Any] = {"stop_on": STOP_ON}
    if free and method in ("dop853", "radau5", "rosenbrock"):
        how |= {"dt": None, "tolerance": 1e-6}
    paths = [*paths_of.sided(scene), *paths_of.inputs(scene)]
    plain, run = (simulated(scene, method, formulation, one, **how) for one in ((), paths))
    assert (run.status, run.holds) == (plain.status, plain.holds)
    assert run.stats == plain.stats
    assert run.violations == plain.violations
    for name in ("t", "q", "p", "integral", "multipliers", "torque", "residuals"):
        np.testing.assert_array_equal(getattr(run, name), getattr(plain, name), name)
    assert len(run.sensitivity[paths[0]]) == len(run.t)


@few
@given(scenes, st.randoms(use_true_random=False), methods, formulations)
def test_the_order_and_the_number_of_paths_change_no_bit(
    scene: sp.Scene, random: Any, method: str, formulation: str
) -> None:
    paths = [*paths_of.sided(scene), *paths_of.inputs(scene), *paths_of.inputs(scene, times=True)]
    run = simulated(scene, method, formulation, paths)
    assume(run.success)
    shuffled = random.sample(paths, len(paths))
    other = simulated(scene, method, formulation, shuffled)
    assert list(other.sensitivity) == shuffled
    for path in paths:
        require_same_bits(other, run, path)
    alone = random.choice(paths)
    require_same_bits(simulated(scene, method, formulation, alone), run, alone)


@pytest.mark.parametrize("method", _core.METHODS)
@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_derivatives_of_energies_are_those_of_the_ledger(method: str, formulation: str) -> None:
    """Beside differences; and the ledger's closure, which stays small, has a small derivative."""
    scene = uneven(duration=0.01, disturbances=(sp.Step(time=0.00213, force=(1.0, 2.0)),))
    path, h = "hand.tip.right.youngs_modulus", 30.0
    how: dict[str, Any] = {
        "dt": 2e-4,
        "method": method,
        "formulation": formulation,
        "record": ("state", "energy"),
    }
    run = sp.simulate(scene, **how, sensitivities=path)
    stiff, soft = (sp.simulate(changed(scene, path, (), by), **how).energy for by in (h, -h))
    assert set(run.sensitivity.energy) <= set(LEDGER)
    largest = 0.0
    for name, found in run.sensitivity.energy.items():
        theirs = (getattr(stiff, name) - getattr(soft, name)) / (2.0 * h)
        largest = max(largest, float(np.abs(theirs).max()))
        assert np.abs(found[path] - theirs).max() <= 1e-6 * largest + 1e-15, name
