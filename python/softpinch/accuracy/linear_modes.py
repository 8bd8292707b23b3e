"""Linearisations of the motion, along a run or about given states."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..analysis import core_matrices
from ..analysis.states import state_names
from ..run.contact import ContactMode
from ..run.run import Run
from ..run.stiffness import Complexes, eigenvalues, stable_steps, surfaces
from ..scene.contact import as_bilateral, require_bilateral
from ..scene.control import require_known_torque
from ..scene.coordinates import COORDINATES, RATES
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.choices import Formulation, Method
from ..support.display import ShownTable
from ..support.result import Result

# Number of instants of a run at which the motion is linearised.
_INSTANTS = 200
# Eigenvalues below this share of the largest one are zero but for round-off.
_NEUTRAL = 1e-11


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

        It is the longest step for which every decaying mode decays in the numerical solution too.
        Modes that grow physically impose no limit, except slowly growing oscillations, which count
        as undamped. The step is zero where an entry of J overflowed.

        Raises:
            ValueError: The method is unknown.
        """
        method = checks.choice("method", method, _core.METHODS)
        return np.asarray(stable_steps(method, self.rates).min(axis=1))

    def _tables(self) -> Iterator[ShownTable]:
        """The modes at the first instant, the fastest growing one first."""
        if not len(self.t):
            return
        # The neutral directions of a grasp have zero eigenvalues, of which round-off makes others.
        largest = np.abs(self.rates[0]).max()
        rates = np.where(np.abs(self.rates[0]) <= _NEUTRAL * largest, 0.0, self.rates[0])
        # Of conjugate pairs, the one that turns forwards.
        order = sorted(rates[~(rates.imag < 0.0)].tolist(), key=lambda rate: -rate.real)
        rows = []
        for rate in order:
            size = abs(rate)
            rows.append(
                (
                    _name(self, rate),
                    rate.real,
                    rate.imag / (2.0 * math.pi),
                    -rate.real / size if size else "",
                )
            )
        columns = ("largest share", "growth [1/s]", "frequency [Hz]", "damping ratio")
        yield ShownTable(columns, rows, f"The modes at t = {self.t[0]:.6g} s")

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


def _name(modes: Modes, rate: complex) -> str:
    """The name of a mode at the first instant."""
    if rate == 0.0:
        return "neutral"
    return modes.leading(0, rate) if cmath.isfinite(rate) else "an overflow"


def modes(
    scene: Scene,
    t: ArrayLike,
    q: ArrayLike,
    p: ArrayLike,
    integral: ArrayLike,
    *,
    formulation: Formulation = "nullspace",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
) -> Modes:
    """Linearises the motion about states, such as the rows of a run.

    Args:
        scene: The scene with parameters and inputs, with bilateral contact.
        t: Instants (n,), on the clock of schedule and disturbances, s. At a jump of an input, its
            value after the jump counts.
        q: Coordinates (n, 9), m and rad.
        p: Velocities (n, 9), m/s and rad/s.
        integral: PID integrals (n, 2), rad s.
        formulation: The formulation whose states are used. "csm" adds modes with eigenvalues
            -alpha, twice for each C^H, and -beta for each C^N; "projected" has zeros instead.
        stabilization: The gains of (19) and (20), for "csm".

    Raises:
        ValueError: A shape is wrong, a number is not finite, `formulation` is unknown, or the scene
            has unilateral contact.
        TypeError: An argument is of the wrong kind.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    require_bilateral(
        scene,
        "modes",
        'linearises bilateral contact only; replace(scene, contact="bilateral") has the motion '
        "while both tips stick",
    )
    formulation = checks.choice("formulation", formulation, _core.FORMULATIONS)
    instants = checks.array("t", t, ("n",))
    n = len(instants)
    require_known_torque(scene.law, "the linearisation")
    jacobian = core_matrices.along(
        scene,
        instants,
        checks.array("q", q, (n, 9)),
        checks.array("p", p, (n, 9)),
        checks.array("integral", integral, (n, 2)),
        formulation,
        stabilization,
    )
    states = state_names(scene.law, formulation)
    return Modes(t=instants, jacobian=jacobian, rates=eigenvalues(jacobian), states=states)


def along_run(
    run: Run, formulation: Formulation, stabilization: Stabilization, instants: int = _INSTANTS
) -> Modes:
    """Linearises the motion at evenly spread rows of a run, including its start and end.

    In unilateral contact the rows in which both tips stick have the linearisation of bilateral
    contact. The others have only the motion of the surfaces that move by themselves (`surfaces`),
    the shear of a tip that slips, grazes or is free and the compression of a free one, and zeros
    for the states whose rates are not known there.
    """
    rows = np.unique(np.linspace(0, len(run) - 1, instants).round().astype(int))
    found = modes(
        as_bilateral(run.scene),
        run.t[rows],
        run.q[rows],
        run.p[rows],
        run.integral[rows],
        formulation=formulation,
        stabilization=stabilization,
    )
    if run.scene.contact == "bilateral":
        return found
    contacts = [run.state(row).contact for row in rows.tolist()]
    modes_of_tips = np.abs(np.array(contacts)[:, :2]).astype(np.uint8)
    return _by_contact(found, modes_of_tips, surfaces(run.scene, run.q[rows], modes_of_tips))


def _by_contact(found: Modes, contacts: NDArray[np.uint8], own: Floats) -> Modes:
    """Replaces the rows in which a tip does not stick.

    Args:
        found: The modes of bilateral contact.
        contacts: The modes of both tips (n, 2).
        own: The result of `surfaces` (n, 4, 2, 2).
    """
    n, size = found.rates.shape
    jacobian = np.zeros((n, size + 8, size + 8))
    sticks = (contacts == ContactMode.STICK).all(axis=1)
    jacobian[:, :size, :size] = np.where(sticks[:, None, None], found.jacobian, 0.0)
    for k in range(4):
        block = slice(size + 2 * k, size + 2 * k + 2)
        jacobian[:, block, block] = own[:, k]
    alone = [name for k in range(5, 9) for name in (COORDINATES[k], RATES[k])]
    return replace(
        found,
        jacobian=jacobian,
        rates=eigenvalues(jacobian),
        states=(*found.states, *alone),
    )
