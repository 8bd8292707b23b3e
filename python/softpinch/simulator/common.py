"""What both simulators share: the checks of their arguments, states, and names of statuses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run.options import Options
from ..scene.control import WRITTEN
from ..scene.scene import Scene, State, require_fit
from ..scene.stabilization import Stabilization
from ..support import checks

# The name of a status's code in the core: a run that goes on, and then the ways to end.
STATUSES = ("running", *_core.STATUSES)

_Parts: TypeAlias = tuple[
    float,
    NDArray[np.float64],
    NDArray[np.float64],
    list[float],
    tuple[float, int] | None,
    NDArray[np.float64] | None,
]


def checked_options(
    scene: Scene,
    dt: float | None,
    method: str,
    formulation: str,
    stabilization: Stabilization,
    stop_on: str | Sequence[str],
) -> Options:
    """Checks a scene that is stepped from outside, and the options of its equal steps.

    Raises:
        ValueError: An argument breaks its rule, or the scene's fingers are driven.
        TypeError: An argument has the wrong type.
    """
    checks.instance("scene", scene, Scene)
    if scene.law not in ("torque", "pid"):
        raise ValueError(
            f"Scene.{WRITTEN[scene.law]}: a simulator needs control=Torque(), whose torques it "
            "sets, or a PID, whose target angles it sets"
        )
    return Options.checked(
        dt=dt,
        method=method,
        formulation=formulation,
        stabilization=stabilization,
        stop_on=stop_on,
    )


def state_of(parts: _Parts, formulation: str) -> State:
    """Makes the public state from the core's."""
    time, q, p, integral, grid, contact = parts
    # The stabilisation lets states drift off the constraints.
    check = formulation != "csm"
    right, left = integral
    return State(q, p, (right, left), time, check=check, grid=grid, contact=contact)


def parts_of(scene: Scene, name: str, state: State) -> tuple[Any, ...]:
    """Checks a state from which a scene is to go on, and returns it as the core takes it.

    Raises:
        TypeError: It is no `State`.
        ValueError: It has what the scene has not: contacts, or a controller's state.
    """
    checks.instance(name, state, State)
    require_fit(scene, name, state)
    return (
        state.time,
        np.asarray(state.q),
        np.asarray(state.p),
        state.integral,
        state.grid,
        state.contact,
        state.check,
    )


def refuse_copies(simulator: object) -> NoReturn:
    """Refuses to copy or pickle a simulator, whose state is in the core.

    A shallow copy would share that state with the original, but not the record of its steps.

    Raises:
        TypeError: Always.
    """
    raise TypeError(
        f"{type(simulator).__name__} cannot be copied or pickled: take its state() and give it to "
        "set_state() or reset() of another one"
    )


def checked_actions(actions: ArrayLike, n: int, each: str) -> NDArray[np.float64]:
    """Converts actions (n, 2) to a contiguous array; errors call one of the n an `each`.

    Raises:
        ValueError: The shape is wrong, or a number is not finite; the message has its number.
        TypeError: An entry is not a number.
    """
    given = checks.numbers("actions", actions)
    if given.shape != (n, 2):
        raise ValueError(f"actions have shape {given.shape}: must be ({n}, 2)")
    wrong = np.argwhere(~np.isfinite(given))
    if len(wrong):
        k, finger = wrong[0].tolist()
        raise ValueError(
            f"actions[{k}, {finger}] = {given[k, finger]}: must be finite ({each} {k})"
        )
    return np.ascontiguousarray(given, dtype=np.float64)
