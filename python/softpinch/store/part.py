"""Conversion of result rows to Parquet files that any tool reads, and back without loss.

A file has one row for each run. A value of several numbers has one column for each number, named as
in `Ensemble.to_pandas`. NaN, such as the time of an event that never happened, is null. The
metadata of every column has its unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..study.columns import Entry
from ..study.job import MOST_BLOCKS
from ..study.rows import Rows
from ..study.setup import Setup
from ..study.sources import BLOCK
from ..study.spans import Edges, Spans
from ..support.errors import StoreError
from . import table
from .table import Texts

# Buffered rows become a part once they hold this many numbers, 64 MB.
MOST_NUMBERS = 2**23
# Rows that one call of the core returns; a part may exceed MOST_NUMBERS by this many rows.
_AT_ONCE = MOST_BLOCKS * BLOCK
# Run numbers are below this limit.
_END = 2**62


class Part(NamedTuple):
    """A file of rows, as found when it was opened.

    Attributes:
        path: The file.
        digest: SHA-256 of the record in its footer (`table.Record`).
        edges: (k, 2), first and one past the last run of each interval.
    """

    path: Path
    digest: str
    edges: Edges

    @classmethod
    def open(cls, path: Path, study: str) -> Part:
        """Opens a part of a study; reads its footer only.

        Raises:
            StoreError: The part is damaged or belongs to another study.
        """
        record = table.read_record(path, study)
        try:
            edges = np.array(record.data["runs"])
            if edges.dtype != np.int64 or edges.ndim != 2 or edges.shape[1] != 2:
                raise ValueError("they are not intervals")
            inner = edges.ravel()
            # Check the bounds before counting, so that the count cannot overflow.
            if inner[0] < 0 or inner[-1] > _END or (inner[1:] <= inner[:-1]).any():
                raise ValueError("the intervals do not increase")
            if Spans(edges).count != record.data["rows"]:
                raise ValueError("there are not as many runs as rows")
            # A stranger's small file may decompress to many gigabytes of equal numbers.
            if (record.data["rows"] - _AT_ONCE) * len(record.data["columns"]) > MOST_NUMBERS:
                raise ValueError(
                    f"{record.data['rows']} rows, more than a study writes into a part"
                )
        except (KeyError, TypeError, ValueError) as error:
            raise StoreError(f"{path}: its record has wrong runs: {error!r}; delete it") from None
        return cls(path, record.digest, edges)

    def read(self, study: str, entries: Iterable[str], setup: Setup) -> dict[str, NDArray[Any]]:
        """Reads entries of `Results.to_dict`, each (runs, ...), and verifies their checksums.

        Args:
            study: The identity of the study.
            entries: Names of entries, or names of single columns of entries.
            setup: The study's setup, which has the schema of the columns.

        Raises:
            StoreError: The file is missing or damaged.
        """
        schema = setup.schema.entries
        wanted = {
            name: list(schema[name].columns) if name in schema else [name] for name in entries
        }
        flat = [name for columns in wanted.values() for name in columns]
        found = table.read(self.path, study, self.digest, flat)
        return {
            name: _values(schema.get(name), [found[column] for column in columns])
            for name, columns in wanted.items()
        }


def encode(rows: Rows, setup: Setup, study: str) -> memoryview:
    """Encodes rows as a part, in memory; `study` is the identity of their study."""
    entries = rows.entries()
    columns: dict[str, table.Column] = {}
    units = {}
    for entry in setup.schema.entries.values():
        for name, (values, unit) in entry.split(entries[entry.name]).items():
            columns[name] = values
            if entry.kind in ("status", "message"):
                columns[name] = Texts.of(values.tolist())
            elif entry.kind == "count":
                # Some Parquet readers lack unsigned 64-bit integers.
                columns[name] = values.astype(np.int64)
            units[name] = unit
    runs = Spans.of(rows.run).edges.tolist()
    return table.encode(columns, study, {"runs": runs}, units, nulls=True)


def _values(entry: Entry | None, columns: Sequence[Any]) -> NDArray[Any]:
    """The array of an entry from its columns; `entry` is None for a single requested column."""
    first = columns[0]
    if entry is None:
        numbers: NDArray[Any] = first
        return numbers
    empty = entry.empty()
    if isinstance(first, Texts):
        return np.array(first.words, dtype=empty.dtype)[first.codes]
    if entry.shape:
        return np.stack(columns, axis=1).reshape(len(first), *entry.shape)
    values: NDArray[Any] = first.astype(empty.dtype, copy=False)
    return values
