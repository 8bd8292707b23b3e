"""Which steps a scene allows: the motion linearised along a run, and the longest step, measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run.options import MOST_STEPS
from ..run.run import Run
from ..run.simulate import not_interrupted, simulate
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.result import Result
from .bisection import Bisection

Complexes = NDArray[np.complex128]

# What stands for the exact motion; good enough to linearise about and to tell growth from motion.
_TRUSTED_TOLERANCE = 1e-8
# With these the motion is over, or no longer the model's; all others are of a run that gave up.
ENDS = ("completed", "separated", "crushed", "folded")
# It may take so many steps, a fraction of a second, however few the runs of a bisection may.
_FEWEST_STEPS = 100_000
# So many instants of a run are linearised about.
_INSTANTS = 200
# A mode that grows by less than this share of its rate is one that swings: where nothing damps,
# round-off alone decides on which side of the imaginary axis an eigenvalue lies.
_SWINGS = 0.01
# The two stand for one another within this factor.
_AGREE = 1.1
# The names of each formulation's states (docs/integrators.md, "How the constraints are kept").
_OBJECT = ("x", "y", "theta")
_FINGERS = ("theta_1", "theta_2")
_TIPS = ("d_n1", "d_n2", "d_t1", "d_t2")
_MEMORIES = ("integral_1", "integral_2")
# Some tens of milliseconds of LAPACK's.
_MATRICES_PER_CALL = 256


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes(Result):
    """The motion linearised about states: d/dt (y - y_0) = J (y - y_0) beside the motion itself.

    Attributes:
        t: (n,), s.
        jacobian: J, (n, N, N), in the formulation's own states.
        rates: Its eigenvalues (n, N), 1/s; nan where an entry of J overflowed.
        states: Names of the N states; a rate of x is "rate of x".
    """

    t: Floats
    jacobian: Floats
    rates: Complexes
    states: tuple[str, ...]

    def stable_step(self, method: str) -> Floats:
        """The longest step that lets no mode grow, at each instant (n,), s; inf where any will do.

        Zero where an entry of J overflowed: nothing is known to be short enough.

        Modes that grow by themselves limit no step, unless they swing many times meanwhile: then
        they count as swinging without growth.

        Raises:
            ValueError: The method is unknown.
        """
        method = checks.choice("method", method, _core.METHODS)
        return np.asarray(_stable_steps(method, self.rates).min(axis=1))

    def leading(self, k: int, rate: complex) -> str:
        """The state that moves most in the mode of this eigenvalue at instant `k`, by name.

        "an overflow" where an entry of J did.

        Raises:
            ValueError: There is no such instant, or `rate` is not finite where J is.
            TypeError: One is of the wrong kind.
        """
        k = checks.integer("k", k, -len(self.t), len(self.t) - 1)
        if not isinstance(rate, int | float | complex | np.number) or isinstance(rate, bool):
            raise TypeError(f"rate = {checks.shown(rate)}: must be an eigenvalue, a complex number")
        if not np.isfinite(self.jacobian[k]).all():
            return "an overflow"
        # One part after the other: an integer may be too large for both.
        rate = complex(checks.finite("rate", rate.real), checks.finite("rate", rate.imag))
        values, vectors = np.linalg.eig(self.jacobian[k])
        vector = np.abs(vectors[:, np.argmin(np.abs(values - rate))])
        # Metres and radians: against lengths of centimetres; rates against the mode's own speed.
        sizes = [
            (1.0 if "theta" in name or "integral" in name else 0.02)
            * (abs(rate) if name.startswith("rate") else 1.0)
            for name in self.states
        ]
        # A mode at rest has no speed: its rates are infinitely small beside it, or 0 / 0.
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.nan_to_num(vector / sizes, nan=0.0, posinf=np.inf)
        return self.states[int(np.argmax(shares))].removeprefix("rate of ")


def _eigenvalues(jacobian: Floats) -> Complexes:
    """Eigenvalues (n, states) of matrices (n, states, states); NaN where an entry is not finite."""
    rates = np.full(jacobian.shape[:2], complex(math.nan, math.nan))
    finite = np.flatnonzero(np.isfinite(jacobian).all(axis=(1, 2)))
    # Python delivers signals, such as Ctrl-C, only between calls to NumPy.
    for first in range(0, len(finite), _MATRICES_PER_CALL):
        block = finite[first : first + _MATRICES_PER_CALL]
        rates[block] = np.linalg.eigvals(jacobian[block])
    return rates


def modes(
    scene: Scene,
    t: ArrayLike,
    q: ArrayLike,
    p: ArrayLike,
    integral: ArrayLike,
    *,
    formulation: str = "nullspace",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
) -> Modes:
    """Linearises the motion about states, such as a run's rows.

    Args:
        scene: The physics.
        t: (n,), on the clock of schedule and disturbances, s; at a jump what holds after it.
        q: (n, 9), m and rad.
        p: (n, 9), m/s and rad/s.
        integral: (n, 2), rad s.
        formulation: In whose states. "csm" has modes of its own, -alpha twice for each C^H and
            -beta for each C^N; "projected" has zeros in their place.
        stabilization: The gains of (19) and (20), for "csm".

    Raises:
        ValueError: A shape is wrong, a number not finite, or `formulation` unknown.
        TypeError: An argument is of the wrong kind.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    formulation = checks.choice("formulation", formulation, _core.FORMULATIONS)
    instants = checks.array("t", t, ("n",))
    n = len(instants)
    jacobian = _core.jacobians(
        scene.parameters(),
        scene.inputs(),
        instants,
        checks.array("q", q, (n, 9)),
        checks.array("p", p, (n, 9)),
        checks.array("integral", integral, (n, 2)),
        formulation,
        stabilization.alpha,
        stabilization.beta,
    )
    rates = _eigenvalues(jacobian)
    turning = scene.fingers == "pid"
    pose = (*_OBJECT, *_FINGERS) if turning else _OBJECT
    places = pose if formulation == "nullspace" else (*pose, *_TIPS)
    states = (*places, *(f"rate of {name}" for name in places))
    states += _TIPS[2:] if formulation == "nullspace" else ()
    states += _MEMORIES if turning else ()
    return Modes(t=instants, jacobian=jacobian, rates=rates, states=states)


