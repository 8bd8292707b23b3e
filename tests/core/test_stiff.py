"""Stiff and hard scenes beside SciPy: right where the steps are long, and of which order there."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import softpinch as sp
from oracle.trajectory import Reference, error, reference
from softpinch import _core, paper

# Overdamped: rates die out within c / m, 1e7 1/s, ten thousand times faster than a step. SciPy's
# explicit method pays for that with 300 000 evaluations, so its reference is by the implicit one.
OVERDAMPED = sp.Scene(
    hand=sp.Hand(tip=sp.Fingertip(normal_viscosity=1e4, tangential_viscosity=1e4)),
    grasped=sp.GraspedObject(mass=1e-3),
    schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 4]])),
    duration=0.02,
)
SCENES = {
    "overdamped": OVERDAMPED,
    "rigid": sp.Scene(hand=sp.Hand(tip=sp.Fingertip(youngs_modulus=1e10)), duration=0.02),
    "light": sp.Scene(grasped=sp.GraspedObject(mass=1e-3), duration=0.1),
    "deadbeat gains": sp.Scene(control=sp.Pid(kp=1e4, kd=20.0), duration=0.1),
}


@cache
def expected(name: str) -> Reference:
    """By SciPy at rtol 1e-12: two methods of it agree, as the test below says."""
    scene = SCENES[name]
    method = "Radau" if name == "overdamped" else "DOP853"
    return reference(scene, np.linspace(0, scene.duration, 21), method=method)


@pytest.mark.parametrize("name", ["the paper's manipulation", *SCENES])
def test_two_methods_of_scipy_agree_on_a_reference(name: str) -> None:
    """DOP853 at rtol 1e-12, Radau at 1e-10, and ours beside them: the first 10 ms.

    Of the scenes where DOP853's steps are shortest less.
    """
    duration = {"overdamped": 0.0005, "rigid": 0.005}.get(name, 0.01)
    scene = replace(SCENES.get(name, paper.manipulation()), duration=duration)
    times = np.linspace(0, scene.duration, 11)
    explicit = reference(scene, times)
    implicit = reference(scene, times, method="Radau", rtol=1e-10)
    assert max(error(implicit, explicit).values()) < 1e-8
    how = {"tolerance": 1e-11, "times": times, "record": ("state", "multipliers")}
    for formulation in _core.FORMULATIONS:
        run = sp.simulate(scene, method="radau5", formulation=formulation, **how)
        assert max(error(run, implicit).values()) < 2e-8


def stiff_errors(method: str, formulation: str, steps: np.ndarray) -> dict[str, np.ndarray]:
    """Errors at the end of the overdamped scene, scaled along the run."""
    exact = expected("overdamped")
    found = []
    for dt in steps:
        run = sp.simulate(
            OVERDAMPED,
            dt=float(dt),
            method=method,
            formulation=formulation,
            record=("state", "multipliers"),
            every=10**9,
        )
        assert run.success, run.message
        rows = {
            name: np.abs(getattr(run, name)[-1] - getattr(exact, name)[-1])
            / np.abs(getattr(exact, name)).max(axis=0)
            for name in ("q", "p", "multipliers")
        }
        found.append({name: row.max() for name, row in rows.items()})
    return {name: np.array([row[name] for row in found]) for name in found[0]}


STIFF_STEPS = 1e-3 / 2.0 ** np.arange(5)


def slope(errors: np.ndarray) -> float:
    return float(np.polyfit(np.log(STIFF_STEPS), np.log(errors), 1)[0])


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_radau5_is_right_at_ten_thousand_times_the_stiff_time(formulation: str) -> None:
    """Stiffly accurate: what is stiff ends each step on its slow manifold.

    Of order three there, the order of its stages, instead of five (Hairer and Wanner, "Solving
    Ordinary Differential Equations II", VI.3: h^3 times the stiff time).
    """
    errors = stiff_errors("radau5", formulation, STIFF_STEPS)
    for quantity, sizes in errors.items():
        assert abs(slope(sizes) - 3) < 0.4, (quantity, errors)
    assert max(error.max() for error in errors.values()) < 1e-5, errors
    assert max(error[-1] for error in errors.values()) < 1e-8, errors


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_rosenbrock_loses_order_where_it_is_stiff(formulation: str) -> None:
    """At 2 to 4, from long steps to short: linearly implicit stages are solved by one step each."""
    errors = stiff_errors("rosenbrock", formulation, STIFF_STEPS)
    for quantity, sizes in errors.items():
        assert 1.7 <= slope(sizes) <= 4.5, (quantity, errors)
    assert max(error.max() for error in errors.values()) < 3e-3, errors


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_the_midpoint_rule_keeps_its_order_in_q_only(formulation: str) -> None:
    """R(infinity) = -1: what is infinitely stiff changes its sign with every step for ever.

    So rates and multipliers stay far off, until dt is so short that R is well inside of -1; the
    places, which alternating rates leave alone in the mean, converge with order two.
    """
    errors = stiff_errors("implicit_midpoint", formulation, STIFF_STEPS)
    assert abs(slope(errors["q"]) - 2) < 0.4, errors
    assert errors["p"][0] > 0.1, errors
    assert errors["multipliers"][0] > 0.1, errors
    assert np.all(errors["p"] > 1e3 * errors["q"]), errors
