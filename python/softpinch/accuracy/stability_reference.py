"""The references of a stability map: accurate runs by two methods, and their eigenvalues."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..run import scaled_error
from ..run.run import Run
from ..support.arrays import Floats
from ..support.choices import Formulation, Method
from .linear_modes import along_run
from .stability import ENDS, trusted_run
from .stability_runs import Case, Ended

TOLERANCE = 1e-11
# The first method gives the reference, the second an estimate of its error.
METHODS: tuple[Method, Method] = ("radau5", "rosenbrock")
NO_REFERENCE = "no_reference"
# If the two methods differ by this much, there is no reference.
_APART = 0.1


class Reference:
    """An accurate run of one case, with an estimate of its error.

    Attributes:
        status: Status of the run; "no_reference" if the two methods fail or disagree.
        floor: Difference between the two methods; inf without a reference.
    """

    def __init__(self, case: Case, formulation: Formulation, max_steps: int) -> None:
        """Runs the case with both methods.

        Args:
            case: Scene and gains.
            formulation: "csm" if the map has this formulation only, as the start may then be off
                the constraints; else "nullspace".
            max_steps: Largest number of steps of each method.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        self._case = case
        self._run, second = (
            trusted_run(
                case.scene,
                formulation,
                case.stabilization,
                tolerance=TOLERANCE,
                method=method,
                max_steps=max_steps,
            )
            for method in METHODS
        )
        self.floor = self._apart(second)
        self.status = self._run.status if self.floor < _APART else NO_REFERENCE
        if self.status == NO_REFERENCE:
            self.floor = np.inf

    def _apart(self, other: Run) -> float:
        if self._run.status != other.status or self._run.status not in ENDS:
            return np.inf
        if self._run.success:
            return self._distance(other.q[-1], other.p[-1])
        ends = sorted((float(self._run.t[-1]), float(other.t[-1])))
        # Runs may end at their very start.
        return (ends[1] - ends[0]) / (ends[1] - float(self._run.t[0]) or 1.0)

    @cached_property
    def _scales(self) -> dict[str, Floats]:
        usual = scaled_error.usual(self._run.scene)
        return {
            name: scaled_error.scales(name, getattr(self._run, name), usual) for name in ("q", "p")
        }

    def _distance(self, q: Floats, p: Floats) -> float:
        return max(scaled_error.at_end({"q": q, "p": p}, self._run, self._scales).values())

    def error(self, ended: Ended) -> float:
        """Error at a run's end, the larger of q and p; inf if the run or this is not complete."""
        if not ended.status == self.status == "completed":
            return np.inf
        return self._distance(ended.final[:9], ended.final[9:])

    def stable_steps(self, pairs: Sequence[tuple[Formulation, Method]]) -> list[float]:
        """The longest stable step of each pair by the eigenvalues along the reference, s."""
        along = {
            formulation: along_run(self._run, formulation, self._case.stabilization)
            for formulation in dict.fromkeys(formulation for formulation, _ in pairs)
        }
        return [
            float(along[formulation].stable_step(method).min()) for formulation, method in pairs
        ]
