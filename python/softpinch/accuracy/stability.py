"""Stability: linearisation of the motion along a run, and the longest stable step of a scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import _core
from ..run.contact import ContactMode
from ..run.options import MOST_STEPS
from ..run.run import Run
from ..run.simulate import not_interrupted, simulate
from ..run.stiffness import Complexes, stable_steps
from ..scene.contact import require_formulations, without_drift
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.choices import Formulation, Method
from ..support.result import Result
from .bisection import Bisection
from .linear_modes import along_run

# Tolerance of the trusted run, which stands for the exact motion.
_TRUSTED_TOLERANCE = 1e-8
# Statuses that are physical ends of the motion; all others mean that the integrator gave up.
ENDS = ("completed", "separated", "crushed", "folded", "lost")
# The trusted run may take at least this many steps, a fraction of a second of work, even if the
# runs of the bisection may take fewer.
_FEWEST_STEPS = 100_000
# Predicted and measured steps agree if they differ by less than this factor.
_AGREE = 1.1


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StableStep(Result):
    """The longest stable step for a scene, a formulation and a method.

    Attributes:
        method: How time is stepped.
        formulation: How the constraints are kept.
        predicted: Longest step by the eigenvalues along the run and the method's stability region,
            s; inf for a method that is stable for every step.
        t: The instant whose eigenvalues allow the shortest step, s.
        rate: The eigenvalue that limits the step there, 1/s.
        mode: Name of the state with the largest share in the mode of `rate`.
        measured: Longest step with which the run still ends correctly, to half a percent, s; inf if
            even a single step does; None if it was not measured.
        message: Both results in words, and the reason if they differ.
    """

    method: Method
    formulation: Formulation
    predicted: float
    t: float
    rate: complex
    mode: str
    measured: float | None
    message: str

    @property
    def dt(self) -> float:
        """The smaller of the predicted and the measured step, s."""
        return self.predicted if self.measured is None else min(self.predicted, self.measured)


def max_stable_dt(
    scene: Scene,
    method: Method = "rk4",
    formulation: Formulation = "csm",
    *,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    measure: bool = True,
    max_steps: int = 2_000_000,
) -> StableStep:
    """Finds the longest stable step of a formulation and a method for a scene.

    The predicted step comes from linear theory: the motion is linearised at some 200 instants of a
    trusted run (a stiff method with adaptive steps at tolerance 1e-8), and the step is the shortest
    at which a decaying mode leaves the method's stability region. The measured step comes from a
    bisection: it is the longest with which the run ends with the trusted run's status, within half
    of each coordinate's largest magnitude of its final state, and without swinging further out by
    more than that.

    In unilateral contact the linearisation is whole at the instants at which both tips stick. At
    the others it has the surfaces that move by themselves: the shear of a tip that slips, grazes or
    is free, and the compression of a free one. Only the measurement covers the rest of the motion
    there, and the message has the share of these instants if it matters.

    A stable step need not be accurate: `advise` finds a step that meets an accuracy.

    Args:
        scene: The scene to simulate. A scene at rest with constant inputs is displaced by a
            billionth of its size and run for at least 4000 steps, so that instability shows.
        method: How time is stepped, as for `simulate`.
        formulation: How the constraints are kept, as for `simulate`.
        stabilization: The gains of (19) and (20), for "csm".
        measure: Whether to measure the step, besides predicting it.
        max_steps: Largest number of steps of a run in the bisection; if more would be needed,
            `measured` is None. The trusted run takes at most this many steps, or 100 000 if that is
            more. If it does not reach the end of the motion, only the part that it reached is
            linearised and nothing is measured; the message says so.

    Raises:
        ValueError: An argument breaks its rule, or the scene's start does.
        TypeError: An argument is of the wrong kind.
        KeyboardInterrupt: Ctrl-C.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    method = checks.choice("method", method, _core.METHODS)
    formulation = checks.choice("formulation", formulation, _core.FORMULATIONS)
    require_formulations("formulation", (formulation,), scene)
    max_steps = checks.integer("max_steps", max_steps, 1, MOST_STEPS)
    measure = checks.boolean("measure", measure)
    most = max(max_steps, _FEWEST_STEPS)
    record = ("state", "contact")
    trusted = trusted_run(scene, formulation, stabilization, record=record, max_steps=most)
    along = along_run(trusted, formulation, stabilization)
    steps = along.stable_step(method)
    k = int(np.argmin(steps))
    predicted, rate = float(steps[k]), _limiting(along.rates[k], method)
    measured, found = None, ""
    if trusted.status not in ENDS:
        found = (
            f"the motion is known to t = {trusted.t[-1]:.4g} s only, where {trusted.method} with "
            f"tolerance {_TRUSTED_TOLERANCE:g} ended as {trusted.status}"
        )
    elif measure:
        bisection = Bisection(scene, trusted, (method, formulation, stabilization), predicted)
        measured, found = bisection.longest(max_steps)
    mode = along.leading(k, rate)
    message = _message(method, predicted, (float(along.t[k]), rate, mode), measured)
    if measured is not None and not _alike(predicted, measured):
        share = float(np.mean(steps < measured))
        message += f"; they part because {_reason(predicted, measured, share, found)}"
    elif found and measured is None:
        message += f"; not measured: {found}"
    alone = float((trusted.contact != ContactMode.STICK).any(axis=1).mean())
    if alone and (measured is None or measured < predicted / _AGREE):
        message += (
            f"; at {100 * alone:.2g} % of the instants a tip does not stick, where only its own "
            "surface is linearised, so the predicted step may be too long"
        )
    return StableStep(
        method=method,
        formulation=formulation,
        predicted=predicted,
        t=float(along.t[k]),
        rate=rate,
        mode=mode,
        measured=measured,
        message=message,
    )


