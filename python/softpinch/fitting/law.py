"""`fit_law`: the law of a tip from a measured curve of force over compression."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..scene.parts import MeasuredLaw, ParallelSprings, PowerLaw, measured_curve
from ..support import checks
from ..support.arrays import Floats
from ..support.extras import require
from ..support.result import Result
from .result import LEVEL, reach


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LawFit(Result):
    """A law of a tip that was fitted to a measured curve.

    Attributes:
        law: The law, for `Fingertip(law=...)`.
        compression: The measured d_n, m; `force` is the measured F, N, (k,) each.
        fitted: The law's F at these compressions (k,), N.
        names: The law's fitted numbers, which have the `values`; none of a `MeasuredLaw`.
        intervals: Intervals of 95 % about them (numbers, 2), from the scatter of the forces, which
            is taken as equal and independent.
        misfit: The largest difference between fitted and measured forces over the largest force.
    """

    law: ParallelSprings | PowerLaw | MeasuredLaw
    compression: Floats
    force: Floats
    fitted: Floats
    names: tuple[str, ...]
    values: Floats
    intervals: Floats
    misfit: float

    def _curve(self, compression: Floats) -> Floats:
        """The law's force at compressions within the measured range, N."""
        law = self.law
        if isinstance(law, MeasuredLaw):
            return law.predicted(compression)
        if isinstance(law, ParallelSprings):
            return np.asarray(np.pi * law.youngs_modulus * compression**2)
        return law.coefficient * _power(compression, law.exponent, law.foot or 0.0)

    def __repr__(self) -> str:
        rows = zip(self.names, self.values, self.intervals, strict=True)
        found = "".join(f"{name} = {v:.4g} [{a:.4g}, {b:.4g}], " for name, v, (a, b) in rows)
        return f"<LawFit {type(self.law).__name__}: {found}misfit {self.misfit:.2%}>"


def fit_law(
    compression: ArrayLike, force: ArrayLike, kind: str = "power", *, foot: float | None = None
) -> LawFit:
    """Fits the law of a tip to forces that an upright tip was measured to have.

        >>> import numpy as np, softpinch as sp
        >>> d = np.array([1e-3, 2e-3, 4e-3, 6e-3, 8e-3])
        >>> sp.fit_law(d, 2e5 * d**1.8).law.exponent.__round__(6)
        1.8

    A motion of a scene is fitted by `fit`. Needs the extra `study`.

    Args:
        compression, force: d_n, m, and F, N, as of a `MeasuredLaw` (k,).
        kind: "springs", F = pi E d_n^2; "power", F = c d_n^n, n > 1; or "measured", `MeasuredLaw`.
        foot: The foot of a power law, m; a law with n < 2 needs one where its tip is released.
    """
    checks.choice("kind", kind, ("springs", "power", "measured"))
    d, f = measured_curve("", compression, force)
    foot = 0.0 if foot is None else checks.non_negative("foot", foot)
    if foot and kind != "power":
        raise ValueError(f'foot = {foot}: is of kind = "power" only')
    law: ParallelSprings | PowerLaw | MeasuredLaw
    names: tuple[str, ...] = ()
    values, intervals = np.empty(0), np.empty((0, 2))
    if kind == "measured":
        law = MeasuredLaw(d, f)
        fitted = law.predicted(d)
    elif kind == "power":
        names = ("coefficient", "exponent")
        values, intervals, fitted = _fitted(d, f, 2, foot)
        if values[1] < 1.0 + 1e-6:
            rule = f"best as a power of {values[1]:.3g}: must be convex, without saturation"
            raise ValueError(f"force: {rule}")
        law = PowerLaw(float(values[0]), float(values[1]), foot or None)
    else:
        names = ("youngs_modulus",)
        coefficient, ends, fitted = _fitted(d, f, 1, foot)
        values, intervals = coefficient / np.pi, ends / np.pi
        law = ParallelSprings(float(values[0]))
    return LawFit(
        law=law, compression=d, force=f, fitted=fitted, names=names, values=values,
        intervals=intervals, misfit=float(np.abs(fitted - f).max() / f.max()),
    )  # fmt: skip


def _power(d: Floats, n: float, foot: float) -> Floats:
    """The force of a `PowerLaw` with the coefficient one."""
    return np.asarray((d + foot) ** n - foot**n - n * foot ** (n - 1.0) * d)


def _fitted(d: Floats, f: Floats, count: int, foot: float) -> tuple[Floats, Floats, Floats]:
    """Values and intervals of c, and of n unless it is 2, and the forces of the best power law."""
    optimize: Any = require("scipy.optimize", extra="study", purpose="fit_law")

    def curve(u: Floats) -> Floats:
        return np.asarray(np.exp(u[0]) * _power(d, u[1] if count == 2 else 2.0, foot))

    # The straight line through the logarithms is near.
    slope, level = np.polyfit(np.log(d), np.log(f), 1)
    begin = [level, max(slope, 1.01)] if count == 2 else [np.mean(np.log(f / d**2))]
    best = optimize.least_squares(
        lambda u: (curve(u) - f) / f.max(), begin, bounds=([-np.inf, 1.0 + 1e-9][:count], np.inf),
        x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14,
    )  # fmt: skip
    spare = len(d) - count
    scatter = np.linalg.inv(best.jac.T @ best.jac) * (2.0 * best.cost / spare)
    ends = best.x[:, None] + np.sqrt(np.diag(scatter))[:, None] * reach(LEVEL, spare) * [-1.0, 1.0]
    values, intervals = best.x.copy(), ends
    values[0], intervals[0] = np.exp(values[0]), np.exp(intervals[0])
    return values, intervals, curve(best.x)
