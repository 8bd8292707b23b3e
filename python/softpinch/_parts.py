"""Rows of runs as Parquet, for any tool that reads it, and back to the bit.

One row a run; a value of several numbers has a column for each, named as in `Ensemble.to_pandas`.
What never happened, or is not a number, is null. Every column has its unit in its metadata.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _columns
from ._extras import require
from ._rows import Rows
from ._setup import Setup
from .results import failure_time, names

_TEXTS = ("status", "message")
_COUNTS = ("run", "steps")


def arrow(module: str = "pyarrow") -> Any:
    """pyarrow, or a part of it.

    Raises:
        ImportError: It is not installed.
    """
    return require(module, extra="study", purpose="a study's folder (pyarrow)")


def encode(rows: Rows, setup: Setup) -> memoryview:
    """A Parquet file of some rows, in memory."""
    pa, parquet = arrow(), arrow("pyarrow.parquet")
    columns = {**rows.columns, "failure_time": failure_time(rows.columns)}
    arrays, fields = [], []
    for entry in names(setup):
        for name, column in _columns.split(entry, columns[entry]).items():
            array = _array(pa, entry, column.values)
            arrays.append(array)
            fields.append(pa.field(name, array.type, metadata={"unit": column.unit}))
    sink = pa.BufferOutputStream()
    parquet.write_table(
        pa.Table.from_arrays(arrays, schema=pa.schema(fields)),
        sink,
        # Half the bytes for 0.1 us a run; every reader has it.
        compression="zstd",
        compression_level=1,
        # Doubles that scatter do not repeat, and take long to try.
        use_dictionary=list(_TEXTS),
    )
    return memoryview(sink.getvalue())


def _array(pa: Any, entry: str, values: NDArray[Any]) -> Any:
    if entry in _TEXTS:
        # By hashing: sorting texts takes three times as long.
        return pa.array(values, pa.string()).dictionary_encode()
    if entry in _COUNTS:
        return pa.array(values.astype(np.int64))
    return pa.array(np.ascontiguousarray(values), from_pandas=True)


def decode(source: Any, entries: Iterable[str], setup: Setup) -> dict[str, NDArray[Any]]:
    """Some entries of `Results.to_dict`, each (runs, ...), out of a Parquet file.

    Args:
        source: The file's path, or pyarrow's buffer of it.
        entries: Their names.
        setup: Of its study.
    """
    parquet = arrow("pyarrow.parquet")
    empty = setup.empty().columns
    wanted = {
        entry: list(_columns.split(entry, empty.get(entry, empty["end_time"]))) for entry in entries
    }
    flat = [name for parts in wanted.values() for name in parts]
    with parquet.ParquetFile(source) as file:
        table = file.read(columns=flat)
    return {entry: _joined(table, entry, parts, empty) for entry, parts in wanted.items()}


def _joined(
    table: Any, entry: str, parts: list[str], empty: Mapping[str, NDArray[Any]]
) -> NDArray[Any]:
    columns = [table.column(name) for name in parts]
    if entry in _TEXTS:
        column = columns[0].unify_dictionaries().combine_chunks()
        texts = np.array(column.dictionary.to_pylist(), dtype=empty[entry].dtype)
        found: NDArray[Any] = texts[column.indices.to_numpy()]
        return found
    arrays: list[NDArray[Any]] = [column.to_numpy() for column in columns]
    if entry in _COUNTS:
        return arrays[0].astype(np.uint64)
    shape = empty[entry].shape[1:] if entry in empty else ()
    return np.stack(arrays, axis=1).reshape(len(arrays[0]), *shape) if shape else arrays[0]
