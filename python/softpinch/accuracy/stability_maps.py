"""`sp.stability_map`: how runs end over a parameter's values, steps, formulations and methods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run.options import STOP_ON
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.progress import Report
from ..support.result import Result
from ..support.table import save_by_suffix, save_csv, save_npz
from .bisection import LOST
from .stability_plan import NOT_RUN, Pair, Plan
from .stability_reference import METHODS, NO_REFERENCE, TOLERANCE

Bools = NDArray[np.bool_]
Texts = NDArray[np.str_]

# A completed run with an error above the first is misleading; an error below the second is good.
WRONG, GOOD = 0.1, 1e-3


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StabilityMap(Result):
    """Statuses and errors of runs over values of an axis (v), steps (d), and pairs.

    Each run is compared with a reference for its value of the axis: a run of the scene by
    "radau5" with adaptive steps, which a run by "rosenbrock" confirms.

    Attributes:
        axis: Name, path or function name of the axis.
        label: Axis label for figures.
        unit: Unit of `values`; "1" if they have none.
        scale: Spacing of the axis in figures: "linear", "log", "logit" or "right_angle".
        values: Values on the axis (v,), increasing.
        dt: Steps (d,), s, increasing.
        pairs: (formulation, method) of each pair.
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
        floor: Difference between the two methods (v,), scaled as `error`; if they end early, the
            difference of their end times as a share of the time until then; inf without a
            reference. Errors below this are meaningless.
        scene: The scene that the axis varies.
        stabilization: The gains of "csm", unless the axis sets them.
        max_steps: Largest number of steps of a run.
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
        """Runs that completed with an error above 0.1, or although the reference did not complete.

        Returns:
            (pairs, v, d), bool.
        """
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
            "axis": self.axis,
            "unit": self.unit,
            "scale": self.scale,
            "max_steps": self.max_steps,
            "stop_on": list(STOP_ON),
            "references": list(METHODS),
            "reference_tolerance": TOLERANCE,
        }

    def save(self, path: str | Path) -> Path:
        """Writes the map as .csv or .npz.

        `.csv` has a row for each run and units in the header. `.npz` has the arrays of `to_dict()`,
        and `provenance()` as JSON text.

        Raises:
            ValueError: The suffix is neither .csv nor .npz.
            OSError: The file cannot be written.
        """
        path = checks.path("path", path)
        return save_by_suffix(path, {".npz": self._save_npz, ".csv": self._save_csv})

    def _save_npz(self, path: Path) -> None:
        save_npz(path, self.to_dict(), self.provenance())

    def _save_csv(self, path: Path) -> None:
        header = ["formulation", "method", f"{self.axis} [{self.unit}]", "dt [s]", "status",
                  "error [1]", "agrees", "expected", "floor [1]", "predicted [s]"]  # fmt: skip
        rows = (
            [*self.pairs[k], self.values[v], self.dt[d], self.status[k, v, d],
             self.error[k, v, d], self.agrees[k, v, d], self.expected[v],
             self.floor[v], self.predicted[k, v]]
            for k, v, d in np.ndindex(self.status.shape)
        )  # fmt: skip
        plain = ([x.item() if isinstance(x, np.generic) else x for x in row] for row in rows)
        save_csv(path, header, plain)


def _counted(names: Sequence[str]) -> str:
    """Each distinct name with its number of occurrences, in words."""
    counts = {name: names.count(name) for name in dict.fromkeys(names)}
    words = [f"{name.replace('_', ' ')} {count}" for name, count in counts.items()]
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
        axis: The parameter that changes: "youngs_modulus" (of both tips, Pa), "object_mass" (kg;
            the inertia changes in proportion), "viscosity" (of both tips in both directions,
            N s/m), "gains" (a common factor on K_P, K_D and K_I), "stabilization" (alpha = beta of
            "csm", 1/s), "grasp_depth" (d_n / a of both tips at the start; the scene starts at rest
            and holds these finger angles), "tilt" (theta_p in degrees at the start, likewise, with
            d_n / a = 0.05 and finger roots moved apart), "impulse" (size of an impulse on the
            object after a quarter of the duration, N s); or a path as in `vary` of `monte_carlo`;
            or a function from a value to a scene.
        values: Values on the axis (v,), increasing; None takes the defaults of a named axis. Paths
            and functions have no defaults.
        dt: Steps (d,), s, increasing; None takes 13 from 1e-6 to 1e-2, by equal factors.
        pairs: Pairs (formulation, method); None takes all, without "nullspace" in unilateral
            contact.
        stabilization: The gains of "csm".
        max_steps: Runs that would take more steps are not run and have status "not_run".
        threads: Number of threads; None takes as many as the process may use.
        progress: True draws a bar on a terminal; False draws none; or a function that is called
            with the number of completed runs and the number of all runs.

    Raises:
        ValueError: An argument breaks its rule, or a value gives a scene that cannot start. Both
            are found before anything is simulated.
        TypeError: An argument is of the wrong kind.
        KeyboardInterrupt: Ctrl-C, within a second.
    """
    plan = Plan(scene, axis, values, dt, pairs, stabilization, max_steps, threads)
    return made(plan, progress)


def made(plan: Plan, progress: bool | Report) -> StabilityMap:
    """Computes the map of a plan."""
    found = plan.run(progress)
    expected = np.array([one.status for one in found.references], dtype=found.status.dtype)
    return StabilityMap(
        axis=plan.axis.name,
        label=plan.axis.label,
        unit=plan.axis.unit,
        scale=plan.axis.scale,
        values=plan.values,
        dt=plan.dt,
        pairs=plan.pairs,
        status=read_only(found.status),
        error=read_only(found.error),
        agrees=read_only(found.status == expected[:, None]),
        predicted=read_only(found.predicted),
        expected=read_only(expected),
        floor=read_only(np.array([one.floor for one in found.references])),
        scene=plan.scene,
        stabilization=plan.stabilization,
        max_steps=plan.max_steps,
    )
