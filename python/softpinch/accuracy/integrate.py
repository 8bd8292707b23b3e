"""A scene as a problem for SciPy: parameters, start, wanted instants, sizes and stiffness."""

from __future__ import annotations

import cmath
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..scene.contact import require_bilateral
from ..scene.control import WRITTEN
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats
from .driven import Driven, Inputs
from .null_space import PLAIN, STATES, jump, parameters, right_hand_side
from .walker import System, Walker

_ROWS = right_hand_side(np.sin, np.cos)
_COMPLEX = right_hand_side(cmath.sin, cmath.cos)
# Derivatives take a step along the imaginary axis. Nothing is subtracted, so it may be tiny.
_STEP = 1e-100
_METRES = np.array([1, 1, 0, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 0], dtype=bool)
# A state that is zero by symmetry has the round-off of other states. So the size of a state is at
# least this share of the largest size of its kind (a radian counts as a finger's length). The share
# for rates keeps tolerances above round-off, which implicit methods would take for stiffness.
# Coordinates get less of that round-off: a step's length times that of the rates.
_KINDS = ((slice(0, 7), 1e-3), (slice(7, 9), 1e-3), (slice(9, 14), 1.0))
# Tolerances of the rough pass; the second is used if the motion diverges with the first.
_ROUGH = (1e-6, 1e-9)
# The stiffness is evaluated at this many states of the rough pass.
_PROBES = 64
# DOP853's stability region reaches to about -6, and a step takes 12 evaluations.
_EVALUATIONS_OF_STIFFNESS = 2.0


class Rough(NamedTuple):
    """Results of a rough pass.

    Attributes:
        sizes: Largest size of each state along the run (14,), for absolute tolerances.
        explicit: Approximate number of evaluations that DOP853 needs for stability: 12 a step, with
            the longest steps that the largest eigenvalue allows.
        evaluations: Number of evaluations of the rough pass itself.
    """

    sizes: Floats
    explicit: float
    evaluations: int


# The size of a state is at least this share of its typical size: the rates of a body at rest have
# the round-off of the forces on it, and no tolerance below that can be met.
_AT_REST = 1e-2


