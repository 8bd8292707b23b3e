"""Warnings of runs that their steps, or the loop of their controller, made unstable.

A healthy run pays nothing for this. Runs of explicit methods with equal steps are looked at if they
did not complete, or if a bound on the rates of the motion lets their steps be too long; runs under
a `SampledController` if they failed.
"""

import math
from collections.abc import Container, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from .. import _core
from ..scene import SampledController, Schedule
from ..scene.contact import without_drift
from ..scene.loop_matrix import common_period, measured, spectral_radius
from ..scene.scene import Scene, inputs
from ..support.arrays import Complexes, Floats
from ..support.choices import Method
from .contact import ContactMode, grazes
from .options import Options
from .request import Request

# A growth rate below this share of |eigenvalue| counts as zero: without damping, round-off decides
# on which side of the imaginary axis an eigenvalue lies.
_SWINGS = 0.01
# Friction makes the stiffness of a slip unsymmetric: near the critical friction its rates exceed
# the bound. In one of 2500 random hands they did, by 8 %. Runs with slips are looked at from this
# share of the step on that is stable by the bound.
_SHARE_OF_SLIPS = 0.5
# Eigenvalue problems per call of NumPy: some tens of milliseconds.
_MATRICES_PER_CALL = 256
# Tolerance and largest number of steps, some milliseconds, of the run that shows the motion.
_TOLERANCE, _MOST = 1e-3, 1000
# At most this many rows of the failed run tell how long its steps were.
_MOST_ROWS = 1_000_000
# The motion is linearised at this many of its instants, and where compressions are extreme.
_INSTANTS = 10
# The method that the warning recommends.
STIFF: Method = "radau5"
# The ends that an unstable loop does not explain: the run was stopped.
_STOPPED = ("completed", "interrupted", "too_many_steps")
# The motion is linearised at this many rows of the run, of about so many.
_LOOP_INSTANTS, _LOOP_ROWS = 9, 1000
# The loop is named if a deviation has grown so much by the end of the run.
GROWN = 10.0
# Measure -> its rows among the core's linear outputs; targets have none.
MEASURED: Mapping[str, list[int]] = {
    "angle": [3, 4],
    "angle_error": [3, 4],
    "angle_rate": [18, 19],
    "position": [0, 1],
    "velocity": [15, 16],
    "rotation": [2],
    "rotation_rate": [17],
    "compression": [5, 6],
    "shear": [7, 8],
    "multipliers": [9, 10, 11, 12],
}


def eigenvalues(jacobian: Floats) -> Complexes:
    """Eigenvalues (n, states) of matrices (n, states, states); NaN where an entry is not finite."""
    rates = np.full(jacobian.shape[:2], complex(np.nan, np.nan))
    finite = np.flatnonzero(np.isfinite(jacobian).all(axis=(1, 2)))
    # Python delivers signals, such as Ctrl-C, only between calls to NumPy.
    for first in range(0, len(finite), _MATRICES_PER_CALL):
        block = finite[first : first + _MATRICES_PER_CALL]
        rates[block] = np.linalg.eigvals(jacobian[block])
    return rates


def stable_steps(method: str, rates: Complexes) -> Floats:
    """The longest stable step for each eigenvalue, in the shape of `rates`, s.

    Modes that grow physically impose no limit, except slowly growing oscillations, which count as
    undamped. The step is zero where an eigenvalue is NaN.
    """
    rates = _undamped(rates)
    steps = _core.stable_step(method, rates.ravel()).reshape(rates.shape)
    return np.asarray(np.where(np.isnan(rates), 0.0, steps))


@cache
def least_reach(method: str) -> float:
    """The least distance from 0 to the border of the stability region in the left half-plane."""
    directions = 1j * np.exp(1j * np.linspace(0.0, 0.5 * math.pi, 91))
    return float(stable_steps(method, directions).min())


