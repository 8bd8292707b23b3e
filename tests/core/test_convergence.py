"""Each method keeps its order, also where switches and edges fall between multiples of dt."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import softpinch as sp
from oracle.trajectory import Reference, error, reference
from scenes import SCENES, driven, swaying
from softpinch import _core

# Steps that no switch or edge is a multiple of. The window that is fitted lies in RK4's asymptotic
# range and above what the reference leaves open (1e-11 of p): the uneven hand's left finger is the
# fastest, K_D / I = 2400 1/s, and wants shorter steps; so does the short pulse.
WINDOW = 4.03e-4 / 2.0 ** np.arange(4)
WINDOWS = {"uneven": 0.27 * WINDOW[:3], "pulse": 0.5 * WINDOW[:3]}


INPUTS = {
    name: replace(scene, duration=min(scene.duration, 0.1))
    for name, scene in SCENES.items()
    if "paper" not in name
}
SOFT = {"smooth": swaying(), "switches off the grid": driven()}


@cache
def exact(name: str) -> Reference:
    """The end by SciPy, once for all pairs."""
    scene = (INPUTS | SOFT)[name]
    return reference(scene, [scene.duration])


def orders(name: str, steps: np.ndarray, **options: object) -> dict[str, tuple[float, list]]:
    """The observed order of q, p and multipliers at the end, by least squares, with the errors."""
    scene, expected = (INPUTS | SOFT)[name], exact(name)
    errors = []
    for dt in steps:
        run = sp.simulate(
            scene, dt=float(dt), record=("state", "multipliers"), every=10**9, **options
        )
        last = SimpleNamespace(
            t=run.t[-1:], q=run.q[-1:], p=run.p[-1:], multipliers=run.multipliers[-1:]
        )
        errors.append(error(last, expected))
    found = {}
    for quantity in ("q", "p", "multipliers"):
        sizes = [e[quantity] for e in errors]
        found[quantity] = (float(np.polyfit(np.log(steps), np.log(sizes), 1)[0]), sizes)
    return found


@pytest.mark.parametrize("name", INPUTS)
def test_rk4_has_order_four_with_every_kind_of_input(name: str) -> None:
    found = orders(name, WINDOWS.get(name, WINDOW))
    for quantity, (order, errors) in found.items():
        assert abs(order - 4) <= 0.2, (quantity, order, errors)


# Method -> order, how far off it may be, and the steps that are fitted: from where the order begins
# to show down to where the reference (1e-11 of p) ends it. DOP853's slope wanders.
METHODS = {
    "rk4": (4, 0.2, 5.07e-4 / 2.0 ** np.arange(4)),
    "dop853": (8, 0.5, 8.11e-3 / 2.0 ** (np.arange(6) / 2)),
    "implicit_midpoint": (2, 0.2, 2.03e-4 / 2.0 ** np.arange(4)),
    "radau5": (5, 0.2, 1.014e-3 / 2.0 ** np.arange(3)),
    "rosenbrock": (4, 0.2, 1.014e-3 / 2.0 ** np.arange(4)),
}


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize("method", _core.METHODS)
@pytest.mark.parametrize("name", SOFT)
def test_each_pair_has_its_order(name: str, method: str, formulation: str) -> None:
    expected, within, steps = METHODS[method]
    # Gains as soft as the scene: modes of 1/s 1000 would leave the range of the longest steps.
    found = orders(
        name,
        steps,
        method=method,
        formulation=formulation,
        stabilization=sp.Stabilization(alpha=40.0, beta=40.0),
    )
    for quantity, (order, errors) in found.items():
        assert abs(order - expected) <= within, (quantity, order, errors)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize("method", _core.METHODS)
def test_the_ledger_closes_with_the_order_of_each_pair(method: str, formulation: str) -> None:
    expected, _, steps = METHODS[method]
    gaps = []
    for dt in steps:
        energy = sp.simulate(
            driven(),
            dt=float(dt),
            method=method,
            formulation=formulation,
            record=("energy",),
            stabilization=sp.Stabilization(alpha=40.0, beta=40.0),
        ).energy
        gaps.append(np.abs(energy.closure).max() / energy.exchanged)
    order = np.polyfit(np.log(steps), np.log(gaps), 1)[0]
    # The largest gap of a run wanders more than its end, DOP853's the most.
    assert order >= expected - (1.2 if method == "dop853" else 0.5), (order, gaps)
    assert gaps[-1] < 1e-4
