"""Reference solutions: accurate trajectories to compare with, public as `softpinch.reference`.

SciPy integrates the null-space form of the equations (`null_space`) between the breaks of the
inputs (`segments`). For unilateral contact, which these equations do not have, `of_any_contact`
returns a run of the core itself.
"""

import cmath
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..run import Options, Request, computed, scaled_error
from ..scene import ESTIMATED, Scene
from ..scene.contact import require_bilateral
from ..scene.control import WRITTEN
from ..support import Floats, Result, checks, read_only
from .null_space import PLAIN, STATES, carried, jump, parameters, right_hand_side
from .segments import METHODS, Inputs, System, integrate

# The smallest relative tolerance that SciPy accepts, 100 times round-off.
_TIGHTEST = 2.3e-14
# A scene counts as stiff if stability makes an explicit method need more evaluations than this, or
# more than this multiple of the evaluations of the rough pass.
_MOST_EXPLICIT = 2_000_000
_STIFF = 50
# LSODA may take this many evaluations to confirm, or this multiple of those of the first method.
_MOST_CONFIRMING, _CONFIRMING = 150_000, 3

_Rates = Callable[..., Any] | None
_ROWS = right_hand_side(np.sin, np.cos)
_COMPLEX = right_hand_side(cmath.sin, cmath.cos)
# Derivatives take a step along the imaginary axis. Nothing is subtracted, so it may be tiny.
_STEP = 1e-100
_METRES = np.array([1, 1, 0, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 0], dtype=bool)
# A state that is zero by symmetry has the round-off of other states. So the size of a state is at
# least this share of the largest size of its kind (a radian counts as a finger's length). The share
# for rates keeps tolerances above round-off, which implicit methods would take for stiffness.
_KINDS = ((slice(0, 7), 1e-3), (slice(7, 9), 1e-3), (slice(9, 14), 1.0))
# The size of a state is at least this share of its typical size: the rates of a body at rest have
# the round-off of the forces on it, and no tolerance below that can be met.
_AT_REST = 1e-2
# Tolerances of the rough pass; the second is used if the motion diverges with the first.
_ROUGH = (1e-6, 1e-9)
# The stiffness is evaluated at this many states of the rough pass.
_PROBES = 64
# DOP853's stability region reaches to about -6, and a step takes 12 evaluations.
_EVALUATIONS_OF_STIFFNESS = 2.0
# Formulation and tolerance of the core's reference, and of the run that confirms it.
_CORE_RUNS = (("projected", 1e-13), ("csm", 1e-12))
# Number of instants, besides the requested ones, at which the core's reference finds the scales.
_INSTANTS = 1000


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Reference(Result):
    """A reference trajectory with a row for each of n requested instants.

    Attributes:
        t: Instants (n,), s.
        q: Coordinates (n, 9), m and rad.
        p: Rates of the coordinates (n, 9), m/s and rad/s; at an impulse, just before it.
        multipliers: Multipliers (n, 4), N; at a break, just after it, but at the end just before.
        integral: Integrals of the angle errors in (39), (n, 2), rad s.
        method: The method that solved the scene, and the method that confirmed the solution.
        evaluations: Number of evaluations of the right-hand side, with those of both methods.
        scales: "q" (9,), "p" (9,) and "multipliers" (4,) -> the largest magnitude of each component
            at the ends of all steps, by which errors are divided.
        own_error: "q", "p" and "multipliers" -> the largest scaled difference to the confirming
            method; None without confirmation.
    """

    t: Floats
    q: Floats
    p: Floats
    multipliers: Floats
    integral: Floats
    method: str
    evaluations: int
    scales: Mapping[str, Floats]
    own_error: Mapping[str, float] | None = None


def solve(
    scene: Scene,
    times: ArrayLike | None = None,
    *,
    method: str = "DOP853",
    rtol: float = 1e-12,
    most: int = 5_000_000,
    tolerance: float = 1e-10,
    rates: Callable[..., Any] | None = None,
) -> Reference:
    """Integrates a scene over each interval between two breaks of its inputs.

    A one-step method takes an additional step to each requested instant, because the interpolating
    polynomials of its steps are less accurate. LSODA and BDF evaluate their own polynomials.

    Args:
        scene: The scene, with bilateral contact; its friction coefficient is not used.
        times: Requested instants (n,), s, on the clock of schedule and disturbances, within the
            run, in any order; None requests the start, every break and the end.
        method: A SciPy method, one of `METHODS`.
        rtol: Relative tolerance of a step, raised to 2.3e-14 if smaller. The absolute tolerance is
            a share of `rtol` times each state's magnitude along the run: a hundredth, but a tenth
            for LSODA, and all of it for Radau and BDF.
        most: The largest number of evaluations of the right-hand side.
        tolerance: The largest constraint residual of the start, relative to the sizes of its terms.
        rates: A function to use instead of `right_hand_side().rates`, for example a compiled one;
            its arguments are tuples.

    Raises:
        ValueError: The start violates the constraints, an instant is outside of the run, or the
            scene has unilateral contact or driven fingers.
        RuntimeError: The motion diverges, often because the grasp is lost, or needs more than
            `most` evaluations; the message has the time.
    """
    method = checks.choice("method", method, METHODS)
    rtol = max(checks.positive("rtol", rtol), _TIGHTEST)
    most = checks.integer("most", most, 1)
    return _Problem(scene, times, tolerance, rates, most).solution(method, rtol, most)


