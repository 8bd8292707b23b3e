"""One run of a scene."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from . import _core, _record
from .run import Options, Run
from .scene import Scene, Stabilization

# More steps than any run takes; it fits the core's integers.
_NEVER = 2**62


class StabilityWarning(UserWarning):
    """The step is beyond what the method damps; the message has what would do."""


def names(field: str, value: str | Sequence[str], allowed: Sequence[str]) -> tuple[str, ...]:
    """One name or several, each out of `allowed`, without repeats.

    Raises:
        ValueError: A name is unknown; the message has the closest and all that are allowed.
        TypeError: It is no text and no sequence of texts.
    """
    given = (value,) if isinstance(value, str) else value
    if not isinstance(given, Sequence | set | frozenset):
        raise TypeError(f"{field} = {value!r}: must be names out of {_record.quoted(allowed)}")
    found = {_record.choice(field, name, allowed) for name in given}
    return tuple(name for name in allowed if name in found)


def simulate(
    scene: Scene,
    dt: float = 1e-4,
    method: str = "rk4",
    formulation: str = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: str | Sequence[str] = ("state",),
    every: int = 1,
    stop_on: str | Sequence[str] = ("separated", "crushed", "folded"),
) -> Run:
    """Simulates a scene from its start over its duration.

    Integration goes segment by segment between the instants at which an input jumps or kinks, in
    equal steps of at most `dt`, so that every step ends on each of them. Ctrl-C gives the run so
    far, with status "interrupted".

    Args:
        scene: What to simulate.
        dt: Longest step, s.
        method: How time is stepped: `_core.METHODS`.
        formulation: How the constraints are kept: "csm" is (24).
        stabilization: The gains of (19) and (20).
        record: What to keep out of "state", "multipliers", "residuals", "energy".
        every: Every how many steps; the last instant is always kept.
        stop_on: Which violations end the run, out of "separated", "crushed", "folded". All are
            noted in any case.

    Returns:
        The run. One that fails numerically or physically is a result with a status too.

    Raises:
        ValueError: An argument breaks its rule, the fingertips do not reach the object at the
            start, or the start is off the constraints.
        TypeError: An argument is of the wrong kind.

    Warns:
        StabilityWarning: `dt` is beyond what the method damps.
    """
    _record.instance("scene", scene, Scene)
    _record.instance("stabilization", stabilization, Stabilization)
    options = Options(
        dt=_record.positive("dt", dt),
        method=_record.choice("method", method, _core.METHODS),
        formulation=_record.choice("formulation", formulation, _core.FORMULATIONS),
        stabilization=stabilization,
        record=names("record", record, _core.RECORDABLE),
        every=_record.integer("every", every, 1),
        stop_on=names("stop_on", stop_on, _core.STOPPABLE),
    )
    start = scene.start()
    result = _core.simulate(
        scene.parameters(),
        scene.inputs(),
        time=start.time,
        q=start.q,
        p=start.p,
        integral=np.array(start.integral),
        grid=start.grid,
        check=start.check,
        duration=scene.duration,
        dt=options.dt,
        every=min(options.every, _NEVER),
        method=options.method,
        formulation=options.formulation,
        alpha=options.stabilization.alpha,
        beta=options.stabilization.beta,
        record=list(options.record),
        stop_on=list(options.stop_on),
    )
    for text in result["warnings"]:
        warnings.warn(text, StabilityWarning, stacklevel=2)
    return Run(scene, options, result)
