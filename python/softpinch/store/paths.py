"""The paths of runs that a study keeps: Parquet files with a row for each recorded instant.

What is no array, such as the status, stands as JSON in the file's record.
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
    """Those that a study's folder keeps: number -> `Run`, read when it is asked for.

    Only paths of runs that the study has are shown.
    """

    def __init__(self, folder: Folder, scene_of: Any) -> None:
        """Takes the study's folder, and the function that gives the scene of a run."""
        self._folder = folder
        self._scene_of = scene_of

    def __iter__(self) -> Iterator[int]:
        """Their numbers, increasing."""
        there = self._folder.path / TRAJECTORIES
        try:
            found = [Path(name) for name in disk.visible(there)]
        except (FileNotFoundError, NotADirectoryError):
            found = []
        except OSError as error:
            raise StoreError(f"{there}: cannot be read: {disk.reason(error)}") from None
        # No run has a number of more digits.
        stems = [file.stem for file in found if file.suffix == ".parquet" and len(file.stem) < 20]
        numbers = {int(stem) for stem in stems if stem.isdecimal() and stem.isascii()}
        return iter(sorted(run for run in numbers if run in self))

    def __len__(self) -> int:
        """How many there are."""
        return sum(1 for _ in self)

    def __contains__(self, run: object) -> bool:
        """Whether the path of a run is kept."""
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
        """The path of a run.

        Raises:
            KeyError: It is not kept.
            StoreError: Its file is damaged.
        """
        if run not in self:
            raise KeyError(f"the path of run {run} is not kept: pass trajectories=({run},)")
        result = self._result(int(run))
        options = replace(self._folder.setup.options, record=_core.RECORDABLE)
        return restored(self._scene_of(run), options, result)

    def _result(self, run: int) -> dict[str, Any]:
        """What a file holds, as the core gave it; its checksums are compared."""
        file, study = self._file(run), self._folder.identity
        record = table.read_record(file, study)
        columns = table.read(file, study, record.digest)
        try:
            if record.data["run"] != run:
                raise ValueError(f"it has the path of run {record.data['run']}")
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
            if result["begun"] is not None:
                result["begun"] = tuple(result["begun"])
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise StoreError(
                f"{file}: is damaged: {disk.one_line(error)}; delete it and resume the study, and "
                "the path is computed again"
            ) from None
        return result

    def _file(self, run: int) -> Path:
        return self._folder.path / TRAJECTORIES / f"{run}.parquet"

    def keep(self, run: int, path: Run) -> None:
        """Writes the path of a run.

        Raises:
            StoreError: It cannot be written.
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
        """What is wrong with their files, one line each."""
        for run in self:
            try:
                self._result(run)
            except StoreError as error:
                yield str(error)


def _plain(value: Any) -> Any:
    """Arrays in dictionaries as lists."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value
