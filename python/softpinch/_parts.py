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
# What a part's metadata calls the study that it is of.
_IDENTITY = "softpinch_study"
_COUNTS = ("run", "steps")


def arrow(module: str = "pyarrow") -> Any:
    """pyarrow, or a part of it.

    Raises:
        ImportError: It is not installed.
    """
    return require(module, extra="study", purpose="a study's folder (pyarrow)")


def encode(rows: Rows, setup: Setup, identity: str) -> memoryview:
    """A Parquet file of some rows, in memory; `identity` is that of the study."""
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
        pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata={_IDENTITY: identity})),
        sink,
        # Half the bytes for 0.1 us a run; every reader has it.
        compression="zstd",
        compression_level=1,
        # Doubles that scatter do not repeat, and take long to try.
        use_dictionary=list(_TEXTS),
    )
    return memoryview(sink.getvalue())


# Arrow's arrays are made of their buffers here, and taken apart again: its own conversions from and
# to NumPy import pandas first, which takes longer than writing a million rows.
def _array(pa: Any, entry: str, values: NDArray[Any]) -> Any:
    """A column as Arrow has it."""
    if entry in _TEXTS:
        places: dict[str, int] = {}
        codes = [places.setdefault(text, len(places)) for text in values.tolist()]
        indices = _from_buffer(pa, pa.int32(), np.array(codes, np.int32), None)
        return pa.DictionaryArray.from_arrays(indices, _texts(pa, places))
    if entry in _COUNTS:
        return _from_buffer(pa, pa.int64(), values.astype(np.int64), None)
    return _from_buffer(pa, pa.float64(), np.ascontiguousarray(values), ~np.isnan(values))


def _from_buffer(pa: Any, kind: Any, values: NDArray[Any], valid: NDArray[np.bool_] | None) -> Any:
    bits = None
    if valid is not None and not valid.all():
        bits = pa.py_buffer(np.packbits(valid, bitorder="little"))
    return pa.Array.from_buffers(kind, len(values), [bits, pa.py_buffer(values)])


def _texts(pa: Any, texts: Iterable[str]) -> Any:
    data = [text.encode() for text in texts]
    ends = np.cumsum([0, *map(len, data)]).astype(np.int32)
    return pa.StringArray.from_buffers(len(data), pa.py_buffer(ends), pa.py_buffer(b"".join(data)))


def identity_of(source: Any) -> str:
    """Which study a Parquet file is of; empty where it does not say."""
    with arrow("pyarrow.parquet").ParquetFile(source) as file:
        found: bytes = (file.schema_arrow.metadata or {}).get(_IDENTITY.encode(), b"")
        return found.decode()


def decode(source: Any, entries: Iterable[str], setup: Setup) -> dict[str, NDArray[Any]]:
    """Some entries of `Results.to_dict`, each (runs, ...), out of a Parquet file.

    Args:
        source: The file's path, or pyarrow's buffer of it.
        entries: Their names, or those of single columns of theirs.
        setup: Of its study.
    """
    parquet = arrow("pyarrow.parquet")
    empty = setup.empty().columns
    wanted = {
        entry: list(_columns.split(entry, empty[entry])) if entry in empty else [entry]
        for entry in entries
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
        found: NDArray[Any] = texts[_values(column.indices, np.int32)]
        return found
    kind = np.int64 if entry in _COUNTS else np.float64
    arrays = [
        np.concatenate([np.empty(0, kind), *(_values(chunk, kind) for chunk in column.chunks)])
        for column in columns
    ]
    if entry in _COUNTS:
        return arrays[0].astype(np.uint64)
    shape = empty[entry].shape[1:] if entry in empty else ()
    return np.stack(arrays, axis=1).reshape(len(arrays[0]), *shape) if shape else arrays[0]


def _values(array: Any, kind: type[np.generic]) -> NDArray[Any]:
    """The numbers of an Arrow array; NaN for null."""
    bits, data = array.buffers()
    here = slice(array.offset, array.offset + len(array))
    if not len(array):
        return np.empty(0, kind)
    values = np.frombuffer(data, kind)[here]
    if array.null_count:
        valid = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")[here]
        values = np.where(valid.astype(bool), values, np.nan)
    return values
