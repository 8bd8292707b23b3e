"""Results of `work_precision` and `stabilization_sweep`, and other solvers to compare with."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..scene import ESTIMATED, Scene, Stabilization
from ..support import Floats, Method, Result, checks, require
from ..support.table import save_by_suffix, save_csv

if TYPE_CHECKING:
    from pandas import DataFrame

# The places at which errors are compared: the largest along the run, or at the end.
WHERE = ("along", "end")
# An error along the run above this multiple of the one at the end has settled by then.
_SETTLED = 10.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Measurement(Result):
    """One solver at one setting.

    Attributes:
        solver: Formulation and method, such as "nullspace rk4"; or the name of a `Peer`.
        formulation: As of `simulate`, and so is `method`; "" for a peer.
        setting: "dt", "tolerance", or the name of a peer's setting.
        value: Value of the setting; dt in s.
        status: How the run ended; "not_run" if it would have taken too long.
        end: "q", "p", "multipliers" -> error at the end; inf if the run did not complete. Peers
            have "q" and "p" only; what follows they lack (empty, nan or -1), except `time`.
        smooth: "q", "p", "multipliers" -> largest error along the run away from switches of the
            inputs.
        at_switches: Likewise, at the switches and in the first hundredth of the time from each
            switch to the next; empty without switches.
        holonomic: Largest |C^H|, m; `nonholonomic` is the largest |C^N|, m/s.
        closure: Largest error of the energy ledger, as a share of the exchanged energy.
        time: CPU time of a run that keeps only its end, after a warm-up, s: the median.
        quartiles: First and third quartile of these times, s.
        evaluations: As in `Run.stats`, and so are `factorisations` and `steps`.
        order: Observed order of convergence of `along`, from the next longer step; nan if there is
            none, or a run failed. It exceeds the method's order if that step is too long.
        expected_order: The method's order; 0 for adaptive steps and peers.
    """

    solver: str
    formulation: str = ""
    method: str = ""
    setting: str
    value: float
    status: str
    end: Mapping[str, float] = field(default_factory=dict)
    smooth: Mapping[str, float] = field(default_factory=dict)
    at_switches: Mapping[str, float] = field(default_factory=dict)
    holonomic: float = math.nan
    nonholonomic: float = math.nan
    closure: float = math.nan
    time: float = math.nan
    quartiles: tuple[float, float] = (math.nan, math.nan)
    evaluations: int = -1
    factorisations: int = -1
    steps: int = -1
    order: float = math.nan
    expected_order: int = 0

    @property
    def error(self) -> float:
        """The larger error of q and p at the end, which every solver has.

        A grasp that has settled at the end has forgotten the errors before; see `along`.
        """
        return max(self.end.get("q", math.inf), self.end.get("p", math.inf))

    @property
    def along(self) -> float:
        """The largest error of q, p and lambda along the run, switches included; inf for a peer."""
        return max([*self.smooth.values(), *self.at_switches.values()], default=math.inf)


@dataclass(frozen=True, kw_only=True)
class Peer:
    """An external solver of the same motion, to compare with.

    Attributes:
        name: Name in tables and legends.
        setting: Name of the solver's accuracy setting, such as "rtol" or "steps".
        values: Values of the setting, from loose to tight.
        prepare: Function from a scene to a function `solve`. `solve(value)` is timed and returns a
            result of any type.
        ends: Function from the result of `solve` to (q, p) at the end, (9,) each.
    """

    name: str
    setting: str
    values: Sequence[float]
    prepare: Callable[[Scene], Callable[[Any], Any]]
    ends: Callable[[Any], tuple[Floats, Floats]]

    def __post_init__(self) -> None:
        checks.instance("Peer.name", self.name, str, "text")
        checks.instance("Peer.setting", self.setting, str, "text")
        checks.array("Peer.values", self.values, ("k",))
        checks.function("Peer.prepare", self.prepare)
        checks.function("Peer.ends", self.ends)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WorkPrecision(Result):
    """The measurements of `work_precision`.

    Attributes:
        scene: The simulated scene.
        rows: One measurement for each solver and setting.
        reference: How the reference was computed and confirmed, in words.
        floor: "q", "p", "multipliers" -> error of the reference; smaller errors are meaningless.
        stabilization: The gains of "csm".
        skipped: One line for each solver or setting that was not measured, with the reason.
    """

    scene: Scene
    rows: tuple[Measurement, ...]
    reference: str
    floor: Mapping[str, float]
    stabilization: Stabilization
    skipped: tuple[str, ...]

    def cheapest(self, error: float, where: str = "along") -> tuple[Measurement, ...]:
        """The quickest measurement with a small enough error, of each solver and kind of setting.

        The quickest comes first. A measurement is left out if the next tighter setting misses the
        error, because then it meets it by chance.

        Args:
            error: The largest accepted error.
            where: "along" takes `Measurement.along`, "end" takes `Measurement.error`.
        """
        error = checks.number_that("error", error, lambda x: x > 0.0, "must be > 0")
        size = "along" if checks.choice("where", where, WHERE) == "along" else "error"
        found = []
        for rows in self.curves().values():
            good = [*(getattr(row, size) <= error for row in rows), True]
            kept = [row for k, row in enumerate(rows) if good[k] and good[k + 1]]
            found += sorted(kept, key=lambda row: row.time)[:1]
        return tuple(sorted(found, key=lambda row: row.time))

    def settled(self) -> str:
        """Says how many errors at the end hide larger errors before, in words; "" if none does."""
        rows = [row for row in self.rows if row.along < math.inf]
        hidden = [row for row in rows if row.along > _SETTLED * row.error]
        if not hidden:
            return ""
        what = f"have an error along the run more than {_SETTLED:g} times that at the end"
        return f"the motion has settled: {len(hidden)} of {len(rows)} settings {what}"

    def curves(self) -> dict[tuple[str, str], list[Measurement]]:
        """(solver, setting) -> its measurements without those not run, from loose to tight."""
        found: dict[tuple[str, str], list[Measurement]] = {}
        for row in self.rows:
            if row.status != "not_run":
                found.setdefault((row.solver, row.setting), []).append(row)
        return found

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """Column name -> array (rows,).

        Errors are named "along", "end.q", "smooth.p" and so on.
        """
        found: defaultdict[str, list[Any]] = defaultdict(list)
        for row in self.rows:
            for each in fields(row):
                value = getattr(row, each.name)
                if isinstance(value, Mapping):
                    for name in ESTIMATED:
                        found[f"{each.name}.{name}"].append(value.get(name, math.nan))
                elif each.name == "quartiles":
                    found["lower_quartile"].append(value[0])
                    found["upper_quartile"].append(value[1])
                else:
                    found[each.name].append(value)
                if each.name == "status":
                    found["along"].append(row.along)
        return {name: np.array(values) for name, values in found.items()}

    def save(self, path: str | Path) -> Path:
        """Writes the rows as .csv, with units in the header."""
        columns = self.to_dict()
        header = [name + _COLUMN_UNITS.get(name, "") for name in columns]
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        return save_by_suffix(path, {".csv": lambda file: save_csv(file, header, rows)})

    def to_pandas(self) -> DataFrame:
        """The rows as a pandas DataFrame; needs the extra `study`."""
        pandas = require("pandas", extra="study", purpose="to_pandas")
        return pandas.DataFrame(self.to_dict())  # type: ignore[no-any-return]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StabilizationSweep(Result):
    """Effect of the gains of (19, 20) at one step: constraint drift, and error of the motion.

    Attributes:
        dt: The step, s, of the `method`.
        product: Gain times step, alpha dt = beta dt, (k,).
        status: Status of each run (k,).
        holonomic: Largest |C^H| along each run (k,), m; `nonholonomic` that of |C^N|, m/s; inf if
            the run did not complete.
        error: Largest error of q and p, as `multipliers` of lambda, along each run (k,), each
            component divided by its largest magnitude; inf if the run did not complete.
        without: The four results of a run with "nullspace", or with "projected" in unilateral
            contact, which have no gains: "holonomic", "nonholonomic", "q and p", "multipliers".
    """

    dt: float
    method: Method
    product: Floats
    status: tuple[str, ...]
    holonomic: Floats
    nonholonomic: Floats
    error: Floats
    multipliers: Floats
    without: Mapping[str, float]


_COLUMN_UNITS = {
    "holonomic": " [m]",
    "nonholonomic": " [m/s]",
    **dict.fromkeys(("time", "lower_quartile", "upper_quartile"), " [s]"),
}
