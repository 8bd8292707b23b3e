"""`simulate`, which computes one run of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from ..support.choices import Formulation, Method, Recordable, Violation
from ..support.errors import StabilityWarning, warn
from . import scaled_error
from .error_estimate import QUANTITIES, estimate, interrupted
from .options import MOST_STEPS, STOP_ON, Options
from .own_steps import on_steps, recorded
from .run import Run
from .sampled_loop import unstable
from .sensitivity import SensitivityState, differentiated
from .sensitivity import checked as checked_paths
from .stiffness import too_long


def simulate(
    scene: Scene,
    dt: float | None = None,
    method: Method = "rk4",
    formulation: Formulation = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: Recordable | Sequence[Recordable] = ("state",),
    every: int = 1,
    stop_on: Violation | Sequence[Violation] = STOP_ON,
    *,
    tolerance: float | None = None,
    times: ArrayLike | None = None,
    max_steps: int | None = None,
    summaries_after: float | None = None,
    estimate_error: bool = False,
    sensitivities: str | Sequence[str] | SensitivityState = (),
) -> Run:
    """Simulates a scene from its start over its duration.

    The duration is divided into segments at the instants at which an input jumps or kinks, and a
    step ends at each of these instants. Within a segment, steps are equal and at most `dt` long, or
    their estimated error stays below `tolerance`. Ctrl-C returns the run so far, with status
    "interrupted".

    Args:
        scene: The scene to simulate.
        dt: Longest step, s; 1e-4 if neither `dt` nor `tolerance` is given.
        method: The integration method: "rk4" and "dop853" are explicit; "implicit_midpoint",
            "radau5" and "rosenbrock" are for stiff scenes. docs/integrators.md says how to choose.
        formulation: How the constraints are enforced: "csm" is (24), with some drift off the
            constraints; "nullspace" and "projected" have no drift. "nullspace" is for bilateral
            contact only.
        stabilization: The gains of (19) and (20), for "csm".
        record: Groups of quantities to record: "state", "multipliers", "residuals", "energy",
            "torque", "contact".
        every: Number of steps between recorded rows; the last instant is always recorded.
        stop_on: The violations that end the run, with a status of the same name: any of
            "separated", "crushed", "folded", which are the default, "pulling", "slipping", "rim",
            "off_face" and "opened". All are looked for at ends of steps, and reported in
            `Run.violations` in any case. In unilateral contact a run ends with the step in which a
            tip slipped or opened, even if it sticks again by then. No tip opens in bilateral
            contact, where it pulls instead, and no tip pulls in unilateral contact.
        tolerance: Instead of `dt`, for "dop853", "radau5" and "rosenbrock": the largest error of a
            step, with each state scaled by its largest magnitude so far; from 1e-14 to below 1. The
            error of the whole run is of the same order if the motion damps perturbations, and
            larger otherwise.
        times: With `tolerance`: instants to record instead of the ends of steps, (n,), s,
            increasing, on the clock of `scene`'s start. Values come from the method's interpolating
            polynomial, of order 7 for "dop853" and 3 for the other two.
        max_steps: With `tolerance`: the largest number of attempted steps, by default 10 million,
            which take some ten seconds. A run that needs more ends with status "too_many_steps".
        summaries_after: `Run.holds` ignores pulling and slipping before this instant, s on the
            clock of `scene`'s start; None ignores nothing. A start without compression and a jump
            of the targets pull or slip for a moment in nearly every grasp.
        estimate_error: Whether to compute the run also with half and a quarter of each of its
            steps, which takes six times the work of the run itself or somewhat more, and to put the
            estimated error of the recorded states and multipliers into `Run.error_estimate`. Ctrl-C
            during this work returns the complete run with its own status, and an estimate with
            `interrupted`.
        sensitivities: Paths of numbers, pairs or arrays of the scene, such as
            "hand.tip.youngs_modulus", "initial.q" or "schedule.angles" (those of `vary` in
            `monte_carlo`): the derivatives of the recorded rows by them are in `Run.sensitivity`.
            Up to eight numbers make the call six to fourteen times as long, depending on the method
            (docs/derivatives.md). `Sensitivity.at` of another run continues that run's derivatives.
            For bilateral contact without a `SampledController`. Ctrl-C during this work raises.

    Returns:
        The run. A run that fails numerically or physically is also a result; see its status.

    Raises:
        ValueError: An argument breaks its rule, the fingertips do not reach the object at the
            start, or the start violates the constraints.
        TypeError: An argument has the wrong type.

    Warns:
        StabilityWarning: `alpha` or `beta` times `dt` is so large that the method does not damp
            constraint errors; or the run failed, and `dt` was too long for an explicit method to be
            stable, where the warning has the longest stable step; or the run failed, and the loop
            of its `SampledController` is unstable, where it has the loop's spectral radius.
        SuspiciousValueWarning: A number of the scene is far from its usual range.
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
        summaries_after=summaries_after,
    )
    if checks.boolean("estimate_error", estimate_error):
        _require_estimable(options)
    wanted = checked_paths(scene, sensitivities)
    usual.warn(scene)
    result = compute(scene, options)
    advice = result["warnings"] or failed_by(scene, options, result)
    for text in advice:
        warn(text, StabilityWarning)
    error = None
    if estimate_error and result["status"] != "interrupted":
        adaptive = options.tolerance is not None
        try:
            again = refined(scene, options, result)
            usually = scaled_error.usual(scene)
            error = estimate(result, again, method, options.record, usually, adaptive=adaptive)
        except KeyboardInterrupt:  # the run itself is complete
            error = interrupted(result, method, options.record, adaptive)
    slopes = None
    stopped = result["status"] == "interrupted" or (error is not None and error.interrupted)
    if wanted[0] and not stopped:
        slopes = differentiated(scene, described(scene, options), result["t"], wanted, options)
    return Run(scene, options, result, error, slopes)


