"""Which steps work along an axis of a scene: `sp.stability_map`, over values, steps and pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support.arrays import Floats, read_only
from ..support.progress import Report
from ..support.result import Result
from ..support.table import save_by_suffix, save_csv, save_npz
from .bisection import LOST
from .stability_plan import NOT_RUN, STOP_ON, Pair, Plan
from .stability_reference import METHODS, NO_REFERENCE, TOLERANCE

Bools = NDArray[np.bool_]
Texts = NDArray[np.str_]

# Errors above the first mislead, below the second they are good.
WRONG, GOOD = 0.1, 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityMap(Result):
    """How runs end and how wrong they are, over an axis of a scene (v), steps (d) and pairs.

    Attributes:
        axis: Its name, path or function's name.
        label: The same for figures.
        unit: Of `values`, "1" for a number without one.
        scale: "linear", "log", "logit" or "right_angle": how steps along it compare.
        values: (v,), increasing.
        dt: (d,), s, increasing.
        pairs: (formulation, method) of each.
        status: (pairs, v, d), how each run ended, or "not_run" where it would have taken more than
            `max_steps` steps.
        error: (pairs, v, d), at the end: the larger of q's and p's, each component against its
            largest size along the motion; inf where this run or the motion did not complete.
        agrees: (pairs, v, d), whether it ended with the status that the motion ends with.
        predicted: (pairs, v), the longest step by the eigenvalues along the motion and the method's
            stability region, s; inf for a method that is stable for any.
        expected: (v,), the status that the motion ends with; "no_reference" where the two methods
            that should tell fail or disagree, and then nothing agrees.
        floor: (v,), by how much those two differ, as `error`; of motions that end early as a share
            of their length in time; inf without a reference. Errors below it say nothing.
        scene: What the axis starts from.
        stabilization: The gains of "csm", where the axis does not set them.
        max_steps: No run takes more.
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
        """The longest dt of the grid up to which all runs ended rightly, (pairs, v), s.

        Rightly: with the motion's status, and where that is "completed" an error below 0.5. Runs
        that were left out do not count; zero where not even the shortest step that was run will do.
        """
        right = self.agrees & ((self.error < LOST) | (self.expected != "completed")[:, None])
        ran = self.status != NOT_RUN
        good = np.logical_and.accumulate(right | ~ran, axis=2) & ran
        return np.asarray(np.where(good, self.dt, 0.0).max(axis=2))

    def misleading(self) -> Bools:
        """Runs that completed although the motion does not, or with an error above 0.1."""
        known = (self.expected != NO_REFERENCE)[:, None]
        return np.asarray((self.status == "completed") & known & (self.error > WRONG))

    def summary(self) -> list[str]:
        """In words, a line for each pair, and first one about the motions themselves."""
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
        """The arrays by name; pairs as texts (pairs, 2), and `measured`."""
        names = ("values", "dt", "status", "error", "agrees", "predicted", "expected", "floor")
        arrays = {name: getattr(self, name) for name in names}
        return {**arrays, "pairs": np.array(self.pairs), "measured": self.measured()}

    def provenance(self) -> dict[str, Any]:
        """What made this map, as plain data."""
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
        """Writes it: `.csv` has a row for each cell, units in the header; `.npz` has `to_dict()`
        and as text `provenance()` in JSON.

        Raises:
            ValueError: The suffix is another.
            OSError: The file cannot be written.
        """
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
    """How often each occurs, in words."""
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
    """Runs a scene over values of one thing, steps, and pairs of formulation and method.

    Each run is compared with the motion as "radau5" gives it to tolerance 1e-11, itself compared
    with "rosenbrock"'s. What ends a run is what ends one of `simulate` by default.

    Args:
        scene: Where the axis starts from.
        axis: What changes: "youngs_modulus" (of both tips), "object_mass" (the inertia with it),
            "viscosity" (in both directions), "gains" (a factor on K_P, K_D and K_I),
            "stabilization" (alpha = beta of "csm"), "grasp_depth" (d_n / a of both tips at the
            start, at rest, fingers held there), "tilt" (theta_p, the same at a depth of 0.05, the
            roots moved apart), "impulse" (a blow after a quarter of the duration); or a path as
            `monte_carlo` varies it; or a function from a value to the scene.
        values: (v,), increasing; None takes the axis' own, paths and functions have none.
        dt: (d,), s, increasing; None is 13 steps from 1e-6 to 1e-2.
        pairs: (formulation, method) of each; None is all.
        stabilization: The gains of "csm".
        max_steps: Runs that would take more are left out, as status "not_run".
        threads: None is as many as the process may use.
        progress: True draws a bar; or a function of runs done and their number.

    Raises:
        ValueError: An argument breaks its rule, or a value makes a scene that cannot start; before
            anything is simulated.
        TypeError: An argument is of the wrong kind.
        KeyboardInterrupt: Ctrl-C, within a second.
    """
    plan = Plan(scene, axis, values, dt, pairs, stabilization, max_steps, threads)
    return made(plan, progress)


def made(plan: Plan, progress: bool | Report) -> StabilityMap:
    """The map of a plan."""
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