def _largest(matrices: Floats) -> float:
    """A bound on |eigenvalue| of matrices (n, m, m), at most some tens of percent above it.

    |eigenvalue|^64 is at most the norm of the power (Gelfand). Inf or NaN where it overflows.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(6):
            matrices = matrices @ matrices
        return float(np.sqrt((matrices**2).sum(axis=(1, 2)).max()) ** (1.0 / 64.0))


def strictest_steps(method: str, rates: Complexes) -> Floats:
    """The least of `stable_steps` in each row of eigenvalues (n, states), (n,), s."""
    # A stability region reaches less than twice as far in one direction of the left half-plane as
    # in another, so an eigenvalue below half of the largest one decides nothing.
    rates = _undamped(rates)
    sizes = np.abs(rates)
    largest = np.where(rates.real > 0.0, 0.0, sizes).max(axis=1, keepdims=True)
    steps: Floats = stable_steps(method, np.where(sizes < 0.5 * largest, 0.0, rates)).min(axis=1)
    return steps


def _undamped(rates: Complexes) -> Complexes:
    swinging = (rates.real > 0.0) & (rates.real < _SWINGS * np.abs(rates))
    return np.where(swinging, 1j * rates.imag, rates)


def is_explicit(method: str) -> bool:
    """True if a method is stable for short steps only."""
    return bool(np.isfinite(_core.stable_step(method, np.array([-1.0 + 0.0j]))[0]))


def needs_a_look(ratio: float, scene: Scene, seen: Container[str]) -> bool:
    """True if the steps of a completed run may have been too long, so that `too_long` should say.

    `ratio` is the step of the run by the one that is stable by a bound on the rates, and `seen`
    has the names of violations. Beyond the rim of a tip the bound does not hold.
    """
    if "rim" in seen:
        return ratio > 0.0
    slips = scene.contact == "unilateral" and "slipping" in seen
    return ratio > (_SHARE_OF_SLIPS if slips else 1.0)


def too_long(request: Request, status: str, end: float) -> str | None:
    """Returns a warning if the step of a run was beyond the stability limit of its method, or None.

    A stiff method computes the motion a little beyond the instant `end` at which the run ended with
    `status`. If it fails there too, that is the motion's own end, unless the run's energy ledger
    has shown that its steps were unstable. Otherwise the longest step that the run took is compared
    with the longest stable one, by the eigenvalues of the linearised motion.
    """
    scene, options = request.scene, request.options
    if options.dt is None or status == "interrupted" or not is_explicit(options.method):
        return None
    # The status belongs to the next step if a number overflowed in it.
    duration = min(end - scene.start().time + 2.0 * options.dt, scene.duration)
    motion = request.with_(
        replace(scene, duration=duration) if duration < scene.duration else scene,
        dt=None,
        tolerance=_TOLERANCE,
        method=STIFF,
        formulation=without_drift(scene) if scene.start().check else options.formulation,
        record=("state", "contact"),
        times=None,
        every=1,
        max_steps=_MOST,
    ).run_to_end()
    # A run that used up its steps still shows the start; another early end is the motion's own.
    cut = motion["status"] == "too_many_steps" and motion["t"][-1] < end
    if motion["status"] != "completed" and not cut and status != "unstable":
        return None
    steps = _stable(request, motion)
    k = int(np.argmin(steps))
    longest = float(steps[k])
    if not 0.0 < longest < min(options.dt, scene.duration):
        return None
    # The run is computed again, because its own rows may be far apart.
    every = 1 + int((end - scene.start().time) / options.dt / _MOST_ROWS)
    again = request.with_(record=(), times=None, every=every).run_to_end()
    # Inputs may shorten steps, and the last rows may be closer than `every` of them. A run may fail
    # in its first step.
    taken = float(np.diff(again["t"]).max(initial=0.0)) / every
    if longest >= (taken or min(options.dt, scene.duration)):
        return None
    about = {
        "completed": "the run completed, but modes that should decay grow in it",
        "unstable": f'the run ended as "unstable" at t = {end:.6g} s: by its energy ledger it is '
        "not the motion",
    }.get(
        status,
        f'the run ended as "{status}" at t = {end:.6g} s, which a stiff method does not confirm',
    )
    if cut:
        about += f" (a stiff method looked up to t = {motion['t'][-1]:.6g} s only)"
    return (
        f"dt = {options.dt:g} s is beyond {longest:.3g} s, the longest step with which "
        f"{options.method} is stable at t = {motion['t'][k]:.6g} s, and {about}: take "
        f'method="{STIFF}", which is stable for every dt, or dt <= {0.95 * longest:.2g} s'
    )


def _stable(request: Request, motion: Mapping[str, Any]) -> Floats:
    """The longest stable step at each row of the motion, s; inf in rows that are not looked at.

    All are inf if a bound on the eigenvalues shows that the steps of the run are stable.
    """
    scene, method, dt = request.scene, request.options.method, request.options.dt
    assert dt is not None
    steps = np.full(len(motion["t"]), np.inf)
    # Some rows, and in each mode those with the extreme compressions: where it is most compressed a
    # tip is stiffest, and where it is least, its viscosity counts most.
    some = set(np.linspace(0, len(steps) - 1, _INSTANTS).round().astype(int).tolist())
    for tip in range(2):
        compression, modes = motion["q"][:, 5 + tip], motion["contact"][:, tip]
        for mode in np.unique(modes):
            own = np.flatnonzero(modes == mode)
            some |= {int(own[f(compression[own])]) for f in (np.argmin, np.argmax)}
    rows = np.array(sorted(some))
    # A discrete controller holds its torques during a step; its state is no part of the motion.
    sampled = scene.law == "sampled"
    names = ("t", "q", "p", "integral")
    t, q, p, integral = (np.ascontiguousarray(motion[name][rows]) for name in names)
    integral = np.zeros((len(rows), 2)) if sampled else integral
    contacts = None if motion["contacts"] is None else motion["contacts"][rows]
    found = request.linear_model(t, q, p, integral, contacts=contacts, open_loop=sampled)
    if _largest(dt * found["A"]) < least_reach(method):
        return steps
    rates = eigenvalues(found["A"])
    if contacts is not None:
        # What grows while a tip grazes ends the graze.
        rates[grazes(contacts)] = 0.0
    # Of a pair of conjugates one is enough.
    half = np.where(rates.imag < 0.0, 0.0, rates)
    steps[rows] = strictest_steps(method, half)
    return steps


def unstable(request: Request, status: str, end: float) -> str | None:
    """Says that a run failed under a sampled controller whose loop is unstable; see `too_long`.

    The median of the spectral radii about states in which both tips stick must let a deviation grow
    tenfold or more until the end of the run.
    """
    scene, options = request.scene, request.options
    control = scene.control
    if status in _STOPPED or not isinstance(control, SampledController):
        return None
    lasted = end - scene.start().time
    period, _ = common_period(control)
    if lasted < period:
        return None
    every = 1 if options.dt is None else max(1, int(lasted / options.dt / _LOOP_ROWS))
    record = ("state", "torque", "contact")
    motion = request.with_(record=record, every=every, times=None).run_to_end()
    rows = np.flatnonzero((motion["contact"] == ContactMode.STICK).all(axis=1))
    rows = rows[np.linspace(0, len(rows) - 1, min(_LOOP_INSTANTS, len(rows))).round().astype(int)]
    names = ("t", "q", "p", "torque")
    radii: list[float] = []
    with suppress(ValueError):  # a measure decides which gains act
        radii = [radius(scene, *(motion[name][row] for name in names)) for row in rows]
    found = float(np.median(radii)) if radii else math.nan
    if not math.log(max(found, 1.0)) * lasted / period >= math.log(GROWN):
        return None
    return (
        f'the run ended as "{status}" at t = {end:.4g} s, and the likely cause is its '
        f"SampledController, whose loop is unstable: by the linearised motion deviations grow by "
        f"a factor of {found:.4g} in each sampling period of {period:g} s (the spectral "
        "radius of the loop); lower the gains, or shorten the period and the delay"
    )


def radius(scene: Scene, t: float, q: Floats, p: Floats, torque: Floats) -> float:
    """The spectral radius of the loop in its common period, about a state; nan if it overflows.

    It is at least 1, because a grasp at rest has two neutral states. `torque` (2,), N m, acts.
    """
    assert isinstance(scene.control, SampledController)
    control = scene.control.gains_at(t)
    held = inputs(Schedule.steps([0.0], [torque]), scene.disturbances, "torque")
    plant = Request(scene, Options.checked(formulation="nullspace")).linear_model(
        np.array([t]), q[None], p[None], np.zeros((1, 2)), inputs=held, whole=True, open_loop=True
    )
    a, b, c, d = plant["A"][0], plant["B"][0][:, :2], plant["C"][0], plant["D"][0][:, :2]
    return spectral_radius(control, a, b, measured(control, MEASURED, c, d))
