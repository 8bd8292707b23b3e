"""Whether a failed run had too long a step: eigenvalues along the motion, and the longest step.

A healthy run pays nothing for this: only a run that an explicit method with equal steps did not
complete is looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..scene.contact import as_bilateral, without_drift
from ..scene.scene import Scene
from ..support.arrays import Floats
from ..support.choices import Method
from .contact import ContactMode, Modes
from .options import Options

Complexes = NDArray[np.complex128]

# A growth rate below this share of |eigenvalue| counts as zero: without damping, round-off decides
# on which side of the imaginary axis an eigenvalue lies.
_SWINGS = 0.01
# Eigenvalue problems per call of NumPy: some tens of milliseconds.
_MATRICES_PER_CALL = 256
# The run of the stiff method that shows the motion: its tolerance, and its largest number of steps,
# which take about a millisecond.
_TOLERANCE, _MOST = 1e-3, 300
# At most this many rows of the failed run tell how long its steps were.
_MOST_ROWS = 1_000_000
# The motion is linearised at this many of its instants.
_INSTANTS = 10
# The method that the warning recommends.
STIFF: Method = "radau5"


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
    swinging = (rates.real > 0.0) & (rates.real < _SWINGS * np.abs(rates))
    rates = np.where(swinging, 1j * rates.imag, rates)
    steps = _core.stable_step(method, rates.ravel()).reshape(rates.shape)
    return np.asarray(np.where(np.isnan(rates), 0.0, steps))


def is_explicit(method: str) -> bool:
    """Whether a method is stable for short steps only."""
    return bool(np.isfinite(_core.stable_step(method, np.array([-1.0 + 0.0j]))[0]))


def surfaces(scene: Scene, q: Floats, contact: Modes) -> Floats:
    """Jacobians of the tips' surfaces that move by themselves (n, 4, 2, 2), in 1/s; others are 0.

    Where a tip does not stick, its shear obeys m d'' + c d' + k d = force of friction, by (U3) and
    (U5); where it is free, so does its compression, without that force. By (5) k is 2 pi E d_n: of
    the shear exactly, of the compression but for the tilt, and it falls to zero as the surface
    relaxes. The force of friction depends on the shear by the couple of the tip alone, which is
    left out.

    Args:
        scene: The scene.
        q: Coordinates (n, 9), m and rad.
        contact: Modes of both tips (n, 2).

    Returns:
        The derivatives of (rate, acceleration) by (d, rate), in the order of `State.q`: d_n of the
        right and the left tip, d_t of the right and the left tip.
    """
    found = np.zeros((len(q), 4, 2, 2))
    moves = np.hstack([contact == ContactMode.FREE, contact != ContactMode.STICK])
    for k in range(4):
        tip, kind = scene.hand.tips[k % 2], ("normal", "tangential")[k // 2]
        mass = getattr(tip, f"{kind}_mass")
        mass = scene.grasped.mass if mass is None else mass
        found[:, k, 0, 1] = 1.0
        found[:, k, 1, 0] = -2.0 * np.pi * tip.youngs_modulus * q[:, 5 + k % 2] / mass
        found[:, k, 1, 1] = -getattr(tip, f"{kind}_viscosity") / mass
    return np.where(moves[:, :, None, None], found, 0.0)


def too_long(
    scene: Scene,
    options: Options,
    ended: tuple[str, float],
    compute: Callable[[Scene, Options], Mapping[str, Any]],
) -> str | None:
    """Says that the step of a failed run was beyond the stability limit of its method.

    A stiff method computes the motion a little beyond the instant at which the run failed. If it
    fails there too, that is the motion's own end. Otherwise the eigenvalues of the linearised
    motion tell the longest step for which each decaying mode decays in the numerical solution too.
    The longest step that the run took is compared with it, which may be much shorter than `dt`,
    because steps end at each instant at which an input jumps.

    Args:
        scene: The scene.
        options: The options of the run.
        ended: The run's status, and the instant at which it ended, s.
        compute: Computes a run; Ctrl-C raises.

    Returns:
        The warning; None if the run did not fail, its method is stable for every step, or its step
        was not too long.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    status, end = ended
    if options.dt is None or status in ("completed", "interrupted"):
        return None
    if not is_explicit(options.method):
        return None
    how = replace(
        options,
        dt=None,
        tolerance=_TOLERANCE,
        method=STIFF,
        formulation=without_drift(scene) if scene.start().check else options.formulation,
        record=("state", "contact"),
        every=1,
        max_steps=_MOST,
    )
    # The status belongs to the next step if a number overflowed in it.
    duration = min(end - scene.start().time + 2.0 * options.dt, scene.duration)
    motion = compute(replace(scene, duration=duration), how)
    # Short of steps, the method shows the beginning; any other end is the motion's own.
    cut = motion["status"] == "too_many_steps" and motion["t"][-1] < end
    if motion["status"] != "completed" and not cut:
        return None
    steps = _stable(scene, options, motion)
    k = int(np.argmin(steps))
    longest = float(steps[k])
    if not 0.0 < longest < min(options.dt, scene.duration):
        return None
    if longest >= _longest_taken(scene, options, end, compute):
        return None
    confirmed = "which a stiff method does not confirm"
    if cut:
        confirmed = f"and a stiff method looked up to t = {motion['t'][-1]:.4g} s only"
    return (
        f"dt = {options.dt:g} s is beyond {longest:.3g} s, the longest step with which "
        f"{options.method} is stable at t = {motion['t'][k]:.4g} s, and the run ended as "
        f'"{status}" at t = {end:.4g} s, {confirmed}: take '
        f'method="{STIFF}", which is stable for every dt, or dt <= {0.95 * longest:.2g} s'
    )


