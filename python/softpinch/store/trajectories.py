"""Recorded trajectories of single runs: Parquet files with a row for each recorded instant.

Values that are not arrays, such as the status, are JSON in the file's metadata.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..run.ledger import LEDGER
from ..run.options import Options
from ..run.run import Run, restored
from ..scene.fields import COLUMNS
from ..study.spec import RECORDING
from ..support.record import plain
from . import files
from .files import DIGESTS, TRAJECTORIES
from .folder import Folder


class Trajectories(Mapping[int, Run]):
    """The trajectories in a study's folder: run number -> `Run`, read on access.

    A trajectory counts only if the study has a row of its run.
    """

    def __init__(self, folder: Folder, scene_of: Any) -> None:
        """Takes the study's folder, and a function from a run number to that run's scene."""
        self._folder = folder
        self._scene_of = scene_of

    def __iter__(self) -> Iterator[int]:
        found = _runs((self._folder.path / TRAJECTORIES).glob("*.parquet"))
        return iter([run for run in found if run in self])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, run: object) -> bool:
        if not isinstance(run, int | np.integer):
            return False
        return self._folder.done.has(int(run)) and self._file(int(run)).exists()

    def __getitem__(self, run: int) -> Run:
        if run in self.missing():
            raise KeyError(f"{self._file(run)} is missing; `resume()` computes it again")
        if run not in self:
            raise KeyError(f"the trajectory of run {run} is not kept: pass trajectories=({run},)")
        options, result = self.read(int(run))
        return restored(self._scene_of(run), options, result)

    def missing(self) -> list[int]:
        """The runs whose trajectories were written, and whose files are no longer there."""
        digests = (self._folder.path / DIGESTS).glob(f"{TRAJECTORIES}-*.parquet.sha256")
        written = _runs(Path(file.stem.removeprefix(f"{TRAJECTORIES}-")) for file in digests)
        return [run for run in written if self._folder.done.has(run) and run not in self]

    def read(self, run: int) -> tuple[Options, dict[str, Any]]:
        """Reads a file back into the options and the core's result."""
        file = self._file(run)
        columns, facts = files.read(file, files.read_digest(file))
        with files.reading(file):
            if (facts["study"], facts["run"]) != (self._folder.identity, run):
                raise ValueError("it belongs to another study or another run")
            result: dict[str, Any] = dict(facts["result"])
            numerics = self._folder.spec.options.numerics()
            options = Options.checked(**numerics, **facts["options"])
            for name, own in facts["arrays"].items():
                result[name] = (
                    columns[own]
                    if isinstance(own, str)
                    else np.stack([columns[each] for each in own], axis=1)
                )
            result["final"] = {
                name: np.array(value) if isinstance(value, list) else value
                for name, value in result["final"].items()
            }
            intervals = result["violation_intervals"]
            result["violation_intervals"] = {k: np.array(v) for k, v in intervals.items()}
            if result["begun"] is not None:
                result["begun"] = tuple(result["begun"])
            return options, result

    def _file(self, run: int) -> Path:
        return self._folder.path / TRAJECTORIES / f"{run}.parquet"

    def add(self, run: int, path: Run) -> None:
        """Writes the trajectory `path` of a run."""
        # Without this column, tools that read many files could not tell the runs apart.
        columns: dict[str, NDArray[Any]] = {"run": np.full(len(path), run)}
        names: dict[str, str | list[str]] = {}
        result = {}
        for name, value in path._result.items():
            if not isinstance(value, np.ndarray):
                result[name] = plain(value)
            elif value.ndim == 1:
                columns[name], names[name] = value, name
            else:
                # The names of the columns are those of `Run.save`, without units.
                width = value.shape[1]
                headers = COLUMNS.get(name, [f"{name}.{k}" for k in range(width)])
                if name == "energy":
                    headers = [f"energy_{each}" for each in LEDGER[:width]]
                names[name] = [header.partition(" [")[0] for header in headers]
                columns.update(zip(names[name], value.T, strict=True))
        facts = {
            "study": self._folder.identity,
            "run": run,
            "options": {name: plain(getattr(path._options, name)) for name in RECORDING},
            "arrays": names,
            "result": result,
        }
        files.write_with_digest(self._file(run), files.encode(columns, facts))


def _runs(files: Iterable[Path]) -> list[int]:
    """The sorted numbers of the runs whose trajectories have these files' names."""
    # Run numbers have at most 19 digits.
    return sorted(int(f.stem) for f in files if f.stem.isdecimal() and len(f.stem) < 20)
