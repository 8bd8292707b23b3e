"""`sp.stability_map`: how runs end over a parameter's values, steps, formulations and methods."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run import scaled_error
from ..run.options import MOST_STEPS, STOP_ON, Options
from ..scene import Scene, Stabilization
from ..scene.contact import formulations_of, require_formulations
from ..study.engine import how_many_threads
from ..support import Bools, Floats, Report, Result, Texts, checks, reporting, save_map
from ..support.choices import Formulation, Method
from .runs import accurate_run, batches, run_batch
from .stability import ENDS, LOST, along_run
from .stability_axes import choose

Pair = tuple[Formulation, Method]

PAIRS: tuple[Pair, ...] = tuple((f, m) for f in _core.FORMULATIONS for m in _core.METHODS)
# Statuses besides the core's: of runs that were left out, and of values without a reference.
NOT_RUN, NO_REFERENCE = "not_run", "no_reference"
# A completed run with an error above the first is misleading; an error below the second is good.
WRONG, GOOD = 0.1, 1e-3
# Tolerance and methods of the references. The first method gives the reference, the second an
# estimate of its error; if they differ by more than `_APART`, there is no reference.
_TOLERANCE, _APART = 1e-11, 0.1
_METHODS: tuple[Method, Method] = ("radau5", "rosenbrock")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StabilityMap(Result):
    """Statuses and errors of runs over values of an axis (v), steps (d), and pairs.

    Attributes:
        axis: Name, path or function name of the axis.
        label: Axis label for figures.
        unit: Unit of `values`; "1" if they have none.
        scale: Spacing of the axis in figures: "linear", "log", "logit" or "right_angle".
        values: As of `stability_map`, and so are `dt` (d,), s, and `pairs`.
        status: Status of each run (pairs, v, d); "not_run" if it would have taken more than
            `max_steps` steps.
        error: Error of each run at the end (pairs, v, d), the larger of q and p, each component
            divided by its largest magnitude along the reference; inf if the run or the reference
            did not complete.
        agrees: Whether each run ended with the reference's status (pairs, v, d).
        predicted: Longest stable step (pairs, v), s, by the eigenvalues along the reference and the
            method's stability region; inf for a method that is stable for every step.
        expected: Status of the reference (v,); "no_reference" if its two methods fail or disagree.
            Then no run agrees.
        floor: Difference between the reference's two methods (v,), scaled as `error`, below which
            errors are meaningless; if they end early, the difference of their end times as a share
            of the time until then; inf without a reference.
        scene: As of `stability_map`, and so are `stabilization` and `max_steps`.
    """

    axis: str
    label: str
    unit: str
    scale: str
    values: Floats
    dt: Floats
    pairs: tuple[Pair, ...]
    status: Texts
    error: Floats
    agrees: Bools
    predicted: Floats
    expected: Texts
    floor: Floats
    scene: Scene
    stabilization: Stabilization
    max_steps: int

    def measured(self) -> Floats:
        """The longest dt up to which all runs ended correctly, (pairs, v), s.

        A run ended correctly if it has the reference's status and, if that is "completed", an error
        below 0.5. Steps that were not run are ignored. The result is zero if even the run with the
        shortest step ended wrongly.
        """
        right = self.agrees & ((self.error < LOST) | (self.expected != "completed")[:, None])
        ran = self.status != NOT_RUN
        good = np.logical_and.accumulate(right | ~ran, axis=2) & ran
        return np.asarray(np.where(good, self.dt, 0.0).max(axis=2))

    def misleading(self) -> Bools:
        """Runs (pairs, v, d) that completed with an error above 0.1, or unlike the reference."""
        known = (self.expected != NO_REFERENCE)[:, None]
        return np.asarray((self.status == "completed") & known & (self.error > WRONG))

    def summary(self) -> list[str]:
        """The map in words: a line about the references, then a line for each pair."""
        known = self.expected != NO_REFERENCE
        ended = self.expected == "completed"
        first = f"{len(self.values)} values of {self.axis}: the motion "
        first += _counted(self.expected.tolist())
        if ended.any():
            first += f"; known to {self.floor[ended].max():.1e} or better"
        if (known & ~ended).any():
            share = self.floor[known & ~ended].max()
            first += f"; instants of early ends to {share:.1e} of the time until then"
        lines = [first]
        ran = (self.status != NOT_RUN) & known[:, None]
        misleading = self.misleading()
        for k, (formulation, method) in enumerate(self.pairs):
            cells = int(ran[k].sum())
            failed = self.status[k][ran[k] & ~self.agrees[k] & (self.status[k] != "completed")]
            parts = [
                f"{int((self.agrees[k] & ran[k]).sum())} of {cells} runs end as they should",
                f"{int((self.error[k] < GOOD).sum())} with an error below {GOOD:g}",
                f"{int(misleading[k].sum())} complete but are wrong by more than {WRONG:g}",
                f"failed: {_counted(failed.tolist())}",
            ]
            left_out = int((self.status[k] == NOT_RUN).sum())
            parts += [f"{left_out} not run"] if left_out else []
            lines.append(f"{formulation} + {method}: {', '.join(parts)}")
        return lines

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """Name -> array, with pairs as texts (pairs, 2), and with `measured`."""
        names = ("values", "dt", "status", "error", "agrees", "predicted", "expected", "floor")
        arrays = {name: getattr(self, name) for name in names}
        return {**arrays, "pairs": np.array(self.pairs), "measured": self.measured()}

    def provenance(self) -> dict[str, Any]:
        """Versions and settings with which this map was computed, as plain data."""
        return {
            "softpinch": _core.__version__,
            "results_version": _core.RESULTS_VERSION,
            "scene": self.scene.to_dict(),
            "stabilization": self.stabilization.to_dict(),
            **{name: getattr(self, name) for name in ("axis", "unit", "scale", "max_steps")},
            "stop_on": list(STOP_ON),
            "references": list(_METHODS),
            "reference_tolerance": _TOLERANCE,
        }

    def save(self, path: str | Path) -> Path:
        """Writes the map as .csv or .npz.

        `.csv` has a row for each run and units in the header. `.npz` has the arrays of `to_dict()`,
        and `provenance()` as JSON text.
        """
        header = ["formulation", "method", f"{self.axis} [{self.unit}]", "dt [s]", "status",
                  "error [1]", "agrees", "expected", "floor [1]", "predicted [s]"]  # fmt: skip
        rows = (
            [*self.pairs[k], self.values[v], self.dt[d], self.status[k, v, d],
             self.error[k, v, d], self.agrees[k, v, d], self.expected[v],
             self.floor[v], self.predicted[k, v]]
            for k, v, d in np.ndindex(self.status.shape)
        )  # fmt: skip
        return save_map(path, header, rows, self.to_dict(), self.provenance())


def _counted(names: Sequence[str]) -> str:
    words = [f"{name.replace('_', ' ')} {count}" for name, count in Counter(names).items()]
    return ", ".join(words) or "none"


def stability_map(
    scene: Scene,
    axis: str | Callable[[float], Scene],
    values: ArrayLike | None = None,
    *,
    dt: ArrayLike | None = None,
    pairs: Sequence[Pair] | None = None,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    max_steps: int = 200_000,
    threads: int | None = None,
    progress: bool | Report = True,
) -> StabilityMap:
    """Runs a scene over the values of one parameter, over steps, and over pairs.

    A pair is a formulation and a method. For each value, a run by "radau5" with adaptive steps at
    tolerance 1e-11 is the reference, and a run by "rosenbrock" confirms it. The violations that end
    a run are the default ones of `simulate`.

    Args:
        scene: The scene that the axis varies.
        axis: The parameter that changes: "youngs_modulus" (of both tips, Pa), "object_mass" (kg,
            with the inertia in proportion), "viscosity" (of both tips in both directions, N s/m),
            "gains" (a common factor on K_P, K_D and K_I), "stabilization" (alpha = beta of "csm",
            1/s), "grasp_depth" (d_n / a of both tips at the start, at rest and held), "tilt"
            (theta_p in degrees at the start, likewise, with d_n / a = 0.05 and finger roots moved
            apart), "impulse" (size of an impulse on the object after a quarter of the duration,
            N s); or a path as in `vary` of `monte_carlo`; or a function from a value to a scene.
        values: Values on the axis (v,), increasing; None takes the defaults of a named axis. Paths
            and functions have no defaults.
        dt: Steps (d,), s, increasing; None takes 13 from 1e-6 to 1e-2, by equal factors.
        pairs: Pairs (formulation, method); None takes all that the contact allows.
        stabilization: The gains of "csm", unless the axis sets them.
        max_steps: Runs that would take more steps are not run and have status "not_run".
        threads, progress: As for `monte_carlo`.

    Raises:
        ValueError: An argument breaks its rule, or a value gives a scene that cannot start. Both
            are found before anything is simulated.
    """
    return MapPlan(scene, axis, values, dt, pairs, stabilization, max_steps, threads).run(progress)


class _Reference:
    """An accurate run of a scene, with `floor`, its difference from a second method."""

    def __init__(
        self, scene: Scene, gains: Stabilization, formulation: Formulation, max_steps: int
    ) -> None:
        self._gains = gains
        how = {"stabilization": gains, "tolerance": _TOLERANCE, "max_steps": max_steps}
        runs = (accurate_run(scene, formulation, method=method, **how) for method in _METHODS)
        self._run, second = runs
        usual = scaled_error.usual(scene)
        both = {"q": self._run.q, "p": self._run.p}
        self._scales = {name: scaled_error.scales(name, rows, usual) for name, rows in both.items()}
        self.status, self.floor = self._run.status, np.inf
        if self.status == second.status == "completed":
            self.floor = self.error("completed", np.concatenate([second.q[-1], second.p[-1]]))
        elif self.status == second.status and self.status in ENDS:
            ends = sorted((float(self._run.t[-1]), float(second.t[-1])))
            # Runs may end at their very start.
            self.floor = (ends[1] - ends[0]) / (ends[1] - float(self._run.t[0]) or 1.0)
        if self.floor >= _APART:
            self.status, self.floor = NO_REFERENCE, np.inf

    def error(self, status: str, state: Floats) -> float:
        """Error at a run's end, the larger of q and p; inf if the run or this is not complete."""
        if not status == self.status == "completed":
            return np.inf
        last = {"q": state[:9], "p": state[9:]}
        return max(scaled_error.at_end(last, self._run, self._scales).values())

    def stable_steps(self, pairs: Sequence[Pair]) -> list[float]:
        """The longest stable step of each pair by the eigenvalues along the reference, s."""
        along = {
            formulation: along_run(self._run, formulation, self._gains)
            for formulation in dict.fromkeys(formulation for formulation, _ in pairs)
        }
        return [float(along[f].stable_step(method).min()) for f, method in pairs]


