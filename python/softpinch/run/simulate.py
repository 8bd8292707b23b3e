"""One run of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..scene import usual
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.errors import StabilityWarning, warn
from . import scaled_error
from .error_estimate import QUANTITIES, estimate, interrupted
from .options import MOST_STEPS, STOP_ON, Options
from .run import Run


def simulate(
    scene: Scene,
    dt: float | None = None,
    method: str = "rk4",
    formulation: str = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: str | Sequence[str] = ("state",),
    every: int = 1,
    stop_on: str | Sequence[str] = STOP_ON,
    *,
    tolerance: float | None = None,
    times: ArrayLike | None = None,
    max_steps: int | None = None,
    estimate_error: bool = False,
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
        record: What to keep out of "state", "multipliers", "residuals", "energy", "torque".
        every: Every how many steps; the last instant is always kept.
        stop_on: Which violations end the run, out of "separated", "crushed", "folded". All are
            noted in any case.
        tolerance: Instead of `dt`, for "dop853", "radau5" and "rosenbrock": the largest error of a
            step, each state's against its own largest size so far. From 1e-14 to below 1; the
            error of the whole run is of its order where the motion forgets, more where it does not.
        times: With `tolerance`: instants to keep instead of the ends of steps, (n,), s, increasing,
            on the clock of `scene`'s start. They lie on the method's own polynomial between steps:
            of order 7 for "dop853", 3 for the other two.
        max_steps: With `tolerance`: most attempted steps; 10 million, some ten seconds, if left
            out. A run that needs more ends with status "too_many_steps".
        estimate_error: With `dt`: runs it again with each step halved, and halved once more, six
            times the work of the run itself, and says in `Run.error_estimate` how wrong the
            recorded states and multipliers are. Ctrl-C meanwhile gives the run, which is whole,
            with the status that it has, and an estimate with `interrupted`.

    Returns:
        The run. One that fails numerically or physically is a result with a status too.

    Raises:
        ValueError: An argument breaks its rule, the fingertips do not reach the object at the
            start, or the start is off the constraints.
        TypeError: An argument is of the wrong kind.

    Warns:
        StabilityWarning: `dt` is beyond what the method damps.
        SuspiciousValueWarning: A number of the scene is far from what is usual.
    """
    checks.instance("scene", scene, Scene)
    options = Options.checked(
        dt=dt,
        method=method,
        formulation=formulation,
        stabilization=stabilization,
        record=record,
        every=every,
        stop_on=stop_on,
        tolerance=tolerance,
        times=times,
        max_steps=max_steps,
    )
    if checks.boolean("estimate_error", estimate_error):
        _require_estimable(options)
    usual.warn(scene)
    result = compute(scene, options)
    for text in result["warnings"]:
        warn(text, StabilityWarning)
    error = None
    if estimate_error and result["status"] != "interrupted":
        again = partial(whole, scene, replace(options, record=_estimated(options.record)))
        try:
            error = estimate(result, again, method, options.record, scaled_error.usual(scene))
        except KeyboardInterrupt:  # the run itself is whole
            error = interrupted(result, method, options.record)
    return Run(scene, options, result, error)


def described(
    scene: Scene, options: Options, refine: int = 1, summaries: Sequence[str] = ()
) -> _core.Simulation:
    """A run as the core takes it, with each step cut into `refine`."""
    start = scene.start()
    return _core.Simulation(
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
        every=min(refine * options.every, MOST_STEPS),
        max_steps=options.max_steps,
        refine=refine,
        method=options.method,
        formulation=options.formulation,
        alpha=options.stabilization.alpha,
        beta=options.stabilization.beta,
        record=options.record,
        summaries=summaries,
        stop_on=options.stop_on,
    )


def compute(scene: Scene, options: Options, refine: int = 1) -> Mapping[str, Any]:
    """What the core says of a run, with each step cut into `refine`; the same rows are recorded."""
    result: Mapping[str, Any] = described(scene, options, refine).run()
    return result


def whole(scene: Scene, options: Options, refine: int = 1) -> Mapping[str, Any]:
    """The same, but Ctrl-C is no result.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    result = compute(scene, options, refine)
    if result["status"] == "interrupted":
        raise KeyboardInterrupt
    return result


def not_interrupted(run: Run) -> Run:
    """Passes Ctrl-C on, which `simulate` makes a status, and others would read as a failure.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    if run.status == "interrupted":
        raise KeyboardInterrupt
    return run


def _estimated(record: tuple[str, ...]) -> tuple[str, ...]:
    """Of what is recorded, what has an error that can be estimated."""
    return tuple(kind for kind in record if kind in QUANTITIES.values())


def _require_estimable(options: Options) -> None:
    if options.tolerance is not None:
        raise ValueError(
            f"estimate_error goes with dt, not with tolerance = {options.tolerance}: steps that "
            "the error chose cannot be halved"
        )
    if not _estimated(options.record):
        raise ValueError(
            f"estimate_error with record={options.record}: needs 'state' or 'multipliers' in record"
        )
