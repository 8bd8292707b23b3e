"""Scenes whose numbers are far from anything real."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

import softpinch as sp

decades = st.floats(-6.0, 6.0)


def stretched(record: Any, draw: Any, exponents: st.SearchStrategy[float]) -> Any:
    """The record with each number moved by a power of ten of its own."""
    changes = {
        field.name: float(np.clip(value * 10.0 ** draw(exponents), -1e308, 1e308))
        for field in fields(record)
        if isinstance(value := getattr(record, field.name), float)
    }
    return replace(record, **changes)


def wild_scene(draw: Any, exponents: st.SearchStrategy[float]) -> sp.Scene:
    fingers = [stretched(sp.Finger(), draw, exponents) for _ in range(2)]
    tips = tuple(
        stretched(sp.Fingertip(normal_mass=0.1, tangential_mass=0.1), draw, exponents)
        for _ in range(2)
    )
    return sp.Scene(
        hand=sp.Hand(right=fingers[0], left=fingers[1], tip=tips),
        grasped=stretched(sp.GraspedObject(), draw, exponents),
        control=(stretched(sp.Pid(), draw, exponents), stretched(sp.Pid(), draw, exponents)),
        disturbances=[sp.Step(time=0.001, force=(10.0 ** draw(exponents), 0.0))],
        gravity=9.81 * 10.0 ** draw(decades),
        duration=0.01,
    )


def started(scene: sp.Scene, draw: Any) -> sp.Scene:
    """From a state that keeps the constraints, whatever the geometry is."""
    angle = st.floats(-1.4, 1.4)
    state = sp.State.consistent(
        scene, rotation=draw(angle), fingers=(draw(angle), draw(angle)), velocity=(0.1, 0.0, 1.0)
    )
    return replace(scene, initial=state)
