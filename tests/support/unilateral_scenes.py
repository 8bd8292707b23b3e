"""Scenes with unilateral contact, and random ones."""

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

import softpinch as sp

# Everything that the modes decide.
RECORD = ("state", "multipliers", "residuals", "energy", "contact")


def gripped(**changes: Any) -> sp.Scene:
    """A grasp at 6 degrees, 40 ms long, in which neither tip slips nor opens."""
    scene = sp.Scene(
        contact="unilateral",
        friction=0.5,
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 6]])),
        grasped=sp.GraspedObject(height=0.049),
        duration=0.04,
    )
    return replace(scene, **changes)


def thrown(**changes: Any) -> sp.Scene:
    """A push after 40 ms: both tips slip, the left one grazes and opens, and the object is lost."""
    push = sp.Step(time=0.04, force=(130.0, 130.0), moment=5.0)
    return gripped(disturbances=(push,), duration=0.06, **changes)


def regripped(**changes: Any) -> sp.Scene:
    """A switch of the targets after 20 ms: the left tip opens there, hits, slips and sticks."""
    schedule = sp.Schedule.steps([0.0, 0.02], np.deg2rad([[6, 6], [20, -10]]))
    return gripped(schedule=schedule, **changes)


@st.composite
def pushes(draw: st.DrawFn) -> sp.Scene:
    """Grasps that a pulse, an impulse or a switch shakes after 20 ms; half of them are lost."""
    size = 10.0 ** draw(st.floats(0.5, 2.5))
    x, y, turn = (size * draw(st.floats(-1.0, 1.0)) for _ in range(3))
    kind = draw(st.sampled_from(["pulse", "impulse", "switch"]))
    tip = sp.Fingertip(normal_mass=0.02, tangential_mass=draw(st.sampled_from([0.01, 0.1])))
    low, high = st.floats(0.0, 0.5), st.floats(0.3, 2.0)
    shaken: dict[str, Any] = {
        "hand": sp.Hand(tip=(tip, sp.Fingertip(normal_mass=0.05))),
        "friction": draw(st.one_of(high, st.tuples(low, high))),
        "grasped": sp.GraspedObject(height=draw(st.sampled_from([None, 0.049, 0.02]))),
    }
    if kind == "switch":
        degrees = [(6.0, 6.0), draw(st.tuples(st.floats(-15.0, 20.0), st.floats(-15.0, 20.0)))]
        return gripped(schedule=sp.Schedule.steps([0.0, 0.02], np.deg2rad(degrees)), **shaken)
    push: sp.Disturbance = sp.Pulse(time=0.02, duration=0.01, force=(x, y), moment=turn / 30)
    if kind == "impulse":
        push = sp.Impulse(time=0.02, impulse=(x / 100, y / 100), angular_impulse=turn / 3000)
    return gripped(disturbances=(push,), **shaken)
