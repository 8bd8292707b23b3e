"""The paths of runs as Arrow files, for any tool that reads them, and back to the bit.

A row for each recorded instant; what is no array, as the status, is JSON in the metadata.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from . import _core
from ._folder import TRAJECTORIES
from ._folder import replace as write
from ._parts import arrow
from ._setup import Setup
from .results import StoreError
from .run import Run


class Trajectories(Mapping[int, Run]):
    """Those that a study's folder keeps: number -> `Run`, read when it is asked for."""

    def __init__(self, path: Path, setup: Setup, scene_of: Any) -> None:
        """Takes the study's folder, and what gives the scene of a run."""
        self._path = path / TRAJECTORIES
        self._setup = setup
        self._scene_of = scene_of

    def __iter__(self) -> Iterator[int]:
        """Their numbers, increasing."""
        return iter(sorted(int(file.stem) for file in self._path.glob("[0-9]*.arrow")))

    def __len__(self) -> int:
        """How many there are."""
        return sum(1 for _ in self)

    def __contains__(self, run: object) -> bool:
        """Whether the path of a run is kept."""
        return isinstance(run, int | np.integer) and self._file(int(run)).exists()

    def __getitem__(self, run: int) -> Run:
        """The path of a run.

        Raises:
            KeyError: It is not kept.
            StoreError: Its file is damaged.
        """
        if run not in self:
            raise KeyError(f"the path of run {run} is not kept: pass trajectories=({run},)")
        file = self._file(run)
        try:
            with arrow().memory_map(str(file)) as source:
                table = arrow("pyarrow.ipc").open_file(source).read_all()
            result = json.loads(table.schema.metadata[b"softpinch"])
            for name in table.column_names:
                column = table.column(name).combine_chunks()
                shape = (len(column), -1) if hasattr(column.type, "list_size") else (len(column),)
                flat = column.flatten() if len(shape) == 2 else column
                result[name] = flat.to_numpy(zero_copy_only=False).copy().reshape(shape)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StoreError(f"{file}: is damaged: {error}") from None
        result["final"] = {
            name: np.array(value) if isinstance(value, list) else value
            for name, value in result["final"].items()
        }
        if result["begun"] is not None:
            result["begun"] = tuple(result["begun"])
        options = replace(self._setup.options, record=_core.RECORDABLE)
        return Run(self._scene_of(run), options, result)

    def _file(self, run: int) -> Path:
        return self._path / f"{run}.arrow"

    def keep(self, run: int, path: Run) -> None:
        """Writes the path of a run.

        Raises:
            StoreError: It cannot be written.
        """
        pa = arrow()
        arrays, facts = {}, {}
        for name, value in path._result.items():
            if isinstance(value, np.ndarray) and value.ndim == 2:
                flat = pa.array(value.reshape(-1))
                arrays[name] = pa.FixedSizeListArray.from_arrays(flat, value.shape[1])
            elif isinstance(value, np.ndarray):
                arrays[name] = pa.array(value)
            else:
                facts[name] = value
        text = json.dumps(facts, default=np.ndarray.tolist)
        table = pa.table(arrays).replace_schema_metadata({"softpinch": text})
        sink = pa.BufferOutputStream()
        with arrow("pyarrow.ipc").new_file(sink, table.schema) as file:
            file.write_table(table)
        try:
            self._path.mkdir(exist_ok=True)
        except OSError as error:
            raise StoreError(f"{self._path}: cannot be written: {error.strerror}") from None
        write(self._file(run), memoryview(sink.getvalue()))