def _longest_taken(
    scene: Scene,
    options: Options,
    end: float,
    compute: Callable[[Scene, Options], Mapping[str, Any]],
) -> float:
    """The longest step that a run with equal steps took until `end`, s.

    Steps end where inputs jump, so that they may be shorter than `dt`. The run is computed again,
    because its own rows may be far apart. Of a run with over a million steps it is the longest mean
    of some neighbours.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    assert options.dt is not None
    whole = min(options.dt, scene.duration)
    every = 1 + int((end - scene.start().time) / options.dt / _MOST_ROWS)
    again = compute(scene, replace(options, record=(), every=every))
    # The last rows may be closer than `every` steps. A run may fail in its first step.
    taken = np.diff(again["t"]) / every
    return float(taken.max(initial=0.0)) or whole


def _stable(scene: Scene, options: Options, motion: Mapping[str, Any]) -> Floats:
    """The longest stable step at each row of the motion, s; inf in rows that are not looked at.

    Where both tips stick, all modes are looked at; elsewhere only those of the surfaces that move
    by themselves.
    """
    steps = np.full(len(motion["t"]), np.inf)
    rows = np.unique(np.linspace(0, len(steps) - 1, _INSTANTS).round().astype(int))
    sticks = (motion["contact"][rows] == ContactMode.STICK).all(axis=1)
    held = rows[sticks]
    if len(held):
        bilateral = as_bilateral(scene)
        sampled = bilateral.law == "sampled"
        t, q, p, integral = (
            np.ascontiguousarray(motion[name][held]) for name in ("t", "q", "p", "integral")
        )
        jacobian = _core.linearize(
            bilateral.parameters(),
            bilateral.inputs(),
            t,
            q,
            p,
            # The state of a discrete controller is no part of the motion that it holds.
            np.zeros((len(held), 2)) if sampled else integral,
            options.formulation,
            options.stabilization.alpha,
            options.stabilization.beta,
            whole=False,
            # It holds its torques during a step.
            open_loop=sampled,
            frozen=False,
        )["A"]
        rates = eigenvalues(jacobian)
        # Of a pair of conjugates one is enough.
        half = np.where(rates.imag < 0.0, 0.0, rates)
        steps[held] = stable_steps(options.method, half).min(axis=1)
    own = surfaces(scene, motion["q"][rows], motion["contact"][rows])
    alone = stable_steps(options.method, eigenvalues(own.reshape(-1, 2, 2)))
    steps[rows] = np.minimum(steps[rows], alone.reshape(len(rows), -1).min(axis=1))
    return steps