def confirmed(
    scene: Scene,
    times: ArrayLike | None = None,
    *,
    rtol: float = 1e-12,
    most: int = 5_000_000,
    tolerance: float = 1e-10,
    rates: Callable[..., Any] | None = None,
) -> Reference:
    """Solves a scene by two methods and compares the solutions.

    The first solution is returned, with `own_error`. Its method is DOP853, or Radau if the
    eigenvalues along a rough pass show that stability would limit the steps of an explicit method.
    The second method is LSODA (Adams and BDF) at a tenth of the tolerance; its error is most of
    `own_error`. If LSODA fails or takes much longer, the first method repeats the run at ten times
    the tolerance, which is a weaker confirmation.

    Args:
        scene, times, rtol, most, tolerance, rates: As for `solve`; `most` is for each method.
    """
    rtol = max(checks.positive("rtol", rtol), _TIGHTEST)
    most = checks.integer("most", most, 1)
    problem = _Problem(scene, times, tolerance, rates, most)
    stiff = problem.explicit > min(most, _MOST_EXPLICIT, _STIFF * problem.evaluations)
    name = "Radau" if stiff else "DOP853"
    first = problem.solution(name, rtol, most)
    affordable = min(most, max(_MOST_CONFIRMING, _CONFIRMING * first.evaluations))
    try:
        second = problem.solution("LSODA", max(0.1 * rtol, _TIGHTEST), affordable)
    except RuntimeError:
        second = problem.solution(name, 10.0 * rtol, most)
    # Both solutions count the rough pass.
    return _compared(first, second, first.evaluations + second.evaluations - problem.evaluations)


def of_any_contact(scene: Scene, times: ArrayLike) -> Reference:
    """Solves a scene as `confirmed`, at increasing instants to the end of the run (n,), s."""
    if scene.contact == "bilateral":
        return confirmed(scene, times)
    # In unilateral contact by two runs of the core.
    wanted = np.asarray(times, np.float64)
    every = np.union1d(wanted, np.linspace(scene.start().time, wanted[-1], _INSTANTS))
    solutions = []
    for formulation, tolerance in _CORE_RUNS:
        how = {"formulation": formulation, "tolerance": tolerance, "times": every}
        options = Options.checked(method="dop853", record=("state", "multipliers"), **how)
        run = computed(Request(scene, options))
        if not run.success:
            end = f"{formulation} ended as {run.status} at t = {run.t[-1]} s: {run.message}"
            raise RuntimeError(f"reference: with unilateral contact {end}")
        along = {name: getattr(run, name) for name in ("q", "p", "multipliers", "integral")}
        method = f"{formulation} dop853 at tolerance {tolerance:.0e}"
        rows, count = np.searchsorted(run.t, wanted), run.stats["evaluations"]
        solutions.append(_reference(scene, wanted, along, rows, method, count))
    first, second = solutions
    found = _compared(first, second, first.evaluations + second.evaluations)
    reason = "the core's own runs, because the independent reference has no unilateral contact"
    return replace(found, method=f"{found.method}: {reason}")


def _compared(first: Reference, second: Reference, evaluations: int) -> Reference:
    method = f"{first.method}, confirmed by {second.method}"
    errors = scaled_error.largest(second, first, first.scales)
    return replace(first, method=method, evaluations=evaluations, own_error=errors)


def _reference(
    scene: Scene, times: Floats, along: Mapping[str, Floats], picked: Any, method: str, count: int
) -> Reference:
    """A reference whose rows are those picked from the whole motion, which gives the scales."""
    usual = scaled_error.usual(scene)
    rows = {name: read_only(values[picked]) for name, values in along.items()}
    scales = {k: read_only(scaled_error.scales(k, along[k], usual)) for k in ESTIMATED}
    return Reference(t=times, **rows, method=method, evaluations=count, scales=scales)