@dataclass(frozen=True, kw_only=True, eq=False)
class StableStep(Result):
    """The longest step that a scene allows.

    Attributes:
        method: How time is stepped.
        formulation: How the constraints are kept.
        predicted: From the eigenvalues along the run and the method's stability region, s; inf for
            a method that is stable for every step.
        t: The instant whose eigenvalues allow the least, s.
        rate: The eigenvalue that does, 1/s.
        mode: The state that moves most in its mode.
        measured: The longest step, to half a percent, with which the run ends as it should, s; inf
            where a single step does; None where it was not measured.
        message: Both in words, and where they part, why.
    """

    method: str
    formulation: str
    predicted: float
    t: float
    rate: complex
    mode: str
    measured: float | None
    message: str

    @property
    def dt(self) -> float:
        """The smaller of the two, s."""
        return self.predicted if self.measured is None else min(self.predicted, self.measured)


def max_stable_dt(
    scene: Scene,
    method: str = "rk4",
    formulation: str = "csm",
    *,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    measure: bool = True,
    max_steps: int = 2_000_000,
) -> StableStep:
    """The longest step that a pair of formulation and method takes a scene's run with.

    Predicted: the motion is linearised at some 200 instants of a run that a stiff method makes to
    tolerance 1e-8, and the least step is taken at which an eigenvalue that decays leaves the
    method's stability region. Measured: by bisection, the longest step with which the run ends with
    the same status, and where it should within half of each coordinate's largest size.

    Stable is not accurate: `advise` says which step meets an accuracy.

    Args:
        scene: What is to be simulated. One that rests, without an input that changes, is nudged by
            a billionth of its size and run for at least 4000 steps, so that what grows can be seen.
        method: "rk4", ...
        formulation: "csm", ...
        stabilization: The gains of (19) and (20), for "csm".
        measure: Whether to measure, too.
        max_steps: No run of the bisection takes more steps; where shorter ones would be needed,
            `measured` is None. Nor does the stiff method, but 100 000 where that is more. A motion
            that it does not follow to its end is linearised as far as it came, and not measured;
            the message says so.

    Raises:
        ValueError: An argument breaks its rule, or the scene's start does.
        TypeError: An argument is of the wrong kind.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    method = checks.choice("method", method, _core.METHODS)
    formulation = checks.choice("formulation", formulation, _core.FORMULATIONS)
    max_steps = checks.integer("max_steps", max_steps, 1, MOST_STEPS)
    measure = checks.boolean("measure", measure)
    most = max(max_steps, _FEWEST_STEPS)
    trusted = trusted_run(scene, formulation, stabilization, max_steps=most)
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
    formulation: str = "nullspace",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    tolerance: float = _TRUSTED_TOLERANCE,
    record: Sequence[str] = ("state",),
    method: str = "radau5",
    max_steps: int | None = None,
) -> Run:
    """The motion by a stiff method without drift, or by "csm" from where only that can start.

    Raises:
        KeyboardInterrupt: Ctrl-C; half a motion is none to trust.
    """
    can_start = scene.start().check or formulation != "csm"
    run = simulate(
        scene,
        tolerance=tolerance,
        method=method,
        formulation="nullspace" if can_start else "csm",
        stabilization=stabilization,
        record=record,
        max_steps=max_steps,
    )
    return not_interrupted(run)


def along_run(run: Run, formulation: str, stabilization: Stabilization) -> Modes:
    """The motion linearised at some instants of a run, its start and end among them."""
    rows = np.unique(np.linspace(0, len(run) - 1, _INSTANTS).round().astype(int))
    return modes(
        run.scene,
        run.t[rows],
        run.q[rows],
        run.p[rows],
        run.integral[rows],
        formulation=formulation,
        stabilization=stabilization,
    )


def _stable_steps(method: str, rates: Complexes) -> Floats:
    """The longest step for each eigenvalue, in the shape of `rates`, s."""
    swinging = (rates.real > 0.0) & (rates.real < _SWINGS * np.abs(rates))
    rates = np.where(swinging, 1j * rates.imag, rates)
    steps = _core.stable_step(method, rates.ravel()).reshape(rates.shape)
    return np.asarray(np.where(np.isnan(rates), 0.0, steps))


def _limiting(rates: Complexes, method: str) -> complex:
    """The eigenvalue that allows the shortest step; the fastest one where none does."""
    steps = _stable_steps(method, rates)
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
