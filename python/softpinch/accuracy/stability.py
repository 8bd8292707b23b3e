"""Stability: linearisation of the motion along a run, and the longest stable step of a scene."""

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

# Tolerance of the trusted run, which stands for the exact motion.
_TRUSTED_TOLERANCE = 1e-8
# Statuses that are physical ends of the motion; all others mean that the integrator gave up.
ENDS = ("completed", "separated", "crushed", "folded")
# The trusted run may take at least this many steps, a fraction of a second of work, even if the
# runs of the bisection may take fewer.
_FEWEST_STEPS = 100_000
# Number of instants of a run at which the motion is linearised.
_INSTANTS = 200
# A growth rate below this share of |eigenvalue| counts as zero: without damping, round-off decides
# on which side of the imaginary axis an eigenvalue lies.
_SWINGS = 0.01
# Predicted and measured steps agree if they differ by less than this factor.
_AGREE = 1.1
# The names of each formulation's states (docs/integrators.md, "How the constraints are kept").
_OBJECT = ("x", "y", "theta")
_FINGERS = ("theta_1", "theta_2")
_TIPS = ("d_n1", "d_n2", "d_t1", "d_t2")
_MEMORIES = ("integral_1", "integral_2")
# Eigenvalue problems per call of NumPy: some tens of milliseconds.
_MATRICES_PER_CALL = 256


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes(Result):
    """Linearisations of the motion: a small deviation z from the motion obeys dz/dt = J z.

    Attributes:
        t: Instants (n,), s.
        jacobian: J at each instant (n, N, N), in the formulation's own states.
        rates: Eigenvalues of J (n, N), 1/s; nan where an entry of J overflowed.
        states: Names of the N states; the time derivative of x is "rate of x".
    """

    t: Floats
    jacobian: Floats
    rates: Complexes
    states: tuple[str, ...]

    def stable_step(self, method: str) -> Floats:
        """The longest stable step at each instant (n,), s; inf where every step is stable.

        It is the longest step for which every decaying mode decays in the numerical solution too.
        Modes that grow physically impose no limit, except slowly growing oscillations, which count
        as undamped. The step is zero where an entry of J overflowed.

        Raises:
            ValueError: The method is unknown.
        """
        method = checks.choice("method", method, _core.METHODS)
        return np.asarray(_stable_steps(method, self.rates).min(axis=1))

    def leading(self, k: int, rate: complex) -> str:
        """Name of the state with the largest share in a mode.

        Args:
            k: Index of the instant.
            rate: Eigenvalue of the mode, 1/s.

        Returns:
            A name out of `states`, without "rate of "; "an overflow" if an entry of J overflowed.

        Raises:
            ValueError: `k` is out of range, or `rate` is not finite although J is.
            TypeError: An argument is of the wrong kind.
        """
        k = checks.integer("k", k, -len(self.t), len(self.t) - 1)
        if not isinstance(rate, int | float | complex | np.number) or isinstance(rate, bool):
            raise TypeError(f"rate = {checks.shown(rate)}: must be an eigenvalue, a complex number")
        if not np.isfinite(self.jacobian[k]).all():
            return "an overflow"
        # The parts are checked one by one, because `complex` fails for huge integers.
        rate = complex(checks.finite("rate", rate.real), checks.finite("rate", rate.imag))
        values, vectors = np.linalg.eig(self.jacobian[k])
        vector = np.abs(vectors[:, np.argmin(np.abs(values - rate))])
        # To compare different units, lengths are divided by 0.02 m, and rates in addition by the
        # magnitude of the eigenvalue.
        sizes = [
            (1.0 if "theta" in name or "integral" in name else 0.02)
            * (abs(rate) if name.startswith("rate") else 1.0)
            for name in self.states
        ]
        # For an eigenvalue of zero this divides by zero.
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
    """Linearises the motion about states, such as the rows of a run.

    Args:
        scene: The scene with parameters and inputs.
        t: Instants (n,), on the clock of schedule and disturbances, s. At a jump of an input, its
            value after the jump counts.
        q: Coordinates (n, 9), m and rad.
        p: Velocities (n, 9), m/s and rad/s.
        integral: PID integrals (n, 2), rad s.
        formulation: The formulation whose states are used. "csm" adds modes with eigenvalues
            -alpha, twice for each C^H, and -beta for each C^N; "projected" has zeros instead.
        stabilization: The gains of (19) and (20), for "csm".

    Raises:
        ValueError: A shape is wrong, a number is not finite, or `formulation` is unknown.
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
        """The smaller of the predicted and the measured step, s."""
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
    """Finds the longest stable step of a formulation and a method for a scene.

    The predicted step comes from linear theory: the motion is linearised at some 200 instants of a
    trusted run (a stiff method with adaptive steps at tolerance 1e-8), and the step is the shortest
    at which a decaying mode leaves the method's stability region. The measured step comes from a
    bisection: it is the longest with which the run ends with the trusted run's status, within half
    of each coordinate's largest magnitude of its final state, and without swinging further out by
    more than that.

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
    """A run by a stiff method with adaptive steps, which stands for the exact motion.

    It uses "nullspace", which has no drift; or "csm" if `formulation` is that and the scene starts
    off the constraints, from where only "csm" can start.

    Raises:
        KeyboardInterrupt: Ctrl-C.
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
    """Linearises the motion at evenly spread rows of a run, including its start and end."""
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
    """The longest stable step for each eigenvalue, in the shape of `rates`, s."""
    swinging = (rates.real > 0.0) & (rates.real < _SWINGS * np.abs(rates))
    rates = np.where(swinging, 1j * rates.imag, rates)
    steps = _core.stable_step(method, rates.ravel()).reshape(rates.shape)
    return np.asarray(np.where(np.isnan(rates), 0.0, steps))


def _limiting(rates: Complexes, method: str) -> complex:
    """The eigenvalue that allows the shortest step; the largest if none limits the step."""
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
