"""`loop`: whether a `SampledController` holds a grasp at rest, and by which margins."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..run.stiffness import MEASURED
from ..scene.control import WRITTEN, SampledController, Torque
from ..scene.fields import RATE_UNITS
from ..scene.loop_matrix import MOST_UNDER_WAY, NEUTRAL, common_period, measured, spectral_radius
from ..scene.scene import Scene, State
from ..scene.schedule import Schedule
from ..support import checks
from ..support.result import Result
from .linearization import LinearModel, linearize
from .rest import Equilibrium, equilibrium
from .states import OUTPUTS

# Larger rates of coordinates, m/s and rad/s, are those of a state that moves.
_MOVES = np.where(np.array(RATE_UNITS) == "rad/s", 0.05, 1e-3)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Loop(Result):
    """The loop of a scene's `SampledController` and its grasp at rest, for small deviations.

    It is exact over the common period of all blocks. Limits, dead zones, resolution, noise, lost
    samples and jitter are left out.

    Attributes:
        period: The common period of the blocks, s.
        spectral_radius: The factor by which deviations decay in it in the end, or grow if above 1.
        gain_margin: The smallest factor above 1 of the block's outputs (its C and D) beyond which
            the loop is unstable; inf if there is none up to 1000, nan in an unstable loop.
        delay_margin: The delay, s, in addition to the block's, beyond which the loop is unstable;
            inf if there is none up to 20 of its periods, nan in an unstable loop.
    """

    period: float
    spectral_radius: float
    gain_margin: float
    delay_margin: float


def loop(scene: Scene, state: State | Equilibrium | None = None, block: int = -1) -> Loop:
    """Computes whether a `SampledController` holds a grasp at rest: its linear loop and margins.

    Args:
        scene: A scene with a `SampledController` whose blocks' periods have a common one. Delays
            take at most 50 periods of their block.
        state: Where the grasp rests: a state of its run that has settled, whose rates count as
            zero, or an `equilibrium` of the scene, also with another law. None finds the scene's.
            Two sets of gains: those of its time act; a measure that decides is refused.
        block: Place in the cascade of the block whose margins are computed; -1 is the last one.
    """
    checks.instance("scene", scene, Scene)
    control = scene.control
    if not isinstance(control, SampledController):
        raise ValueError(f"Scene.{WRITTEN[scene.law]}: loop needs a SampledController")
    count, (period, why) = len([*control.blocks()]), common_period(control)
    block = checks.integer("block", block, -count, count - 1)
    if why:
        raise ValueError(why)
    state = equilibrium(scene) if state is None else state
    model = _model(scene, state)
    blocks = [replace(own, outer=None) for _, own in control.gains_at(state.time).blocks()][::-1]
    own = blocks[block]

    def radius(**changes: object) -> float:
        blocks[block] = replace(own, **changes)  # type: ignore[arg-type]
        found = measured(control, MEASURED, model.C, model.D)
        return spectral_radius(SampledController.cascade(blocks), model.A, model.B, found)

    gains = {name: np.asarray(getattr(own, name)) for name in "CD"}
    step, most = 0.5 * own.period, int(2.0 * (MOST_UNDER_WAY - own.delay / own.period))
    return Loop(
        period=period,
        spectral_radius=radius(),
        gain_margin=1.1
        ** _first(lambda k: radius(**{n: 1.1**k * x for n, x in gains.items()}), 73),
        delay_margin=step * _first(lambda k: radius(delay=own.delay + k * step), min(40, most)),
    )


def _first(radius: Callable[[float], float], most: int) -> float:
    """The number of steps from which the radius shows an unstable loop."""
    high = next((k for k in range(most + 1) if not radius(k) < 1.0 + NEUTRAL), math.inf)
    if high in (0, math.inf):
        return math.inf if high else math.nan
    low = high - 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) < 1.0 + NEUTRAL else (low, middle)
    return low


def _model(scene: Scene, state: State | Equilibrium) -> LinearModel:
    """The motion with torques as inputs about the state, or about a rest."""
    modes = None
    if isinstance(state, State):
        if state.controller is None:
            raise ValueError("state.controller = None: must have the torques in force, as of a run")
        k = int(np.argmax(np.abs(state.p) / _MOVES))
        if abs(state.p[k]) > _MOVES[k]:
            rule = f"must have settled, with at most {_MOVES[k]:g} {RATE_UNITS[k]}"
            raise ValueError(f"state.p[{k}] = {state.p[k]:.4g} {RATE_UNITS[k]}: {rule}")
        torque = state.controller[3:5]
    else:
        checks.instance("state", state, Equilibrium, "a State, an Equilibrium or None")
        if state.state is None:
            raise ValueError(f"loop: {state.message}")
        torque, state = state.torque, state.state
        modes = ("stick", "stick") if scene.contact == "unilateral" else None
    held = replace(scene, control=Torque(), schedule=Schedule.steps([0.0], [torque]), initial=None)
    at = replace(state, p=np.zeros(9), controller=None, integral=(0.0, 0.0), linearized=None)
    return linearize(held, at, "torque", OUTPUTS, modes=modes, reduced=True)