def trusted_run(
    scene: Scene,
    formulation: Formulation = "nullspace",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    tolerance: float = _TRUSTED_TOLERANCE,
    record: Sequence[str] = ("state",),
    method: Method = "radau5",
    max_steps: int | None = None,
) -> Run:
    """A run by a stiff method with adaptive steps, which stands for the exact motion.

    It uses "nullspace", or "projected" in unilateral contact, which have no drift; or "csm" if
    `formulation` is that and the scene starts off the constraints, from where only "csm" can start.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    can_start = scene.start().check or formulation != "csm"
    run = simulate(
        scene,
        tolerance=tolerance,
        method=method,
        formulation=without_drift(scene) if can_start else "csm",
        stabilization=stabilization,
        record=record,  # type: ignore[arg-type]
        max_steps=max_steps,
    )
    return not_interrupted(run)


def _limiting(rates: Complexes, method: str) -> complex:
    """The eigenvalue that allows the shortest step; the largest if none limits the step."""
    steps = stable_steps(method, rates)
    if np.isinf(steps).all():
        return complex(rates[np.argmax(np.abs(rates))])
    return complex(rates[np.argmin(steps)])


def _alike(predicted: float, measured: float) -> bool:
    if math.isinf(predicted) or math.isinf(measured):
        return predicted == measured
    return 1.0 / _AGREE < predicted / measured < _AGREE


def _message(
    method: str, predicted: float, where: tuple[float, complex, str], measured: float | None
) -> str:
    t, rate, mode = where
    swing = f" and {abs(rate.imag):.3g} rad/s" if abs(rate.imag) > 1e-3 * abs(rate) else ""
    what = f"the mode of {mode} at {rate.real:.3g} 1/s{swing}, t = {t:.4g} s"
    if math.isnan(rate.real):
        what = f"rates of the motion that overflow at t = {t:.4g} s"
    if math.isinf(predicted):
        text = f"{method} is stable for every step; fastest is {what}"
    else:
        text = f"predicted {predicted:.3g} s, by {what}"
    if measured is None:
        return text
    return f"{text}; measured " + (
        "no limit: a single step does" if math.isinf(measured) else f"{measured:.3g} s"
    )


def _reason(predicted: float, measured: float, share: float, failure: str) -> str:
    if math.isinf(predicted):
        return f"what ends it is accuracy, not stability: {failure}"
    if measured > predicted:
        if share < 1.0:
            return (
                f"the predicted step is too long for {100 * share:.0f} % of the instants only, and "
                "what grows there decays again"
            )
        return "the run has too few steps for what grows to show"
    return f"the motion fails before its linearisation about the right one does: {failure}"
