"""The terms of motion with unilateral contact, as one compiled function of plain floats.

Everything comes out of `lagrangian.model()`. Only the elastic energy is read again: what touches
nothing keeps the tilt that it had at release, so each tip's tilt is an argument of its own here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from .lagrangian import PARAMETERS, SIDES, model, turn

Floats: TypeAlias = NDArray[np.float64]

SIGNS = tuple(s for _, s in SIDES)
# Entries of Phi that are neither zero nor one, row by row: x, y, theta and the finger's own angle.
_ENTRIES = [(row, column) for row in range(4) for column in (0, 1, 2, 3 + row % 2)]
PLACES = np.array([9 * row + column for row, column in _ENTRIES])
_IDENTITY = np.zeros((4, 9))
_IDENTITY[range(4), range(5, 9)] = 1.0
# The derivatives of theta_p by the coordinates, on parallel faces.
TURNING = np.zeros((2, 9))
TURNING[:, 2], TURNING[range(2), range(3, 5)] = SIGNS, 1.0


class Terms(NamedTuple):
    """The terms at one state.

    Attributes:
        phi: (4, 9), rows H_1, H_2, N_1, N_2.
        b: Phi-dot p (4,).
        force: f_0 (9,), all forces without the couples of the tips.
        couples: tau_i = dP/dtheta_pi (2,), N m.
        gaps: C_i^H (2,), m.
        heights: G_i (2,), how far the tip's centre is from the object's, along the face, m; of
            other parts, where the contact is on the side, from the side's middle.
        powers: Of the torques, the external force and the viscosity (negative), W.
        turning: (2, 9), T_i = dtheta_pi/dq.
    """

    phi: Floats
    b: Floats
    force: Floats
    couples: list[float]
    gaps: list[float]
    heights: list[float]
    powers: list[float]
    turning: Floats

    def couple_column(self, i: int) -> Floats:
        """c_i = -tau_i T_i: what the tip's couple does on the object and on the finger."""
        return -self.couples[i] * self.turning[i]


@cache
def tilted_energies() -> tuple[tuple[Any, Any], list[Any]]:
    """The symbols of the two tilts, and each tip's elastic energy as a function of its own."""
    system = model()
    tilts = sp.symbols("tilt1 tilt2", real=True)
    (elastic,) = system.terms["elastic_energy"]
    # A function of angle + s theta: at theta = 0 the angle is the tilt.
    elastic = elastic.subs(system.q[2], 0).subs(dict(zip(system.q[3:5], tilts, strict=True)))
    apart = [elastic.subs({system.q[6 - i]: 0, system.q[8 - i]: 0}) for i in range(2)]
    return tilts, apart


@cache
def _functions() -> tuple[Callable[..., list[float]], Callable[..., list[float]]]:
    """(state, tilts, parameters) -> the terms; and -> kinetic, both elastic, gravity energy."""
    system = model()
    tilts, energies = tilted_energies()
    phi, mass = system.matrix("constraint_matrix"), system.matrix("mass_matrix")
    assert all(mass[i, j] == 0 for i in range(9) for j in range(9) if i != j)
    others = {(i, j) for i in range(4) for j in range(9)} - set(_ENTRIES)
    assert all(float(phi[entry]) == _IDENTITY[entry] for entry in others)

    force = system.matrix("gravity") + system.matrix("viscous")
    force += system.matrix("control") + system.matrix("external")
    force -= sp.Matrix([0] * 5 + [sp.diff(sum(energies), d) for d in system.q[5:]])
    gravity_center = sp.Matrix(system.q[:2])
    face_up = turn(sp.Matrix([sp.cos(system.q[2]), sp.sin(system.q[2])]))
    rates = sp.Matrix(system.p)
    values = [
        *(phi[entry] for entry in _ENTRIES),
        *system.terms["constraint_rate"],
        *force,
        *(sp.diff(energy, tilt) for energy, tilt in zip(energies, tilts, strict=True)),
        *system.terms["residuals"][:2],
        *((gravity_center - center).dot(face_up) for center in system.centers),
        *(system.matrix(name).dot(rates) for name in ("control", "external", "viscous")),
    ]
    sums = [*system.terms["kinetic_energy"], *energies, *system.terms["gravity_energy"]]
    arguments = (system.state, tilts, tuple(system.parameters.values()))
    terms, totals = (
        sp.lambdify(arguments, v, modules="math", cse=True, docstring_limit=0)
        for v in (values, sums)
    )
    return terms, totals


def term_function() -> Callable[..., list[float]]:
    """(state, tilts, parameters) -> the terms as one flat list, as `Mechanics.terms` reads it.

    PLACES says where the first sixteen belong in Phi.
    """
    return _functions()[0]


class Mechanics:
    """The terms and energies of one scene.

    Attributes:
        masses: The diagonal of the mass matrix (9,).
        radii: Of the two tips, m.
        lengths: The coordinates that are lengths.
    """

    lengths = (0, 1, 5, 6, 7, 8)

    def __init__(self, numbers: Mapping[str, float]) -> None:
        """Takes the numbers of `PARAMETERS` by name."""
        self._values = tuple(numbers[name] for name in PARAMETERS)
        self._terms, self._totals = _functions()
        system = model()
        mass = sp.lambdify(
            [tuple(system.parameters.values())], list(system.matrix("mass_matrix").diagonal())
        )
        self.masses = np.array(mass(self._values), dtype=np.float64)
        self.radii = [numbers[f"hand.tip.{side}.radius"] for side, _ in SIDES]

    def terms(
        self, state: Sequence[float], asked: Sequence[float], tilts: Sequence[float]
    ) -> Terms:
        """The terms at one state.

        Args:
            state: q, p and the integrals, twenty floats.
            asked: What `Driven` returns: targets and external force, then what is not read.
            tilts: (2,), of each tip in P: live or frozen.
        """
        flat = self._terms((*state, *asked[:5]), tilts, self._values)
        phi = _IDENTITY.copy()
        phi.put(PLACES, flat[:16])
        return Terms(
            phi,
            np.array(flat[16:20]),
            np.array(flat[20:29]),
            flat[29:31],
            flat[31:33],
            flat[33:35],
            flat[35:38],
            TURNING,
        )

    def tilts(self, state: Sequence[float]) -> list[float]:
        """theta_p of both tips as they are."""
        return [state[3 + i] + s * state[2] for i, s in enumerate(SIGNS)]

    def energies(self, state: Sequence[float], tilts: Sequence[float]) -> list[float]:
        """Kinetic energy, elastic energy of the right and the left tip, gravity energy, J."""
        return self._totals((*state, *[0.0] * 5), tilts, self._values)
