"""`simulate`, which computes one run of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from ..scene import Scene, Stabilization, usual
from ..support import Formulation, Method, Recordable, StabilityWarning, Violation, checks, warn
from .error_estimate import QUANTITIES, estimate
from .options import STOP_ON, Options
from .request import Request
from .run import Run
from .sensitivity import SensitivityState, differentiated
from .sensitivity import checked as checked_paths
from .stiffness import needs_a_look, too_long, unstable


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
            "off_face" and "opened". `Run.violations` reports all of them. In unilateral contact a
            run ends with the step in which a tip slipped or opened.
        tolerance: Instead of `dt`, for "dop853", "radau5" and "rosenbrock": the largest error of a
            step, with each state scaled by its largest magnitude so far; from 1e-14 to below 1. The
            error of the whole run is of the same order if the motion damps perturbations, and
            larger otherwise.
        times: Instants to record instead of the ends of steps, (n,), s, increasing, on the clock of
            `scene`'s start. They change no step. With `dt` each takes a shorter step of the method,
            and so has its order; with `tolerance` values come from the method's interpolating
            polynomial, of order 7 for "dop853" and 3 for the other two.
        max_steps: With `tolerance`: the largest number of attempted steps, by default 10 million,
            which take some ten seconds. A run that needs more ends with status "too_many_steps".
        summaries_after: `Run.holds` ignores pulling and slipping before this instant, s on the
            clock of `scene`'s start, as after a start without compression; None ignores nothing.
        estimate_error: Whether to compute the run also with half and a quarter of each of its
            steps, which takes six times the work or somewhat more, for `Run.error_estimate`. Ctrl-C
            during this work returns the complete run, and an estimate with `interrupted`.
        sensitivities: Paths of numbers, pairs or arrays of the scene, as in `vary` of
            `monte_carlo`, for `Run.sensitivity`. Up to eight numbers make the call six to fourteen
            times as long (docs/derivatives.md). `Sensitivity.at` of another run continues that
            run's derivatives. Not with a `SampledController`; in unilateral contact without the
            energy. Ctrl-C during this work raises.

    Returns:
        The run. A run that fails numerically or physically is also a result; see its status.

    Raises:
        ValueError: The fingertips do not reach the object at the start, the start violates the
            constraints, or an argument breaks its rule.

    Warns:
        StabilityWarning: `alpha` or `beta` times `dt` is so large that the method does not damp
            constraint errors; or `dt` was too long for an explicit method to be stable, where the
            warning has the longest stable step; or the run failed, and the loop of its
            `SampledController` is unstable, where it has the loop's spectral radius.
        SuspiciousValueWarning: A number is far from usual, or a tip beyond its `MeasuredLaw`.
    """
    checks.instance("scene", scene, Scene)
    how = (dt, method, formulation, stabilization, record, every, stop_on)
    options = Options.checked(*how, tolerance, times, max_steps, summaries_after)
    estimable = set(options.record) & set(QUANTITIES.values())
    if checks.boolean("estimate_error", estimate_error) and not estimable:
        rule = "needs 'state' or 'multipliers' in record"
        raise ValueError(f"estimate_error with record={options.record}: {rule}")
    request = Request(scene, options)
    wanted = checked_paths(request, sensitivities)
    usual.warn(scene)
    result = request.compute()
    warn_of_steps(request, result)
    usual.warn_beyond(scene, result)
    stopped = result["status"] == "interrupted"
    error = estimate(request, result) if estimate_error and not stopped else None
    stopped |= error is not None and error.interrupted
    slopes = None if stopped else differentiated(request, result["t"], wanted)
    return Run(scene, options, result, error, slopes)


def warn_of_steps(request: Request, result: Mapping[str, Any]) -> None:
    """Warns of a run whose steps were too long or whose sampled loop is unstable."""
    for text in faults_of_steps(request, result):
        warn(text, StabilityWarning)


def faults_of_steps(request: Request, result: Mapping[str, Any]) -> list[str]:
    """Says whether the steps of a run were too long or its sampled loop is unstable."""
    status, end = result["status"], float(result["t"][-1])
    texts = list(result["warnings"])
    looks = needs_a_look(result["step_to_stable_one"], request.scene, result["violations"])
    try:
        if not texts and (status != "completed" or looks):
            texts.append(too_long(request, status, end))
        if texts == [None] and status != "completed":
            texts = [unstable(request, status, end)]
    except KeyboardInterrupt:  # the run itself is complete
        texts = []
    if status == "unstable" and not any(texts):
        texts = [result["message"]]
    return [text for text in texts if text]
