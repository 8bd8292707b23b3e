"""Linearisations of the motion, and `max_stable_dt`: the longest stable step."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..analysis.states import state_names
from ..run import Request, Run, computed, scaled_error
from ..run.contact import grazes
from ..run.options import MOST_STEPS, Options
from ..run.stiffness import eigenvalues, stable_steps, strictest_steps
from ..scene import Scene, Stabilization, State, branches
from ..scene.contact import require_formulations
from ..scene.control import require_known_torque
from ..support import Complexes, Floats, Formulation, Method, Result, ShownTable, checks
from .runs import ACCURATE, accurate_run, largest_that_holds

# Number of instants of a run at which the motion is linearised.
_INSTANTS = 200
# Eigenvalues below this share of the largest one are zero but for round-off.
_NEUTRAL = 1e-11
# Statuses that are physical ends of the motion; all others mean that the integrator gave up.
ENDS = ("completed", "separated", "crushed", "folded", "lost")
# The accurate run may take this many steps, a fraction of a second, even if others may not.
_FEWEST_STEPS = 100_000
# A coordinate whose error exceeds this share of its largest magnitude follows another motion.
LOST = 0.5
# Relative accuracy of the measured step, and the factor between steps until it is bracketed.
_SHARP, _FACTOR = 0.005, 1.25
# A step counts as stable if these shares of it are stable, too: not every unstable step shows.
_SHORTER = (0.95, 0.9, 0.8)
# Number of rows of a trial run.
_ROWS = 256
# Least number of steps for a scene at rest, so that growth by a percent a step becomes visible.
_TIME_TO_GROW = 4000
# Displacement of a scene at rest, as a share of sizes: exact symmetry would hide unstable modes.
_DISPLACEMENT = 1e-9
# Predicted and measured steps agree if they differ by less than this factor.
_AGREE = 1.1


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
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

    def stable_step(self, method: Method) -> Floats:
        """The longest stable step at each instant (n,), s; inf where every step is stable.

        With it every decaying mode decays in the numerical solution too; slowly growing
        oscillations count as undamped. The step is zero where an entry of J overflowed.
        """
        method = checks.choice("method", method, _core.METHODS)
        return strictest_steps(method, self.rates)

    def _tables(self) -> Iterator[ShownTable]:
        """The modes at the first instant, the fastest growing one first."""
        if not len(self.t):
            return
        # The neutral directions of a grasp have zero eigenvalues, but for round-off.
        largest = np.abs(self.rates[0]).max()
        rates = np.where(np.abs(self.rates[0]) <= _NEUTRAL * largest, 0.0, self.rates[0])
        # Of each conjugate pair, the eigenvalue with positive imaginary part.
        rows: list[tuple[Any, ...]] = []
        for rate in sorted(rates[~(rates.imag < 0.0)].tolist(), key=lambda rate: -rate.real):
            damping = -rate.real / abs(rate) if rate else ""
            name = "an overflow" if rate else "neutral"
            if rate and cmath.isfinite(rate):
                name = self.leading(0, rate)
            rows.append((name, rate.real, rate.imag / (2.0 * math.pi), damping))
        columns = ("largest share", "growth [1/s]", "frequency [Hz]", "damping ratio")
        yield ShownTable(columns, rows, f"The modes at t = {self.t[0]:.6g} s")

    def leading(self, k: int, rate: complex) -> str:
        """Name of the state with the largest share in the mode of `rate`, 1/s, at instant `k`.

        It is one out of `states`, without "rate of "; "an overflow" if an entry of J overflowed.
        """
        k = checks.integer("k", k, -len(self.t), len(self.t) - 1)
        if not np.isfinite(self.jacobian[k]).all():
            return "an overflow"
        if not isinstance(rate, int | float | complex | np.number) or isinstance(rate, bool):
            raise TypeError(f"rate = {checks.shown(rate)}: must be an eigenvalue, a complex number")
        rate = complex(checks.finite("rate", rate.real), checks.finite("rate", rate.imag))
        values, vectors = np.linalg.eig(self.jacobian[k])
        vector = np.abs(vectors[:, np.argmin(np.abs(values - rate))])
        # To compare units, lengths are divided by 0.02 m, and rates by the size of the eigenvalue.
        sizes = [
            (1.0 if "theta" in name or "integral" in name else 0.02)
            * (abs(rate) if name.startswith("rate") else 1.0)
            for name in self.states
        ]
        # For an eigenvalue of zero this divides by zero.
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.nan_to_num(vector / sizes, nan=0.0, posinf=np.inf)
        return self.states[int(np.argmax(shares))].removeprefix("rate of ")


def modes(
    scene: Scene,
    t: ArrayLike,
    q: ArrayLike,
    p: ArrayLike,
    integral: ArrayLike,
    *,
    contacts: ArrayLike | None = None,
    formulation: Formulation = "nullspace",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
) -> Modes:
    """Linearises the motion about states, such as the rows of a run.

    Args:
        scene: The scene with parameters and inputs.
        t: Instants (n,), on the clock of schedule and disturbances, s. At a jump of an input, its
            value after the jump counts.
        q, p, integral: As of `Run`, (n, 9), (n, 9) and (n, 2).
        contacts: The contacts (n, 4) in unilateral contact, in whose modes the motion goes on:
            `run.state(k).contact` of each row.
        formulation: The formulation whose states are used; in unilateral contact not "nullspace".
            For the constraints that hold, "csm" adds modes with eigenvalues -alpha, twice for each
            C^H, and -beta for each C^N; "projected" has zeros instead.
        stabilization: As for `simulate`.
    """
    checks.instance("scene", scene, Scene)
    instants = checks.array("t", t, ("n",))
    n = len(instants)
    if (contacts is None) != (scene.contact == "bilateral"):
        rule = "must be given in unilateral contact, and None in bilateral contact"
        raise ValueError(f'contacts with Scene.contact = "{scene.contact}": {rule}')
    own = None if contacts is None else checks.array("contacts", contacts, (n, 4))
    require_known_torque(scene.law, "the linearisation")
    options = Options.checked(formulation=formulation, stabilization=stabilization)
    require_formulations("formulation", (formulation,), scene)
    given = {"q": (q, 9), "p": (p, 9), "integral": (integral, 2)}
    rows = [checks.array(name, value, (n, width)) for name, (value, width) in given.items()]
    jacobian = Request(scene, options).linear_model(instants, *rows, contacts=own)["A"]
    states = state_names(scene.law, options.formulation, branches(scene))
    return Modes(t=instants, jacobian=jacobian, rates=eigenvalues(jacobian), states=states)


def along_run(
    run: Run, formulation: Formulation, stabilization: Stabilization, instants: int = _INSTANTS
) -> Modes:
    """Linearises the motion at evenly spread rows of a run, and beside changes of its contacts.

    Rows in which a tip grazes are left out, because what grows in them ends the graze.
    """
    changed = np.searchsorted(run.t, [change.time for change in run.contact_changes])
    changed = changed[np.linspace(0, len(changed) - 1, min(instants, len(changed))).astype(int)]
    spread = np.linspace(0, len(run) - 1, instants).round().astype(int)
    rows = np.unique(np.clip(np.concatenate([spread, changed - 1, changed]), 0, len(run) - 1))
    contacts = None
    if run.scene.contact == "unilateral":
        contacts = np.array([run.state(row).contact for row in rows.tolist()])
        kept = np.flatnonzero(~grazes(contacts))
        if len(kept):
            rows, contacts = rows[kept], contacts[kept]
    at = run.t[rows], run.q[rows], run.p[rows], run.integral[rows]
    how: Any = {"formulation": formulation, "stabilization": stabilization}
    return modes(run.scene, *at, contacts=contacts, **how)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StableStep(Result):
    """The longest stable step for a scene, a formulation and a method.

    Attributes:
        method: As for `simulate`, and so is `formulation`.
        predicted: Longest step by the eigenvalues along the run and the method's stability region,
            s; inf for a method that is stable for every step.
        t: The instant whose eigenvalues allow the shortest step, s.
        rate: The eigenvalue that limits the step there, 1/s.
        mode: Name of the state with the largest share in the mode of `rate`.
        measured: Longest step with which the run is still right, to half a percent, s; inf if
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

    The predicted step comes from linear theory: the motion is linearised at some 200 instants of an
    accurate run (a stiff method with adaptive steps at tolerance 1e-8), in unilateral contact in
    the modes of each instant and beside each change of them, and the step is the shortest at which
    a decaying mode leaves the method's stability region. Instants at which a tip grazes do not
    count: what grows there ends the graze. The measured step comes from a bisection: it is the
    longest with which the run ends with the accurate run's status, and stays within half of each
    coordinate's largest magnitude of it. Steps of 0.95, 0.9 and 0.8 times its length do so, too.

    A stable step need not be accurate: `advise` finds a step that meets an accuracy.

    Args:
        scene: The scene to simulate. A scene at rest with constant inputs is displaced by a
            billionth of its size and run for at least 4000 steps, so that instability shows.
        method, formulation, stabilization: As for `simulate`.
        measure: Whether to measure the step, besides predicting it.
        max_steps: Largest number of steps of a run in the bisection; if more would be needed,
            `measured` is None. The accurate run takes at most this many steps, or 100 000 if that
            is more; if it does not reach the end, only its part is linearised, nothing is measured,
            and the message says so.
    """
    checks.instance("scene", scene, Scene)
    trial = Options.checked(None, method, formulation, stabilization, ("state",))
    require_formulations("formulation", (formulation,), scene)
    max_steps = checks.integer("max_steps", max_steps, 1, MOST_STEPS)
    measure = checks.boolean("measure", measure)
    most = max(max_steps, _FEWEST_STEPS)
    accurate = accurate_run(scene, formulation, stabilization=stabilization, max_steps=most)
    along = along_run(accurate, formulation, stabilization)
    steps = along.stable_step(method)
    k = int(np.argmin(steps))
    # The eigenvalue that allows the shortest step; the largest if none limits the step.
    rates, predicted = along.rates[k], float(steps[k])
    limits = stable_steps(method, rates) if math.isfinite(predicted) else -np.abs(rates)
    rate = complex(rates[np.argmin(limits)])
    measured, failure = None, ""
    if accurate.status not in ENDS:
        end = f"{accurate.method} with tolerance {ACCURATE:g} ended as {accurate.status}"
        failure = f"the motion is known to t = {accurate.t[-1]:.4g} s only, where {end}"
    elif measure:
        search = StepSearch(accurate, trial, predicted)
        measured, failure = search.longest(max_steps), search.failure
    t, mode = float(along.t[k]), along.leading(k, rate)
    message = _message(method, predicted, t, rate, mode, measured)
    # Both steps may be infinite.
    if measured not in (None, predicted) and not 1.0 / _AGREE < predicted / measured < _AGREE:
        share = float(np.mean(steps < measured))
        some = f"{100 * share:.0f} % of the instants only"
        reason = f"the predicted step is too long for {some}, and the growth there decays again"
        if math.isinf(predicted):
            reason = f"accuracy ends it, not stability: {failure}"
        elif measured <= predicted:
            first = "the motion fails before its linearisation about the right one does"
            reason = f"{first}: {failure}"
        elif share == 1.0:
            reason = "the run has too few steps for the growth to show"
        message += f"; they part because {reason}"
    elif failure and measured is None:
        message += f"; not measured: {failure}"
    return StableStep(
        method=method,
        formulation=formulation,
        predicted=predicted,
        t=t,
        rate=rate,
        mode=mode,
        measured=measured,
        message=message,
    )


class StepSearch:
    """The search for the longest step with which a run follows the accurate run to its end.

    A scene at rest is slightly displaced, because exact symmetry hides unstable modes. `failure` is
    the reason why the last run with too long a step failed.
    """

    def __init__(self, accurate: Run, trial: Options, predicted: float) -> None:
        self.scales = scaled_error.scales("q", accurate.q, scaled_error.usual(accurate.scene))
        self.accurate, self.trial = accurate, trial
        self.scene = accurate.scene
        self.failure = ""
        moved = np.abs(accurate.q - accurate.q[0]) / self.scales
        quiet = not len(accurate.violations) and accurate.stats["segments"] == 1
        if quiet and float(moved.max()) < 1e-6 and math.isfinite(predicted):
            self.scene = self._displaced(_TIME_TO_GROW * predicted)
        self.first = predicted if math.isfinite(predicted) else accurate.scene.duration / 8
        self.first = min(self.first, self.scene.duration)

    def _displaced(self, duration: float) -> Scene:
        scene, start = self.scene, self.scene.start()
        shares = _DISPLACEMENT * np.array([1.0, -0.7, 0.5, 0.8, -0.6, 0.9, -0.4, 0.3, -1.0])
        q, p = np.array(start.q) + shares * self.scales, start.p + shares * self.scales
        # Off the constraints a tip of unilateral contact would be free.
        if self.trial.formulation == "csm" and scene.contact == "bilateral":
            displaced = State(q, p, start.integral, start.time, check=False)
        else:
            at: dict[str, Any] = {"rotation": q[2], "fingers": q[3:5], "shear": q[7:]}
            at |= {"velocity": p[:3], "finger_rates": p[3:5], "integral": start.integral}
            displaced = State.consistent(scene, x=q[0], y=q[1], **at, time=start.time)
        return replace(scene, initial=displaced, duration=max(duration, scene.duration))

    def holds(self, dt: float) -> bool:
        """True if the run with this step follows the accurate run to its end; may set `failure`."""
        every = max(1, int(self.scene.duration / dt) // _ROWS)
        run = computed(Request(self.scene, self.trial).with_(dt=dt, every=every))
        expected = self.accurate
        if run.status != expected.status:
            self.failure = f"with dt = {dt:.3g} s the run ends as {run.status} at {run.t[-1]:.6g} s"
            return False
        # A displaced scene lasts longer than the accurate run, which stays at rest.
        exact = np.stack([np.interp(run.t, expected.t, column) for column in expected.q.T], axis=1)
        errors = scaled_error.by_row(run.q, exact, self.scales)
        k = int(np.argmax(errors))
        if errors[k] < LOST:
            return True
        off = f"a coordinate is {errors[k]:.2g} times its largest size off at {run.t[k]:.6g} s"
        self.failure = f"with dt = {dt:.3g} s {off}"
        return False

    def longest(self, max_steps: int) -> float | None:
        """The longest step, s, of runs with at most so many steps; None if that is too long."""
        duration, first = self.scene.duration, self.first
        least = duration / max_steps
        while True:
            good = largest_that_holds(
                self.holds, first, least, duration, factor=_FACTOR, accuracy=_SHARP
            )
            if good is None:
                self.failure = f"even {max_steps} steps are not enough: {self.failure}"
                return None
            if good == duration:
                return math.inf
            shorter = [share * good for share in _SHORTER if share * good > least]
            failed = next((dt for dt in shorter if not self.holds(dt)), None)
            if failed is None:
                return good
            first = failed / _FACTOR


def _message(
    method: str, predicted: float, t: float, rate: complex, mode: str, measured: float | None
) -> str:
    swing = f" and {abs(rate.imag):.3g} rad/s" if abs(rate.imag) > 1e-3 * abs(rate) else ""
    fastest = f"the mode of {mode} at {rate.real:.3g} 1/s{swing}, t = {t:.4g} s"
    if math.isnan(rate.real):
        fastest = f"rates of the motion that overflow at t = {t:.4g} s"
    text = f"predicted {predicted:.3g} s, by {fastest}"
    if math.isinf(predicted):
        text = f"{method} is stable for every step; fastest is {fastest}"
    if measured is None:
        return text
    found = "no limit: a single step does" if math.isinf(measured) else f"{measured:.3g} s"
    return f"{text}; measured {found}"
