"""Unilateral contact with friction, event by event: an independent simulation to compare with.

Between two events the modes are fixed and SciPy integrates; at an event, a break of an input or an
impulse the modes are chosen anew (contact_walk.py). contact_terms.py has the terms as SymPy derives
them, contact_modes.py the equations in given modes and the law of impact, contact_system.py the
event functions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softpinch.accuracy.segments import Driven, Inputs

from .contact_system import ContactSystem
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
    scene: Any,
    friction: float | tuple[float, float],
    height: float | None = None,
    times: ArrayLike | None = None,
    method: str = "DOP853",
    rtol: float = 1e-11,
) -> UnilateralReference:
    """Simulates a scene with contact that pushes, slips, opens and closes.

    Args:
        scene: Its start may have gaps (free) and slip. `fingers` may be "driven", along a schedule
            without jumps and kinks.
        friction: mu, or a pair (right, left).
        height: Of the object's faces, m; None is endless.
        times: (n,), s, within the run; None is the start, every break and the end.
        method: One of scipy.integrate's one-step classes.
        rtol: Relative tolerance.
    """
    driven = scene.fingers == "driven"
    pair = friction if isinstance(friction, tuple) else (friction, friction)
    numbers = parameters(scene)
    if driven:
        numbers |= {name: 0.0 for name in numbers if name.startswith("control.")}
    length = max(numbers[f"hand.{side}.length"] for side, _ in SIDES)
    system = ContactSystem(
        Mechanics(numbers),
        (float(pair[0]), float(pair[1])),
        height,
        method=method,
        rtol=rtol,
        length=length,
        driven=driven,
    )
    start, begin = start_state(scene)
    inputs = (DrivenInputs if driven else Inputs)(scene, begin, begin + float(scene.duration))
    instants, wanted = inputs.instants(times)
    walk = Walk(system, inputs, start)
    rows = walk.through(sorted(set(wanted)))
    kept = [rows[t] for t in wanted if t in rows]
    book = {name: float(value) for name, value in walk.ledger.items()}
    return UnilateralReference(
        t=instants[[t in rows for t in wanted]],
        q=np.array([row.q for row in kept]),
        p=np.array([row.p for row in kept]),
        multipliers=np.array([row.multipliers for row in kept]),
        modes=[row.modes for row in kept],
        integral=np.array([row.integral for row in kept]),
        changes=walk.changes,
        ledger=book,
        status=walk.status,
        end=walk.last,
        worst={name: float(value) for name, value in system.worst.items()},
        exchanged=sum(abs(v) for name, v in book.items() if name not in ("start", "end")),
    )
