"""The plan of a stability map: checks its arguments, groups its runs into jobs, and runs them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run.options import MOST_STEPS, STOP_ON
from ..scene.contact import formulations_of, require_formulations
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..study.engine import how_many_threads
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.choices import Formulation, Method
from ..support.progress import Report, reporting
from .stability_axes import choose
from .stability_reference import Reference
from .stability_runs import Case, Job, jobs, run

Pair = tuple[Formulation, Method]

PAIRS: tuple[Pair, ...] = tuple((f, m) for f in _core.FORMULATIONS for m in _core.METHODS)
# Status of runs that were left out, in addition to the core's statuses.
NOT_RUN = "not_run"


class Found(NamedTuple):
    """Results of the runs and their references; `StabilityMap` explains the arrays."""

    status: NDArray[np.str_]
    error: Floats
    predicted: Floats
    references: list[Reference]


class Plan:
    """A stability map to compute, with checked arguments; nothing has been simulated yet.

    Attributes:
        scene: The scene that the axis varies.
        axis: The axis.
        values: Values on the axis (v,).
        dt: Steps (d,), s.
        pairs: (formulation, method) of each pair.
        stabilization: The gains of "csm".
        max_steps: Largest number of steps of a run.
    """

    def __init__(
        self,
        scene: Scene,
        axis: str | Callable[[float], Scene],
        values: ArrayLike | None = None,
        dt: ArrayLike | None = None,
        pairs: Sequence[Pair] | None = None,
        stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
        max_steps: int = 200_000,
        threads: int | None = None,
    ) -> None:
        """Checks the arguments of `stability_map`, and raises its errors."""
        checks.instance("scene", scene, Scene)
        checks.instance("stabilization", stabilization, Stabilization)
        self.scene, self.stabilization = scene, stabilization
        self.axis, given = choose(scene, axis, values)
        self.values = read_only(given)
        self.dt = _steps(dt)
        self.max_steps = checks.integer("max_steps", max_steps, 1, MOST_STEPS)
        self._threads = how_many_threads(threads)
        self._cases = [
            Case(*self.axis.apply(scene, stabilization, value)) for value in given.tolist()
        ]
        self.pairs = _allowed(pairs, [case.scene for case in self._cases])
        self._jobs = _jobs(
            self.axis.name, self.values, self._cases, self.dt, self.pairs, self.max_steps
        )

    def run(self, progress: bool | Report) -> Found:
        """Computes the references and all runs.

        Raises:
            TypeError: `progress` is neither True nor False nor a function.
            KeyboardInterrupt: Ctrl-C.
        """
        cases = self._cases
        total = len(cases) + sum(len(numbers) for job in self._jobs for numbers in job.places)
        # `_jobs` refuses a start off the constraints unless all pairs are of "csm".
        formulations = {formulation for formulation, _ in self.pairs}
        formulation: Formulation = "csm" if formulations == {"csm"} else "nullspace"
        known: dict[Case, Reference] = {}
        status = np.full((len(self.pairs), len(cases), len(self.dt)), NOT_RUN, dtype="U20")
        error = np.full(status.shape, np.inf)
        with reporting(progress, "stability map") as report:
            for k, case in enumerate(cases):
                if case not in known:
                    known[case] = Reference(case, formulation, self.max_steps)
                report(k + 1, total)
            references = [known[case] for case in cases]
            predicted = np.array([one.stable_steps(self.pairs) for one in references]).T
            done = len(cases)
            for job, v, ended in run(
                self._jobs, self._threads, lambda more: report(done + more, total)
            ):
                pair, d = job.tag
                status[pair, v, d] = ended.status
                error[pair, v, d] = references[v].error(ended)
        return Found(status, error, predicted, references)


def _steps(dt: ArrayLike | None) -> Floats:
    if dt is None:
        return read_only(np.geomspace(1e-6, 1e-2, 13))
    steps = checks.times("dt", dt)
    checks.positive("dt[0]", steps[0])
    return steps


def check_pairs(pairs: Sequence[tuple[str, str]] | None) -> tuple[Pair, ...]:
    """Checks pairs (formulation, method); None stands for all pairs.

    Raises:
        ValueError: A name is unknown, a pair is repeated, or there is no pair.
        TypeError: `pairs` is not a sequence of pairs.
    """
    if pairs is None:
        return PAIRS
    found: list[Pair] = []
    if isinstance(pairs, str) or not isinstance(pairs, Sequence):
        raise TypeError(
            f"pairs = {checks.shown(pairs)}: must be a sequence of (formulation, method)"
        )
    for k, pair in enumerate(pairs):
        if isinstance(pair, str) or not isinstance(pair, Sequence) or len(pair) != 2:
            raise TypeError(f"pairs[{k}] = {checks.shown(pair)}: must be (formulation, method)")
        formulation = checks.choice(f"pairs[{k}][0]", pair[0], _core.FORMULATIONS)
        one = (formulation, checks.choice(f"pairs[{k}][1]", pair[1], _core.METHODS))
        if one in found:
            raise ValueError(f"pairs[{k}] = {one}: must not be repeated")
        found.append(one)
    if not found:
        raise ValueError("pairs is empty: must have a pair")
    return tuple(found)


def _allowed(pairs: Sequence[Pair] | None, scenes: Sequence[Scene]) -> tuple[Pair, ...]:
    """Checks pairs; None stands for all pairs that the scenes' contact allows.

    Raises:
        ValueError: As `check_pairs`, or a formulation is for bilateral contact only.
        TypeError: As `check_pairs`.
    """
    found = check_pairs(pairs)
    for scene in scenes:
        if pairs is None:
            found = tuple(pair for pair in found if pair[0] in formulations_of(scene))
        require_formulations("pairs", [formulation for formulation, _ in found], scene)
    return found


def _jobs(
    axis: str,
    values: Floats,
    cases: Sequence[Case],
    steps: Floats,
    pairs: Sequence[Pair],
    max_steps: int,
) -> list[Job]:
    """The jobs of all runs, tagged with the indices (pair, step).

    Raises:
        ValueError: A scene cannot start; the message names its value on the axis.
    """
    for value, case in zip(values.tolist(), cases, strict=True):
        for formulation in dict.fromkeys(formulation for formulation, _ in pairs):
            try:
                some = case.scene.duration
                list(jobs({0: case}, (formulation, "rk4"), some, STOP_ON, tag=None))
            except ValueError as error:
                said = str(error).removeprefix("run 0: ")
                raise ValueError(f"{axis} = {value:.6g}: {said}") from None
    found: list[Job] = []
    for d, dt in enumerate(steps.tolist()):
        kept = {
            v: case
            for v, case in enumerate(cases)
            if math.ceil(case.scene.duration / dt) <= max_steps
        }
        for k, pair in enumerate(pairs):
            found += jobs(kept, pair, dt, STOP_ON, tag=(k, d))
    return found
