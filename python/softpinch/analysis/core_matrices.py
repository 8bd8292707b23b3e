"""The matrices of the linearised motion: their one call of the core, and their neutral states."""

from __future__ import annotations

import numpy as np

from .. import _core
from ..scene.scene import Scene, State
from ..scene.stabilization import Stabilization
from ..support.arrays import Floats
from .states import places


def along(
    scene: Scene,
    t: Floats,
    q: Floats,
    p: Floats,
    integral: Floats,
    formulation: str,
    stabilization: Stabilization,
) -> Floats:
    """Returns A of the states of a formulation at n checked states (n, N, N)."""
    return _matrices(scene, scene.inputs(), (t, q, p, integral), formulation, stabilization)["A"]


def at(
    scene: Scene,
    state: State,
    inputs: _core.Inputs | None = None,
    *,
    whole: bool = False,
    open_loop: bool = False,
    frozen: bool = False,
) -> _core._Linear:
    """Returns the matrices of "nullspace" at one checked state, each with a first axis of one.

    Args:
        scene: The scene.
        state: The state.
        inputs: The inputs, instead of the scene's own.
        whole: Whether to compute more than A.
        open_loop: Whether torques turn the fingers, instead of the scene's law.
        frozen: Whether the inputs of the instant hold, as at an equilibrium.
    """
    inputs = scene.inputs() if inputs is None else inputs
    rows = np.array([state.time]), state.q[None], state.p[None], np.array([state.integral])
    return _matrices(scene, inputs, rows, whole=whole, open_loop=open_loop, frozen=frozen)


def _matrices(
    scene: Scene,
    inputs: _core.Inputs,
    rows: tuple[Floats, Floats, Floats, Floats],
    formulation: str = "nullspace",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    *,
    whole: bool = False,
    open_loop: bool = False,
    frozen: bool = False,
) -> _core._Linear:
    return _core.linearize(
        scene.parameters(),
        inputs,
        *rows,
        formulation,
        stabilization.alpha,
        stabilization.beta,
        whole=whole,
        open_loop=open_loop,
        frozen=frozen,
    )


def shears_by_pose(a: Floats, names: tuple[str, ...]) -> Floats:
    """Returns how the shears follow pose and fingers at rest, -Phi_N of (25).

    Args:
        a: A of "nullspace" (N, N), in which the shears' rates are -Phi_N times those of the pose.
        names: Names of its states.

    Returns:
        The derivatives of both shears by the pose and, unless they are driven, the fingers (2, d).
    """
    _, rates, shears = places(names)
    return a[shears, rates]


def without_shears(rows: Floats, by_pose: Floats, names: tuple[str, ...]) -> Floats:
    """Returns rows of A or C by the states without the shears, which follow the pose at rest.

    No motion changes d_t + Phi_N pose: these two combinations are neutral, and where they are zero
    the other states have all eigenvalues but their two zeros.

    Args:
        rows: Derivatives by all states of "nullspace" (k, N).
        by_pose: The result of `shears_by_pose`.
        names: Names of the states.

    Returns:
        The derivatives by the states that `kept` lists (k, N - 2).
    """
    pose, _, shears = places(names)
    rows = rows.copy()
    rows[:, pose] += rows[:, shears] @ by_pose
    return rows[:, kept(names)]


def kept(names: tuple[str, ...]) -> list[int]:
    """Returns the indices of the states that are no shears."""
    shears = places(names)[2]
    return [*range(shears.start), *range(shears.stop, len(names))]