class Problem:
    """A scene as a problem for SciPy: its parameters, inputs, start and wanted instants.

    Attributes:
        scene: The scene.
        c: The parameters (35,).
        rates: Function (y, c, u) of tuples -> the rates of y.
        y: The states at the start (14,).
        inputs: The inputs of the run.
        t: The wanted instants (n,), s.
        wanted: The wanted instants (n,), s; those within round-off of an edge of the inputs are
            moved onto it.
    """

    def __init__(
        self,
        scene: Scene,
        times: ArrayLike | None,
        tolerance: float,
        rates: Callable[..., Any] | None = None,
    ) -> None:
        """Checks the arguments, which are those of `reference.solve`, and raises its errors."""
        checks.instance("scene", scene, Scene)
        require_bilateral(scene, "the reference", "has the equations of bilateral contact only")
        if scene.law != "pid":
            given = WRITTEN[scene.law]
            raise ValueError(f"Scene.{given}: the reference has the equations of a PID only")
        if rates is not None:
            checks.function("rates", rates)
        self.scene = scene
        self.c, self.rates = parameters(scene), rates or PLAIN.rates
        self.y, begin = _start(scene, self.c, checks.positive("tolerance", tolerance))
        end = begin + scene.duration
        if not end > begin:
            raise ValueError(
                f"Scene.duration = {scene.duration}: too short, it ends no later than it starts"
            )
        self.inputs = Inputs(scene, begin, end)
        self.t, self.wanted = self.inputs.instants(times)

    def walker(self, method: str, rtol: float, sizes: Floats, most: int) -> Walker:
        """The walker that integrates the run with one method; the arguments are `Walker`'s."""
        c, rates = self.c, self.rates
        system = System(
            rates=lambda y, u: rates(y, c, u),
            jump=lambda y, impulse: np.array(jump(y.tolist(), c, impulse)),
            jacobian=self.jacobian,
        )
        return Walker(system, self.inputs, self.y, method=method, rtol=rtol, sizes=sizes, most=most)

    def rough(self, most: int) -> Rough:
        """Integrates the run roughly, to find the states' sizes and the stiffness.

        Args:
            most: Largest number of evaluations.
        """
        known = np.where(_METRES, max(self.c[0], self.c[15]), 1.0)
        evaluations = 0
        for rtol in _ROUGH:
            walker, path = self.walker("LSODA", rtol, known, most), []
            try:
                for at in walker.walk(()):
                    path.append(at)
            except RuntimeError:
                # With a loose tolerance a grasp that holds may be lost.
                continue
            finally:
                evaluations += walker.evaluations
            return self._read(path, known, evaluations)
        # The motion diverges, which the accurate integration reports. Sizes are of no use then.
        return Rough(known, 0.0, evaluations)

    def _read(
        self, path: list[tuple[float, Floats, Driven]], known: Floats, evaluations: int
    ) -> Rough:
        sizes = np.abs([y for _, y, _ in path]).max(axis=0)
        for kind, least in _KINDS:
            # If all states of a kind are at rest, their round-off is not a size.
            largest = max((sizes[kind] / known[kind]).max(), _AT_REST)
            sizes[kind] = np.maximum(sizes[kind], least * largest * known[kind])
        stiffness = 0.0
        for k, following in pairwise(np.unique(np.linspace(0, len(path) - 1, _PROBES).astype(int))):
            t, y, driven = path[k]
            jacobian = self.jacobian(y, driven(t))
            if np.isfinite(jacobian).all():
                fastest = np.abs(np.linalg.eigvals(jacobian)).max()
                stiffness += float(fastest * (path[following][0] - t))
        return Rough(sizes, _EVALUATIONS_OF_STIFFNESS * stiffness, evaluations)

    def jacobian(self, y: Floats, u: tuple[float, ...]) -> Floats:
        """The derivatives of the rates (14, 14), exact except for round-off."""
        columns = []
        for k in range(STATES):
            moved: list[complex] = y.tolist()
            moved[k] += 1j * _STEP
            columns.append([complex(rate).imag for rate in _COMPLEX.rates(moved, self.c, u)])
        return np.array(columns).T / _STEP

    def rows(self, y: Floats, u: Floats) -> dict[str, Floats]:
        """q (n, 9), p (n, 9), multipliers (n, 4) and integral (n, 2) of states and inputs."""
        states = list(y.T)
        d_n1, d_n2, *tips = _ROWS.followers(states, self.c)
        return {
            "q": np.stack([*states[:5], d_n1, d_n2, *states[5:7]], axis=1),
            "p": np.stack([*states[9:], *tips], axis=1),
            "multipliers": np.stack(_ROWS.multipliers(states, self.c, u.T), axis=1),
            "integral": y[:, 7:9].copy(),
        }


def _start(scene: Scene, c: tuple[float, ...], tolerance: float) -> tuple[Floats, float]:
    """The fourteen states at the start, and the time of the start, s.

    Raises:
        ValueError: The start is off the constraints, which these equations cannot represent.
    """
    start = scene.start()
    y = np.array([*start.q[:5], *start.q[7:], *start.integral, *start.p[:5]])
    d_n1, d_n2, *tips = PLAIN.followers(y.tolist(), c)
    # Typical sizes of the terms in C^H and C^N.
    length = float(np.abs([*start.q[:2], *c[:3], c[5], *c[15:18], c[20], c[30], c[33]]).sum())
    speed = float(np.abs(start.p[[0, 1, 5, 6, 7, 8]]).sum() + length * np.abs(start.p[2:5]).sum())
    gaps = (
        ("C^H = 0 (9)", "m", np.abs(start.q[5:7] - (d_n1, d_n2)).max(), tolerance * length),
        ("Phi p = 0 (25)", "m/s", np.abs(start.p[5:] - tips).max(), tolerance * speed),
    )
    for equation, unit, gap, allowed in gaps:
        if gap > allowed:
            raise ValueError(
                f"Scene.initial: {gap:.3e} {unit} off {equation}; a reference needs a start on "
                f"the constraints, to {allowed:.3e} {unit}. State.consistent makes one"
            )
    return y, start.time
