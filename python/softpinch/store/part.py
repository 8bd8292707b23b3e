"""Rows of runs as Parquet, for any tool, and back to the bit.

One row a run; a value of several numbers has a column for each, named as in `Ensemble.to_pandas`.
What never happened, or is not a number, is null. The metadata of every column has its unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..study.columns import split
from ..study.job import MOST_BLOCKS
from ..study.rows import Rows
from ..study.run_table import names
from ..study.setup import Setup
from ..study.sources import BLOCK
from ..study.spans import Edges, Spans
from ..support.errors import StoreError
from . import table
from .table import Texts

_TEXTS = ("status", "message")
# Unsigned 64-bit integers, which not every tool reads, are written with a sign.
_COUNTS = ("run", "steps")
# Rows become a part once they have so many numbers, 64 MB.
MOST_NUMBERS = 2**23
# Rows that come at once, so that a part may have so many more.
_AT_ONCE = MOST_BLOCKS * BLOCK
# Numbers of runs are below 2**62.
_END = 2**62


class Part(NamedTuple):
    """A file of rows, as it was when it was opened.

    Attributes:
        path: The file.
        digest: SHA-256 of its record.
        edges: (k, 2), first and one past the last run of each interval.
    """

    path: Path
    digest: str
    edges: Edges

    @classmethod
    def open(cls, path: Path, study: str) -> Part:
        """A part of a study; only its footer is read.

        Raises:
            StoreError: It is damaged, or no part of this study.
        """
        record = table.read_record(path, study)
        try:
            edges = np.array(record.data["runs"])
            if edges.dtype != np.int64 or edges.ndim != 2 or edges.shape[1] != 2:
                raise ValueError("no intervals")
            inner = edges.ravel()
            # Checked before anything is counted, so that nothing overflows.
            if inner[0] < 0 or inner[-1] > _END or (inner[1:] <= inner[:-1]).any():
                raise ValueError("no increasing intervals")
            if Spans(edges).count != record.data["rows"]:
                raise ValueError("another number of runs than rows")
            # Of a stranger's part, which may be a small file for many gigabytes of equal numbers.
            if (record.data["rows"] - _AT_ONCE) * len(record.data["columns"]) > MOST_NUMBERS:
                raise ValueError(f"{record.data['rows']} rows, more than a study writes into one")
        except (KeyError, TypeError, ValueError) as error:
            raise StoreError(f"{path}: its record has wrong runs: {error!r}; delete it") from None
        return cls(path, record.digest, edges)

    def read(self, study: str, entries: Iterable[str], setup: Setup) -> dict[str, NDArray[Any]]:
        """Some entries of `Results.to_dict`, each (runs, ...), compared with their checksums.

        Args:
            study: The identity of the study.
            entries: Their names, or names of single columns of theirs.
            setup: The study's.

        Raises:
            StoreError: The file is gone or damaged.
        """
        empty = setup.empty().columns
        wanted = {
            entry: list(split(entry, empty[entry])) if entry in empty else [entry]
            for entry in entries
        }
        flat = [name for columns in wanted.values() for name in columns]
        found = table.read(self.path, study, self.digest, flat)
        return {
            entry: _entry(entry, [found[name] for name in columns], empty)
            for entry, columns in wanted.items()
        }


def encode(rows: Rows, setup: Setup, study: str) -> memoryview:
    """A part with some rows, in memory; `study` is the identity of their study."""
    entries = rows.entries()
    columns: dict[str, table.Column] = {}
    units = {}
    for entry in names(setup):
        for name, (values, unit) in split(entry, entries[entry]).items():
            columns[name] = values
            if entry in _TEXTS:
                columns[name] = Texts.of(values.tolist())
            elif entry in _COUNTS:
                columns[name] = values.astype(np.int64)
            units[name] = unit
    runs = Spans.of(rows.run).edges.tolist()
    return table.encode(columns, study, {"runs": runs}, units, nulls=True)


def _entry(entry: str, columns: Sequence[Any], empty: Any) -> NDArray[Any]:
    """An entry out of its columns."""
    first = columns[0]
    if isinstance(first, Texts):
        found: NDArray[Any] = np.array(first.words, dtype=empty[entry].dtype)[first.codes]
        return found
    numbers: NDArray[Any] = first
    if entry in _COUNTS:
        return numbers.astype(np.uint64)
    shape = empty[entry].shape[1:] if entry in empty else ()
    return np.stack(columns, axis=1).reshape(len(numbers), *shape) if shape else numbers