# Runs with one pair and one step: the core's batch, for each run of it the indices of the values
# for which it stands, and the indices of pair and step.
_Job = tuple[_core.Batch, list[list[int]], int, int]


class MapPlan:
    """A stability map to compute, with checked arguments, which are those of `stability_map`."""

    def __init__(
        self,
        scene: Scene,
        axis: str | Callable[[float], Scene],
        values: ArrayLike | None,
        dt: ArrayLike | None,
        pairs: Sequence[Pair] | None,
        stabilization: Stabilization,
        max_steps: int,
        threads: int | None,
    ) -> None:
        checks.instance("scene", scene, Scene)
        checks.instance("stabilization", stabilization, Stabilization)
        self._scene, self._stabilization = scene, stabilization
        self.axis, self._values = choose(scene, axis, values)
        self._dt = np.geomspace(1e-6, 1e-2, 13) if dt is None else checks.times("dt", dt)
        checks.positive("dt[0]", self._dt[0])
        self._max_steps = checks.integer("max_steps", max_steps, 1, MOST_STEPS)
        self._threads = how_many_threads(threads)
        # The scene and the gains of "csm" at each value.
        each = self._values.tolist()
        self._cases = [self.axis.apply(scene, stabilization, value) for value in each]
        self._pairs = check_pairs(pairs)
        for at, _ in self._cases:
            if pairs is None:  # all that the scenes' contact allows
                self._pairs = tuple(one for one in self._pairs if one[0] in formulations_of(at))
            require_formulations("pairs", [formulation for formulation, _ in self._pairs], at)
        self._formulations = tuple(dict.fromkeys(formulation for formulation, _ in self._pairs))
        for value, (at, gains) in zip(each, self._cases, strict=True):
            for name in self._formulations:
                how = Options.checked(dt=at.duration, formulation=name, stabilization=gains)
                with checks.reworded(f"{self.axis.name} = {value:.6g}: ", drop="run 0: "):
                    next(batches([at], how))
        self._jobs = list(self._batched())

    def _batched(self) -> Iterator[_Job]:
        """The jobs of all runs that are not too long; equal runs are computed once."""
        for d, dt in enumerate(self._dt.tolist()):
            for k, (formulation, method) in enumerate(self._pairs):
                # Gains -> scene -> the indices of its values.
                alike: dict[Stabilization, dict[Scene, list[int]]] = {}
                for v, (scene, gains) in enumerate(self._cases):
                    if math.ceil(scene.duration / dt) <= self._max_steps:
                        used = gains if formulation == "csm" else Stabilization()
                        alike.setdefault(used, {}).setdefault(scene, []).append(v)
                for gains, scenes in alike.items():
                    options = Options.checked(dt, method, formulation, gains)
                    values = list(scenes.values())
                    for batch, chosen in batches(list(scenes), options):
                        yield batch, [values[n] for n in chosen], k, d

    def run(self, progress: bool | Report = True) -> StabilityMap:
        """Computes the references and all runs."""
        cases, n = self._cases, len(self._cases)
        total = n + sum(len(own) for _, values, _, _ in self._jobs for own in values)
        # A start off the constraints was refused unless all pairs are of "csm".
        formulation: Formulation = "csm" if self._formulations == ("csm",) else "nullspace"
        known: dict[tuple[Scene, Stabilization], _Reference] = {}
        status = np.full((len(self._pairs), n, len(self._dt)), NOT_RUN, dtype="U20")
        error = np.full(status.shape, np.inf)
        with reporting(progress, "stability map") as report:
            for done, case in enumerate(cases, 1):
                if case not in known:
                    known[case] = _Reference(*case, formulation, self._max_steps)
                report(done, total)
            references = [known[case] for case in cases]
            done = n
            for batch, values, k, d in self._jobs:
                ends = run_batch(batch, min(self._threads, len(values)))
                for (ended, state), own in zip(ends, values, strict=True):
                    for v in own:
                        status[k, v, d] = ended
                        error[k, v, d] = references[v].error(ended, state)
                done += sum(map(len, values))
                report(done, total)
        expected = np.array([one.status for one in references], dtype=status.dtype)
        return StabilityMap(
            axis=self.axis.name,
            label=self.axis.label,
            unit=self.axis.unit,
            scale=self.axis.scale,
            values=self._values,
            dt=self._dt,
            pairs=self._pairs,
            status=status,
            error=error,
            agrees=status == expected[:, None],
            predicted=np.array([one.stable_steps(self._pairs) for one in references]).T,
            expected=expected,
            floor=np.array([one.floor for one in references]),
            scene=self._scene,
            stabilization=self._stabilization,
            max_steps=self._max_steps,
        )


def check_pairs(pairs: Sequence[tuple[str, str]] | None) -> tuple[Pair, ...]:
    """Checks pairs (formulation, method); None stands for all pairs."""
    if pairs is None:
        return PAIRS
    found: list[Pair] = []
    for k, pair in enumerate(checks.several("pairs", pairs, "pairs (formulation, method)")):
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
