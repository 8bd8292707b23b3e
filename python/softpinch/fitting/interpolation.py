"""A run's quantities at measured instants, as linear functions of its recorded rows.

Because they are linear, the same weights take the derivatives of the rows to those of the values.
"""

from __future__ import annotations

import numpy as np

from ..run.measures import jumps
from ..run.run import Run
from ..support.arrays import Floats


class Interpolation:
    """Weights of the two rows around each instant.

    Positions are on the cubic that has q and p of both rows (Hermite), with an error of order 4 in
    the step, and rates on its derivative, of order 3. An impulse changes p at a row, which has the
    value before it; the step from there has the parabola of both q and the later p, and loses one
    order. Multipliers and torques are interpolated linearly, with an error of order 2. They jump
    where an input does, and the row has the value after the jump; within the step up to there they
    keep their value at its start, with an error of order 1.
    """

    def __init__(self, run: Run, times: Floats) -> None:
        """Takes a run with recorded state that includes the times (n,), s."""
        t = run.t
        self._left = np.clip(np.searchsorted(t, times, side="left") - 1, 0, len(t) - 1)
        self._right = np.minimum(self._left + 1, len(t) - 1)
        begin = t[self._left]
        step = t[self._right] - begin
        step[step == 0.0] = 1.0
        s = (times - begin) / step
        r = 1.0 - s
        # Of q and p at the left row, and of both at the right row.
        self._of_q = np.array(
            [r * r * (1.0 + 2.0 * s), step * s * r * r, s * s * (1.0 + 2.0 * r), -step * s * s * r]
        )
        turn = 6.0 * s * r / step
        self._of_p = np.array([-turn, r * (r - 2.0 * s), turn, s * (s - 2.0 * r)])
        kicked = np.isin(begin, _impulses(run)) & (s > 0.0)
        zero = np.zeros_like(s)
        self._of_q[:, kicked] = np.array([r * r, zero, 1.0 - r * r, -step * s * r])[:, kicked]
        self._of_p[:, kicked] = np.array([-2.0 * r / step, zero, 2.0 * r / step, s - r])[:, kicked]
        before = np.isin(t[self._right], jumps(run)) & (s < 1.0)
        self._linear = np.array([r, s])
        self._linear[:, before] = [[1.0], [0.0]]

    def _combined(self, weights: Floats, rows: tuple[Floats, ...]) -> Floats:
        shape = (-1, *[1] * (rows[0].ndim - 1))
        return np.asarray(
            sum(weight.reshape(shape) * row for weight, row in zip(weights, rows, strict=True))
        )

    def state(self, q: Floats, p: Floats) -> tuple[Floats, Floats]:
        """Returns q and p at the times (n, ...), of those of the rows or their derivatives."""
        rows = (q[self._left], p[self._left], q[self._right], p[self._right])
        return self._combined(self._of_q, rows), self._combined(self._of_p, rows)

    def other(self, values: Floats) -> Floats:
        """Returns multipliers or torques at the times (n, ...), or their derivatives."""
        return self._combined(self._linear, (values[self._left], values[self._right]))


def _impulses(run: Run) -> list[float]:
    return [
        float(impulse[0]) for one in run.scene.disturbances for impulse in one.compile().impulses
    ]
