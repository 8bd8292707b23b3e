"""A scene pays only for what it uses: leaving a term out changes nothing but its own effect.

Each pair below is a scene with a term that is present and zero, and the same without it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from scenes import uneven
from softpinch import _core

DURATION = 0.06
ANGLES = np.deg2rad([[6.0, 5.0]])


def bare(**changes: Any) -> sp.Scene:
    """Two different fingers held still, and nothing that pushes."""
    scene = replace(
        uneven(), schedule=sp.Schedule.steps([0.0], ANGLES), initial=None, duration=DURATION
    )
    hand = replace(scene.hand, right=replace(scene.hand.right, root_offset=0.044))
    return replace(replace(scene, hand=hand), **changes)


def same_fingers(**changes: Any) -> sp.Scene:
    return sp.Scene(schedule=sp.Schedule.steps([0.0], ANGLES), duration=DURATION, **changes)


def begun(integral: tuple[float, float]) -> sp.Scene:
    pid = sp.Pid(ki=0.0)
    scene = bare(control=pid)
    return replace(scene, initial=replace(scene.start(), integral=integral))


def moved(schedule: sp.Schedule, fingers: str) -> sp.Scene:
    return bare(schedule=schedule, fingers=fingers)


STILL = sp.Schedule.steps([0.0], ANGLES)
TERMS: dict[str, tuple[sp.Scene, sp.Scene]] = {
    "force": (bare(disturbances=[sp.Step(time=0.0)]), bare()),
    "pulse": (bare(disturbances=[sp.Pulse(time=-1.0, duration=9.0)]), bare()),
    "sine": (bare(disturbances=[sp.Sine(frequency_hz=40.0, phase=0.3)]), bare()),
    "noise": (
        bare(
            disturbances=[
                sp.Noise(force_std=(0, 0), moment_std=0, rate_hz=0.5 / DURATION, time=-DURATION)
            ]
        ),
        bare(),
    ),
    "impulse": (bare(disturbances=[sp.Impulse(time=0.0)]), bare()),
    "ramp": (bare(schedule=sp.Schedule.ramps([0.0, DURATION], ANGLES.repeat(2, 0))), bare()),
    "smooth move": (
        bare(
            schedule=sp.Schedule.minimum_jerk([-1.0, 0.0], ANGLES.repeat(2, 0), move_time=DURATION)
        ),
        bare(),
    ),
    "integral state": (begun((3.0, -2.0)), begun((0.0, 0.0))),
    "unequal tips": (same_fingers(hand=sp.Hand(tip=(sp.Fingertip(),) * 2)), same_fingers()),
    "unequal gains": (same_fingers(control=(sp.Pid(),) * 2), same_fingers()),
    "masses of the tips": (
        same_fingers(hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.1, tangential_mass=0.1))),
        same_fingers(grasped=sp.GraspedObject(mass=0.1)),
    ),
    "friction": (bare(friction=0.1), bare()),
    "height": (bare(grasped=replace(bare().grasped, height=1e-3)), bare()),
    "move of driven fingers": (
        moved(sp.Schedule.minimum_jerk([-1.0, 0.0], ANGLES.repeat(2, 0), DURATION), "driven"),
        moved(STILL, "driven"),
    ),
    "gains of driven fingers": (
        bare(fingers="driven", control=sp.Pid(kp=1.0)),
        bare(fingers="driven"),
    ),
    "inertia of driven fingers": (
        bare(fingers="driven"),
        bare(
            fingers="driven",
            hand=replace(bare().hand, left=replace(bare().hand.left, inertia=1.0)),
        ),
    ),
}
WAYS: dict[str, dict[str, Any]] = {
    "rk4": {"dt": 1e-4},
    "rosenbrock": {"dt": 5e-4, "method": "rosenbrock"},
    "radau5": {"dt": 5e-4, "method": "radau5"},
    "dop853, free": {"tolerance": 1e-7, "method": "dop853"},
}


def ends(run: sp.Run) -> bytes:
    return run.t.tobytes() + run.q.tobytes() + run.p.tobytes()


@pytest.mark.parametrize(
    ("way", "formulation"),
    [
        *(("rk4", formulation) for formulation in _core.FORMULATIONS),
        ("rosenbrock", "csm"),
        ("radau5", "projected"),
        ("dop853, free", "nullspace"),
    ],
)
@pytest.mark.parametrize("name", TERMS)
def test_present_and_zero_is_left_out_to_the_bit(name: str, way: str, formulation: str) -> None:
    present, absent = (
        sp.simulate(scene, formulation=formulation, record=("state", "multipliers"), **WAYS[way])
        for scene in TERMS[name]
    )
    assert absent.success
    assert ends(present) == ends(absent)
    assert present.multipliers.tobytes() == absent.multipliers.tobytes()
    assert absent.violations.items() <= present.violations.items()
    # And nothing more is done for it, but that an impulse has a look at what it has left.
    more = {"evaluations": present.stats["evaluations"] - (name == "impulse")}
    assert {**present.stats, **more} == absent.stats


OPTIONS: dict[str, dict[str, Any]] = {
    "everything recorded": {"record": _core.RECORDABLE},
    "no monitor stops it": {"stop_on": ()},
    "an error estimate": {"estimate_error": True},
}


@pytest.mark.parametrize(
    ("fingers", "formulation"),
    [("pid", "csm"), ("driven", "csm"), ("pid", "projected"), ("driven", "nullspace")],
)
@pytest.mark.parametrize("name", OPTIONS)
@pytest.mark.parametrize("method", _core.METHODS)
def test_records_monitors_and_estimates_change_no_bit(
    name: str, method: str, formulation: str, fingers: str
) -> None:
    how: dict[str, Any] = {"dt": 5e-4, "method": method, "formulation": formulation}
    scene = bare(fingers=fingers, disturbances=[sp.Impulse(time=0.02, impulse=(0.01, 0.0))])
    assert ends(sp.simulate(scene, **how, **OPTIONS[name])) == ends(sp.simulate(scene, **how))


def test_steps_cost_what_the_method_says_and_no_more() -> None:
    """Counted work: evaluations a step, none for what is left out."""
    a_step = {"rk4": 4, "dop853": 12}
    for method, evaluations in a_step.items():
        for scene in (bare(), bare(fingers="driven")):
            stats = sp.simulate(scene, dt=2e-4, method=method).stats
            assert stats["evaluations"] == evaluations * stats["steps"] + 1
            assert stats["jacobians"] == stats["factorisations"] == 0
