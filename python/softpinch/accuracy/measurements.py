"""What is measured of a solver at one setting, and what a whole sweep comes to."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.result import Result
from ..support.table import save_by_suffix, save_csv

QUANTITIES = ("q", "p", "multipliers")
# Where an error may be looked at.
WHERE = ("end", "along")


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement(Result):
    """One solver at one setting.

    Attributes:
        solver: "nullspace rk4", or the name of a peer.
        formulation: How the constraints are kept; "" of a peer.
        method: How time is stepped; "" of a peer.
        setting: "dt", "tolerance", or what a peer's number is.
        value: Its value; of dt in s.
        status: How the run ended; "not_run" where it would have taken too long.
        end: "q", "p", "multipliers" -> error at the end; inf of a run that did not complete. Peers
            say nothing of lambda.
        smooth: The same, the largest along the run away from switches; empty of a peer.
        at_switches: The same at the switches and in the first hundredth of what follows each;
            empty of a peer, and where there is none.
        holonomic: Largest |C^H|, m; nan of a peer, as what follows.
        nonholonomic: Largest |C^N|, m/s.
        closure: Largest error of the energy ledger, as a share of what was exchanged.
        time: CPU time of a warm run that keeps its end, s: the median.
        quartiles: The quarters of these times, s.
        evaluations: Of the right-hand side; -1 where a peer does not say, as what follows.
        factorisations: Decompositions of a matrix.
        steps: Taken.
        order: With which power of the step the error at the end (q and p) fell from the longer
            step before; nan where there was none, or a run failed.
        expected_order: The method's; 0 where steps are free.
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
        """At the end, the larger of q's and p's: what every solver has."""
        return max(self.end.get("q", math.inf), self.end.get("p", math.inf))

    @property
    def along(self) -> float:
        """The largest along the run, switches included, of q, p and lambda; inf of a peer."""
        found = [*self.smooth.values(), *self.at_switches.values()]
        return max(found, default=math.inf)


@dataclass(frozen=True, kw_only=True)
class Peer:
    """Another solver of the same motion.

    Attributes:
        name: In tables and legends.
        setting: What its numbers are: "rtol", "steps".
        values: From loose to tight.
        prepare: Scene -> function of a value, which solves (this is timed) and returns something.
        ends: Of that something, (q, p) at the end, (9,) each.
    """

    name: str
    setting: str
    values: Sequence[float]
    prepare: Callable[[Scene], Callable[[Any], Any]]
    ends: Callable[[Any], tuple[Floats, Floats]]

    def __post_init__(self) -> None:
        """Checks the kinds; the values are those that `prepare` takes.

        Raises:
            TypeError: One is of another kind.
            ValueError: There is no value, or one that is not finite.
        """
        checks.instance("Peer.name", self.name, str, "text")
        checks.instance("Peer.setting", self.setting, str, "text")
        checks.array("Peer.values", self.values, ("k",))
        checks.function("Peer.prepare", self.prepare)
        checks.function("Peer.ends", self.ends)


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkPrecision(Result):
    """What `work_precision` measured.

    Attributes:
        scene: On what.
        rows: Every solver at every setting.
        reference: How the reference was computed, and confirmed.
        floor: "q", "p", "multipliers" -> the reference's own error: nothing below it is known.
        stabilization: The gains of "csm".
        skipped: What was left out, and why, a line each.
    """

    scene: Scene
    rows: tuple[Measurement, ...]
    reference: str
    floor: Mapping[str, float]
    stabilization: Stabilization
    skipped: tuple[str, ...]

    def cheapest(self, error: float, where: str = "end") -> tuple[Measurement, ...]:
        """Of each solver and kind of setting the quickest whose error is below this.

        The quickest comes first. One that meets it by chance, and misses it at the next tighter
        setting, is left out.

        Args:
            error: The largest that it may be.
            where: "end", of q and p there, or "along" the run, of q, p and lambda.

        Raises:
            ValueError: `where` is neither, or `error` not positive.
            TypeError: One is of the wrong kind.
        """
        error = checks.number("error", error)
        if not error > 0:
            raise ValueError(f"error = {error}: must be > 0")
        size = "along" if checks.choice("where", where, WHERE) == "along" else "error"
        found = []
        for rows in self.curves().values():
            good = [getattr(row, size) <= error for row in rows]
            kept = [
                row for k, row in enumerate(rows) if good[k] and (k + 1 == len(rows) or good[k + 1])
            ]
            found += sorted(kept, key=lambda row: row.time)[:1]
        return tuple(sorted(found, key=lambda row: row.time))

    def curves(self) -> dict[tuple[str, str], list[Measurement]]:
        """(solver, setting) -> its rows that were run, from loose to tight."""
        found: dict[tuple[str, str], list[Measurement]] = {}
        for row in self.rows:
            if row.status != "not_run":
                found.setdefault((row.solver, row.setting), []).append(row)
        return found

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The rows as columns, each (rows,); errors as "end.q", "smooth.p" and so on."""
        columns: dict[str, list[Any]] = {}
        for row in self.rows:
            for name, value in _flat(row).items():
                columns.setdefault(name, []).append(value)
        return {name: np.array(values) for name, values in columns.items()}

    def save(self, path: str | Path) -> Path:
        """Writes the rows as .csv, units in the header.

        Raises:
            ValueError: The suffix is another.
            OSError: The file cannot be written.
        """
        columns = self.to_dict()
        header = [name + _COLUMN_UNITS.get(name, "") for name in columns]
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        return save_by_suffix(path, {".csv": lambda file: save_csv(file, header, rows)})

    def to_pandas(self) -> Any:
        """The rows as a pandas DataFrame; needs the extra `study`.

        Raises:
            ImportError: pandas is not installed.
        """
        from ..support.extras import require

        pandas = require("pandas", extra="study", purpose="to_pandas")
        return pandas.DataFrame(self.to_dict())


_COLUMN_UNITS = {
    "holonomic": " [m]",
    "nonholonomic": " [m/s]",
    "time": " [s]",
    "lower_quartile": " [s]",
    "upper_quartile": " [s]",
}


def _flat(row: Measurement) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for each in fields(row):
        value = getattr(row, each.name)
        if isinstance(value, Mapping):
            found |= {f"{each.name}.{name}": value.get(name, math.nan) for name in QUANTITIES}
        elif each.name == "quartiles":
            found |= dict(zip(("lower_quartile", "upper_quartile"), value, strict=True))
        else:
            found[each.name] = value
    return found