def described(
    scene: Scene, options: Options, refine: int = 1, summaries: Sequence[str] = ()
) -> _core.Simulation:
    """Makes the core's description of a run, with each step divided into `refine` steps."""
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
        contacts=start.contact,
        controller=start.controller,
        contact=scene.contact,
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
        after=-np.inf if options.summaries_after is None else options.summaries_after,
        stop_on=options.stop_on,
    )


def compute(scene: Scene, options: Options, refine: int = 1) -> Mapping[str, Any]:
    """Computes a run with each step divided into `refine` steps; recorded instants do not vary."""
    result: Mapping[str, Any] = described(scene, options, refine).run()
    return result


def whole(scene: Scene, options: Options, refine: int = 1) -> Mapping[str, Any]:
    """Computes a run as `compute` does, but Ctrl-C raises instead of giving a partial result.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    result = compute(scene, options, refine)
    if result["status"] == "interrupted":
        raise KeyboardInterrupt
    return result


def refined(
    scene: Scene, options: Options, result: Mapping[str, Any]
) -> Callable[[int], Mapping[str, Any]]:
    """Returns a function that computes a run with each step divided, as `estimate` needs it.

    Adaptive steps are known by the rows of the run if it recorded every step; otherwise they come
    from another run, which records nothing else.

    Args:
        scene: The scene.
        options: The options of the run.
        result: The core's result of the run.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    options = replace(options, record=_estimated(options.record))
    if options.tolerance is None:
        return partial(whole, scene, options)
    t = result["t"]
    if options.times is not None or options.every != 1:
        ends = whole(scene, replace(options, record=(), times=None, every=1))["t"]
        t = np.union1d(t, ends)
    if len(t) < 2:
        return lambda refine: result
    finer, how = on_steps(scene, options, t)
    return lambda refine: recorded(whole(finer, how, refine), result["t"])


def failed_by(scene: Scene, options: Options, result: Mapping[str, Any]) -> list[str]:
    """Returns the warning of a run that failed by its steps or by its sampled loop, or nothing.

    Ctrl-C during this work leaves it out, because the run itself is complete.
    """
    try:
        ended = result["status"], float(result["t"][-1])
        text = too_long(scene, options, ended, whole) or unstable(scene, options, ended, whole)
    except KeyboardInterrupt:
        return []
    return [] if text is None else [text]


def not_interrupted(run: Run) -> Run:
    """Returns the run, unless Ctrl-C ended it.

    `simulate` reports Ctrl-C as a status, which callers could mistake for a failed run.

    Raises:
        KeyboardInterrupt: The run's status is "interrupted".
    """
    if run.status == "interrupted":
        raise KeyboardInterrupt
    return run


def _estimated(record: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the entries of `record` whose errors can be estimated."""
    return tuple(kind for kind in record if kind in QUANTITIES.values())


def _require_estimable(options: Options) -> None:
    if not _estimated(options.record):
        raise ValueError(
            f"estimate_error with record={options.record}: needs 'state' or 'multipliers' in record"
        )
