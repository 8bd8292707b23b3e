"""Unilateral contact with friction, event by event: an independent simulation to compare with.

Between two events the modes are fixed and SciPy integrates; at an event, a break of an input or an
impulse the modes are chosen anew (contact_walk.py). contact_terms.py has the terms as SymPy derives
them, contact_parts.py those of jaws, arcs and other parts than the paper's, contact_modes.py the
equations in given modes and the law of impact, contact_system.py the event functions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softpinch.accuracy.segments import Driven, Inputs
from softpinch.scene.parts import others

from .contact_moving import MovingInputs, MovingMechanics, MovingSystem
from .contact_parts import PartsMechanics
from .contact_relaxing import RelaxingSystem
from .contact_system import STATES, ContactSystem
from .contact_terms import Mechanics
from .contact_walk import UnilateralReference, Walk
from .evaluate import parameters
from .lagrangian import SIDES
from .trajectory import start_state


class DrivenInputs(Inputs):
    """Inputs that end with the accelerations of the two driven fingers."""

    def __init__(self, scene: Any, begin: float, end: float) -> None:
        """As `Inputs`."""
        super().__init__(scene, begin, end)
        self._schedule = scene.schedule.compile()

    def between(self, left: float, right: float) -> Driven:
        """As `Inputs.between`, with two more values."""
        usual = super().between(left, right)
        breaks, coefficients = self._schedule
        k = int(np.searchsorted(breaks, (left + right) / 2, side="right"))
        origin = float(breaks[k - 1]) if k else 0.0
        bent = [np.polynomial.Polynomial(row).deriv(2) for row in coefficients[k]]
        return lambda t: (*usual(t), *(float(each(t - origin)) for each in bent))


def unilateral(
    scene: Any, times: ArrayLike | None = None, method: str = "DOP853"
) -> UnilateralReference:
    """Simulates a scene with contact that pushes, slips, opens and closes.

    Args:
        scene: Its start may have gaps (free) and slip; tips that relax have relaxed there.
            `fingers` may be "driven", along a schedule without jumps and kinks. With a motion they
            are not, and tips do not relax; the run is then in inertial coordinates, and its rows in
            the hand's frame.
        times: (n,), s, within the run; None is the start, every break and the end.
        method: "DOP853", or for long rests "Radau", whose steps have no longest one.
    """
    driven = scene.fingers == "driven"
    friction = scene.friction if isinstance(scene.friction, tuple) else (scene.friction,) * 2
    system: type[ContactSystem] = ContactSystem
    kind: type[Inputs] = DrivenInputs if driven else Inputs
    moving = scene.motion is not None
    still = scene.with_({"motion": None, "gravity": 0.0}) if moving else scene
    mechanics: Any
    if others(scene):
        mechanics = PartsMechanics(still)
        halves, length = mechanics.halves, 0.1
    else:
        numbers = parameters(still)
        if driven:
            numbers |= {name: 0.0 for name in numbers if name.startswith("control.")}
        length = max(numbers[f"hand.{side}.length"] for side, _ in SIDES)
        height = scene.grasped.height
        halves = [math.inf if height is None else height / 2] * 2
        mechanics = Mechanics(numbers)
    if moving:
        mechanics, system, kind = MovingMechanics(scene, mechanics), MovingSystem, MovingInputs
    start, begin = start_state(scene)
    inputs = kind(scene, begin, begin + float(scene.duration))
    instants, wanted = inputs.instants(times)
    settings = mechanics, friction, halves
    options: dict[str, Any] = {"length": length, "driven": driven, "method": method}
    if any(tip.relaxation for tip in scene.hand.tips):
        if moving:
            raise ValueError("motion: only with tips that do not relax")
        relaxing = RelaxingSystem(scene, *settings, **options)
        walk = Walk(relaxing, inputs, start)
        walk.y[STATES:] = relaxing.relaxed(start)
    else:
        walk = Walk(system(*settings, **options), inputs, start)
    rows = walk.through(sorted(set(wanted)))
    kept = [rows[t] for t in wanted if t in rows]
    return UnilateralReference(
        t=instants[[t in rows for t in wanted]],
        q=np.array([row.q for row in kept]),
        p=np.array([row.p for row in kept]),
        multipliers=np.array([row.multipliers for row in kept]),
        changes=walk.changes,
        ledger={name: float(value) for name, value in walk.ledger.items()},
        status=walk.status,
        end=walk.last,
    )
