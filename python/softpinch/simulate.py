"""One run of a scene."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from . import _core, _record
from .run import Options, Run
from .scene import Scene, Stabilization

DT = 1e-4
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
    try:
        return _names(field, tuple(given), tuple(allowed))
    except TypeError:  # not hashable, so no name: the check says which
        return _names.__wrapped__(field, tuple(given), tuple(allowed))


# A run of a fraction of a millisecond should not spend a part of it on the same few names.
@lru_cache(maxsize=64)
def _names(field: str, given: tuple[str, ...], allowed: tuple[str, ...]) -> tuple[str, ...]:
    found = {_record.choice(field, name, allowed) for name in given}
    return tuple(name for name in allowed if name in found)


def steps(
    dt: float | None, tolerance: float | None, times: ArrayLike | None, method: str, every: int
) -> tuple[float | None, float | None, _record.Floats | None]:
    """The three that say how long steps are, checked; `dt` takes its default."""
    if tolerance is None:
        if times is not None:
            raise ValueError("times goes with tolerance, not with dt: every keeps rows of a grid")
        return _record.positive("dt", DT if dt is None else dt), None, None
    if dt is not None:
        raise ValueError(f"dt = {dt} and tolerance = {tolerance}: give one of them")
    if method not in _core.ADAPTIVE_METHODS:
        raise ValueError(
            f"method = {method!r} has no error estimate: tolerance goes with "
            f"{_record.quoted(_core.ADAPTIVE_METHODS)}"
        )
    tolerance = _record.number("tolerance", tolerance)
    if times is None:
        return None, tolerance, None
    if every != 1:
        raise ValueError(f"every = {every} and times: give one of them")
    return None, tolerance, _record.times("times", times)


def simulate(
    scene: Scene,
    dt: float | None = None,
    method: str = "rk4",
    formulation: str = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: str | Sequence[str] = ("state",),
    every: int = 1,
    stop_on: str | Sequence[str] = ("separated", "crushed", "folded"),
    *,
    tolerance: float | None = None,
    times: ArrayLike | None = None,
) -> Run:
    """Simulates a scene from its start over its duration.

    Integration goes segment by segment between the instants at which an input jumps or kinks, in
    equal steps of at most `dt`, or in steps whose estimated error stays below `tolerance`; so every
    step ends on each of them. Ctrl-C gives the run so far, with status "interrupted".

    Args:
        scene: What to simulate.
        dt: Longest step, s; 1e-4 where neither it nor `tolerance` is given.
        method: How time is stepped: "rk4", "dop853" (explicit), "implicit_midpoint", "radau5",
            "rosenbrock" (for stiff scenes); docs/integrators.md says which to take when.
        formulation: How the constraints are kept: "csm" is (24), "nullspace" and "projected" have
            no drift.
        stabilization: The gains of (19) and (20), for "csm".
        record: What to keep out of "state", "multipliers", "residuals", "energy".
        every: Every how many steps; the last instant is always kept.
        stop_on: Which violations end the run, out of "separated", "crushed", "folded". All are
            noted in any case.
        tolerance: Instead of `dt`, for "dop853", "radau5" and "rosenbrock": the largest error of a
            step, each state's against its own largest size so far. From 1e-14 to below 1; the
            error of the whole run is of its order where the motion forgets, more where it does not.
        times: With `tolerance`: instants to keep instead of the ends of steps, (n,), s, increasing,
            on the clock of `scene`'s start. They lie on the method's own polynomial between steps:
            of order 7 for "dop853", 3 for the other two.

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
    method = _record.choice("method", method, _core.METHODS)
    every = _record.integer("every", every, 1)
    dt, tolerance, asked = steps(dt, tolerance, times, method, every)
    options = Options(
        dt=dt,
        tolerance=tolerance,
        times=asked,
        method=method,
        formulation=_record.choice("formulation", formulation, _core.FORMULATIONS),
        stabilization=stabilization,
        record=names("record", record, _core.RECORDABLE),
        every=every,
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
        linearized=start.linearized,
        check=start.check,
        duration=scene.duration,
        dt=options.dt,
        tolerance=options.tolerance,
        times=options.times,
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