class _Problem:
    """A scene as a problem for SciPy: parameters, start, inputs, and requested instants.

    A rough pass, with some `evaluations`, finds the `sizes` of the states, for absolute tolerances,
    and the number of evaluations that DOP853 needs for stability, `explicit`.
    """

    def __init__(
        self, scene: Scene, times: ArrayLike | None, tolerance: float, rates: _Rates, most: int
    ) -> None:
        checks.instance("scene", scene, Scene)
        require_bilateral(scene, "the reference", "has the equations of bilateral contact only")
        if scene.law != "pid":
            given = WRITTEN[scene.law]
            raise ValueError(f"Scene.{given}: the reference has the equations of a PID only")
        if rates is not None:
            checks.function("rates", rates)
        self.scene, self.c = scene, parameters(scene)
        self.start, begin = _start(scene, self.c, checks.positive("tolerance", tolerance))
        end = begin + scene.duration
        if not end > begin:
            rule = "too short, it ends no later than it starts"
            raise ValueError(f"Scene.duration = {scene.duration}: {rule}")
        self.inputs = Inputs(scene, begin, end)
        self.t, self.wanted = self.inputs.instants(times)
        c, of_states = self.c, rates or PLAIN.rates
        self.system = System(
            rates=lambda y, u: of_states(*carried(y, c, u)),
            jump=lambda y, impulse: np.array(jump(y.tolist(), c, impulse)),
            jacobian=self.jacobian,
        )
        self.explicit = 0.0
        known = np.where(_METRES, max(self.c[0], self.c[15]), 1.0)
        for rtol in _ROUGH:
            try:
                how: dict[str, Any] = {"rtol": rtol, "sizes": known, "most": most}
                motion = integrate(self.system, self.inputs, self.start, (), method="LSODA", **how)
            except RuntimeError:
                continue  # With a loose tolerance a grasp that holds may be lost.
            self.sizes, self.evaluations = np.abs(motion.y).max(axis=0), motion.evaluations
            for kind, least in _KINDS:
                # If all states of a kind are at rest, their round-off is not a size.
                largest = max((self.sizes[kind] / known[kind]).max(), _AT_REST)
                self.sizes[kind] = np.maximum(self.sizes[kind], least * largest * known[kind])
            rows = np.unique(np.linspace(0, len(motion.t) - 1, _PROBES).astype(int))
            for k, length in zip(rows, np.diff(motion.t[rows]), strict=False):
                jacobian = self.jacobian(motion.y[k], tuple(motion.u[k].tolist()))
                if np.isfinite(jacobian).all():
                    stiffness = float(np.abs(np.linalg.eigvals(jacobian)).max() * length)
                    self.explicit += _EVALUATIONS_OF_STIFFNESS * stiffness
            return
        # The motion diverges, which the accurate integration reports. Sizes are of no use then.
        self.sizes, self.evaluations = known, 0

    def jacobian(self, y: Floats, u: tuple[float, ...]) -> Floats:
        """The derivatives of the rates (14, 14), exact except for round-off."""
        columns = []
        for k in range(STATES):
            moved: list[complex] = y.tolist()
            moved[k] += 1j * _STEP
            rates = _COMPLEX.rates(*carried(moved, self.c, u, cmath))
            columns.append([complex(rate).imag for rate in rates])
        return np.array(columns).T / _STEP

    def solution(self, method: str, rtol: float, most: int) -> Reference:
        """The reference by one method, whose evaluations include those of the rough pass."""
        how: dict[str, Any] = {"rtol": rtol, "sizes": self.sizes, "most": most}
        motion = integrate(self.system, self.inputs, self.start, self.wanted, method=method, **how)
        states = list(motion.y.T)
        d_n1, d_n2, *tips = _ROWS.followers(states, self.c)
        along = {
            "q": np.stack([*states[:5], d_n1, d_n2, *states[5:7]], axis=1),
            "p": np.stack([*states[9:], *tips], axis=1),
            "multipliers": np.stack(
                _ROWS.multipliers(*carried(states, self.c, motion.u.T, np)), axis=1
            ),
            "integral": motion.y[:, 7:9],
        }
        picked = np.searchsorted(motion.t, self.wanted)
        evaluations = self.evaluations + motion.evaluations
        name = f"SciPy {method} at rtol {rtol:.2g}"
        return _reference(self.scene, self.t, along, picked, name, evaluations)


def _start(scene: Scene, c: tuple[float, ...], tolerance: float) -> tuple[Floats, float]:
    """The fourteen states at the start, which must be on the constraints, and its time, s."""
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
