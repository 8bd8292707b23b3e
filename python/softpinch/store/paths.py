"""Recorded trajectories of single runs: Parquet files with a row for each recorded instant.

Values that are not arrays, such as the status, are JSON in the file's record.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..run.run import Run, restored
from ..support import disk
from ..support.errors import StoreError
from . import files, table
from .files import TRAJECTORIES
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
        """Iterates over the run numbers, increasing."""
        there = self._folder.path / TRAJECTORIES
        try:
            found = [Path(name) for name in disk.visible(there)]
        except (FileNotFoundError, NotADirectoryError):
            found = []
        except OSError as error:
            raise StoreError(f"{there}: cannot be read: {disk.reason(error)}") from None
        # Run numbers have at most 19 digits.
        stems = [file.stem for file in found if file.suffix == ".parquet" and len(file.stem) < 20]
        numbers = {int(stem) for stem in stems if stem.isdecimal() and stem.isascii()}
        return iter(sorted(run for run in numbers if run in self))

    def __len__(self) -> int:
        """The number of trajectories."""
        return sum(1 for _ in self)

    def __contains__(self, run: object) -> bool:
        """Whether the folder has the trajectory of a run."""
        if not isinstance(run, int | np.integer) or not 0 <= run < 2**62:
            return False
        number = int(run)
        if not self._folder.done.within(number, number + 1).count:
            return False
        try:
            os.lstat(self._file(number))
        except (FileNotFoundError, NotADirectoryError):
            return False
        except OSError as error:
            raise StoreError(
                f"{self._file(number)}: cannot be read: {disk.reason(error)}"
            ) from None
        return True

    def __getitem__(self, run: int) -> Run:
        """The trajectory of a run.

        Raises:
            KeyError: The folder does not have the trajectory.
            StoreError: The file is damaged.
        """
        if run not in self:
            raise KeyError(f"the trajectory of run {run} is not kept: pass trajectories=({run},)")
        result = self._result(int(run))
        options = replace(self._folder.setup.options, record=_core.RECORDABLE)
        return restored(self._scene_of(run), options, result)

    def _result(self, run: int) -> dict[str, Any]:
        """Reads a file back into the result that the core returned, and verifies its checksums."""
        file, study = self._file(run), self._folder.identity
        record = table.read_record(file, study)
        columns = table.read(file, study, record.digest)
        try:
            if record.data["run"] != run:
                raise ValueError(f"it has the trajectory of run {record.data['run']}")
            result = dict(record.data["result"])
            for name, width in record.data["arrays"].items():
                if width is None:
                    result[name] = columns[name]
                else:
                    parts = [columns[f"{name}.{k}"] for k in range(width)]
                    result[name] = np.stack(parts, axis=1)
            result["final"] = {
                name: np.array(value) if isinstance(value, list) else value
                for name, value in result["final"].items()
            }
            result["violation_intervals"] = {
                name: np.array(value) for name, value in result["violation_intervals"].items()
            }
            if result["begun"] is not None:
                result["begun"] = tuple(result["begun"])
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise StoreError(
                f"{file}: is damaged: {disk.one_line(error)}; delete it and resume the study, "
                "which computes the trajectory again"
            ) from None
        return result

    def _file(self, run: int) -> Path:
        return self._folder.path / TRAJECTORIES / f"{run}.parquet"

    def add(self, run: int, path: Run) -> None:
        """Writes the trajectory `path` of a run.

        Raises:
            StoreError: The file cannot be written.
        """
        columns: dict[str, table.Column] = {}
        widths: dict[str, int | None] = {}
        facts = {}
        for name, value in path._result.items():
            if not isinstance(value, np.ndarray):
                facts[name] = _plain(value)
            elif value.ndim == 1:
                columns[name], widths[name] = value, None
            else:
                columns.update((f"{name}.{k}", value[:, k]) for k in range(value.shape[1]))
                widths[name] = value.shape[1]
        more = {"run": run, "arrays": widths, "result": facts}
        data = table.encode(columns, self._folder.identity, more)
        files.write(self._file(run), data)

    def damaged(self) -> Iterator[str]:
        """Reads every file, and yields one line for each damaged file."""
        for run in self:
            try:
                self._result(run)
            except StoreError as error:
                yield str(error)


def _plain(value: Any) -> Any:
    """Converts arrays, also inside dictionaries, to lists."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value
