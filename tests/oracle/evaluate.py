"""Every term of the equations of motion at one state, to 50 digits, each with its own scale.

Round-off is proportional to the terms that are added, not to their sum. So each quantity comes
with a companion of the same shape, its scale, and a test asks |core - oracle| <= 1e-11 * scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import prod
from typing import Any, TypeAlias

import numpy as np
from mpmath import mp, mpf
from numpy.typing import NDArray

from .lagrangian import FORCES, PARAMETERS, SHAPES, SIDES, compiled

Floats: TypeAlias = NDArray[np.float64]
DIGITS = 50
_UNDERFLOW = 1e-300


@dataclass(frozen=True, eq=False)
class Quantity:
    """A value, correctly rounded to doubles, and the sum of the absolute terms behind it."""

    value: Floats
    scale: Floats

    def difference(self, other: Any) -> float:
        """The largest |other - value| / scale over the entries; inf for a shape that differs.

        Where the scale is zero there are no terms: the value is zero and `other` must be, too.
        """
        other = np.asarray(other, dtype=np.float64)
        if other.shape != self.value.shape:
            return float("inf")
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # What has gone below the smallest doubles on its way has lost digits there.
            ratio = np.abs(other - self.value) / (self.scale + _UNDERFLOW)
        ratio = np.where(other == self.value, 0.0, ratio)
        return float(np.max(np.nan_to_num(ratio, nan=np.inf, posinf=np.inf), initial=0.0))


@dataclass(frozen=True, eq=False)
class Oracle:
    """Every term at one state; the order of coordinates and constraints is the core's.

    "Terms" are the additive terms of the expression that SymPy derived, multiplied out. M is
    diagonal, A = Phi M^-1 Phi^T, and |.| of a matrix is entry by entry. The scales are:

    - mass_matrix, constraint_matrix, constraint_rate (b), residuals (C^H, C^N), residual_rates (of
      C^H), the five forces and the three energies: the sum of |terms| of each entry.
      But gravity on a finger has m g L: the sine of its angle has the round-off of 1, since it may
      be taken from the sines of the tilt and of the object's angle.
    - force, the five together: the sum of their scales.
    - multipliers: |A^-1| (gamma's scale + scale(Phi) M^-1 scale(force)), with gamma^H's scale that
      of b + 2 alpha times that of the rate of C^H + alpha^2 times that of C^H, and gamma^N's that
      of b + beta times that of C^N.
    - accelerations: M^-1 (scale(force) + scale(Phi)^T scale(multipliers)).

    Not in these scales is that A has terms of its own: a solver that forms A in doubles, however
    well it then solves, is off by up to round-off times `loss` = |A^-1| S |lambda|, S = scale(Phi)
    M^-1 scale(Phi)^T, which is more where A is close to singular (a tiny inertia, a heavy tip).
    One that doesn't form A needs no such allowance.
    """

    mass_matrix: Quantity
    constraint_matrix: Quantity
    constraint_rate: Quantity
    residuals: Quantity
    residual_rates: Quantity
    elastic: Quantity
    gravity: Quantity
    viscous: Quantity
    control: Quantity
    external: Quantity
    force: Quantity
    kinetic_energy: Quantity
    elastic_energy: Quantity
    gravity_energy: Quantity
    multipliers: Quantity
    accelerations: Quantity
    loss: Quantity

    def differences(self, other: Mapping[str, Any], forming_a: bool = False) -> dict[str, float]:
        """`Quantity.difference` for each name that `other` has too, such as `_core.evaluate`'s.

        Args:
            other: Name -> array or number.
            forming_a: Whether `loss` is added to the scale of the multipliers, and M^-1
                scale(Phi)^T `loss` to that of the accelerations.
        """
        quantities = {f.name: getattr(self, f.name) for f in fields(self)}
        if forming_a:
            loss, masses = self.loss.value, np.diag(self.mass_matrix.value)
            losses = {
                "multipliers": loss,
                "accelerations": loss @ self.constraint_matrix.scale / masses,
            }
            for name, more in losses.items():
                quantity = quantities[name]
                quantities[name] = Quantity(quantity.value, quantity.scale + more)
        return {
            name: quantity.difference(other[name])
            for name, quantity in quantities.items()
            if name in other
        }


def parameters(scene: Any) -> dict[str, float]:
    """The numbers of `PARAMETERS` from a scene's attributes."""
    result = {}
    for k, (side, _) in enumerate(SIDES):
        tip, pid = (
            pair[k] if isinstance(pair, tuple | list) else pair
            for pair in (scene.hand.tip, scene.control)
        )
        records = {f"hand.{side}.": getattr(scene.hand, side), f"hand.tip.{side}.": tip}
        for prefix, record in {**records, f"control.{side}.": pid}.items():
            names = [n.removeprefix(prefix) for n in PARAMETERS if n.startswith(prefix)]
            for name in names:
                value = getattr(record, name)
                # (14): the paper gives the tips the object's mass.
                result[prefix + name] = float(scene.grasped.mass if value is None else value)
    for name in ("width", "mass", "inertia", "com_offset"):
        result[f"grasped.{name}"] = float(getattr(scene.grasped, name))
    return {**result, "gravity": float(scene.gravity)}


def evaluate(
    parameters: Mapping[str, float],
    q: Sequence[float] | Floats,
    p: Sequence[float] | Floats,
    integral: Sequence[float] | Floats = (0.0, 0.0),
    target: Sequence[float] | Floats = (0.0, 0.0),
    external: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    alpha: float = 0.0,
    beta: float = 0.0,
) -> Oracle:
    """Evaluates every term, and (24) as one system of multipliers and accelerations.

    Args:
        parameters: By the dotted names of `PARAMETERS`, SI; others (friction) are left aside.
        q: (9,), need not be on the constraints.
        p: (9,).
        integral: (2,), of the angles' errors.
        target: (2,), desired angles.
        external: (3,), F_x, F_y and moment.
        alpha: Of (19); zero, with beta zero, gives the motion without stabilisation.
        beta: Of (20).
    """
    with mp.workdps(DIGITS):
        state = [mpf(float(v)) for part in (q, p, integral, target, external) for v in part]
        numbers = [mpf(float(parameters[name])) for name in PARAMETERS]
        flat = list(compiled("mpmath", True)(state, numbers))
        half = len(flat) // 2
        value, scale = _split(flat[:half]), _split(flat[half:])
        for k, (side, _) in enumerate(SIDES):
            names = (f"hand.{side}.mass", f"hand.{side}.length", "gravity")
            scale["gravity"][3 + k] = prod(mpf(float(parameters[name])) for name in names)
        a, b = mpf(float(alpha)), mpf(float(beta))
        for terms in (value, scale):
            terms["force"] = [sum(column) for column in zip(*map(terms.get, FORCES), strict=True)]
            terms["gamma"] = _gamma(terms, a, b)
        mass = value["mass_matrix"][::10]
        phi = _rows(value["constraint_matrix"])
        value["accelerations"], value["multipliers"] = _solve_motion(value, phi)

        phi_scale = _rows(scale["constraint_matrix"])
        size = [f / m for f, m in zip(scale["force"], mass, strict=True)]
        right = [g + _dot(row, size) for g, row in zip(scale["gamma"], phi_scale, strict=True)]
        inverse = _inverse_of_a(phi, mass)
        scale["multipliers"] = [_dot(map(abs, row), right) for row in inverse]
        sizes = [abs(v) for v in value["multipliers"]]
        spread = [
            _dot(column, sizes) / m
            for column, m in zip(zip(*phi_scale, strict=True), mass, strict=True)
        ]
        terms_of_a = [_dot(row, spread) for row in phi_scale]
        value["loss"] = scale["loss"] = [_dot(map(abs, row), terms_of_a) for row in inverse]
        scale["accelerations"] = [
            (f + _dot(column, scale["multipliers"])) / m
            for f, m, column in zip(scale["force"], mass, zip(*phi_scale, strict=True), strict=True)
        ]
        shapes = SHAPES | {"force": (9,), "multipliers": (4,), "accelerations": (9,), "loss": (4,)}
        return Oracle(
            **{
                f.name: Quantity(
                    _floats(value[f.name], shapes[f.name]), _floats(scale[f.name], shapes[f.name])
                )
                for f in fields(Oracle)
            }
        )


def _split(flat: list[Any]) -> dict[str, list[Any]]:
    """The flat list by name."""
    result, at = {}, 0
    for name, shape in SHAPES.items():
        result[name] = flat[at : at + prod(shape)]
        at += prod(shape)
    return result


def _gamma(terms: dict[str, list[Any]], alpha: Any, beta: Any) -> list[Any]:
    """gamma of (22, 23), from values or from scales."""
    residuals, rates = terms["residuals"], terms["residual_rates"]
    stabilisation = [
        *(2 * alpha * rates[i] + alpha**2 * residuals[i] for i in range(2)),
        *(beta * residuals[i] for i in (2, 3)),
    ]
    return [b + more for b, more in zip(terms["constraint_rate"], stabilisation, strict=True)]


def _solve_motion(value: dict[str, list[Any]], phi: list[list[Any]]) -> tuple[list[Any], list[Any]]:
    """(24) without its trivial rows: [M, -Phi^T; -Phi, 0] [p'; lambda] = [f; gamma]."""
    matrix = _rows(value["mass_matrix"])
    rows = [[*matrix[j], *(-phi[i][j] for i in range(4))] for j in range(9)]
    rows += [[*(-entry for entry in row), 0, 0, 0, 0] for row in phi]
    solution = [row[0] for row in _solve(rows, [[v] for v in (*value["force"], *value["gamma"])])]
    return solution[:9], solution[9:]


def _inverse_of_a(phi: list[list[Any]], mass: list[Any]) -> list[list[Any]]:
    a = [
        [_dot(row, [v / m for v, m in zip(other, mass, strict=True)]) for other in phi]
        for row in phi
    ]
    return _solve(a, [[mpf(i == j) for j in range(4)] for i in range(4)])


def _solve(matrix: list[list[Any]], right: list[list[Any]]) -> list[list[Any]]:
    """Gauss-Jordan with row pivoting: mp.lu_solve, but on lists and past zeros, so much faster."""
    n = len(matrix)
    rows = [[*row, *more] for row, more in zip(matrix, right, strict=True)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        head = rows[k]
        for i in range(n):
            if i != k and rows[i][k]:
                factor = rows[i][k] / head[k]
                rows[i][k:] = [
                    v - factor * w if w else v for v, w in zip(rows[i][k:], head[k:], strict=True)
                ]
    return [[v / row[i] for v in row[n:]] for i, row in enumerate(rows)]


def _dot(left: Any, right: Any) -> Any:
    return sum((a * b for a, b in zip(left, right, strict=True) if a and b), mpf(0))


def _rows(flat: list[Any]) -> list[list[Any]]:
    return [flat[i : i + 9] for i in range(0, len(flat), 9)]


def _floats(values: list[Any], shape: tuple[int, ...]) -> Floats:
    return np.array([float(v) for v in values], dtype=np.float64).reshape(shape)
