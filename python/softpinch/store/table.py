"""Parquet files in which every number is verified when it is read: parts and trajectories.

The Parquet metadata of a file has an entry "softpinch": one line with the SHA-256 of a record and
the record itself in JSON. The record describes the file and has a checksum of each column's
content. Parquet's own page checksums are written and verified too, but they cover only the bytes of
pages; the checksums of content also detect changes of page headers and of the footer.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..support.disk import one_line
from ..support.errors import StoreError
from ..support.extras import require
from ..support.files import without_waiting
from ..support.interrupt import by_handler

_KEY = "softpinch"
# The entry begins with a fixed word, so that the search for it in the footer's bytes is fast.
_ENTRY = re.compile(rb"softpinch-record ([0-9a-f]{64}) (\{[^\n]*\})\n")
_END = b"PAR1"
# Bytes read from a file's end at first; they hold the whole footer in most files.
_FOOTER = 2**14
# Files with a longer footer or with more rows are not ours, and are refused before memory is
# allocated for them.
_MOST_FOOTER, _MOST_ROWS = 2**26, 2**27
# Tables with more rows are read on several threads.
_FEW_ROWS = 2**16


class Texts(NamedTuple):
    """A column of texts with few distinct values, dictionary-encoded.

    Attributes:
        codes: (rows,) int32, the index of each row's text in `words`.
        words: The distinct texts, in the order of first appearance.
    """

    codes: NDArray[np.int32]
    words: list[str]

    @classmethod
    def of(cls, texts: Sequence[str]) -> Self:
        """Encodes one text for each row."""
        places: dict[str, int] = {}
        codes = [places.setdefault(text, len(places)) for text in texts]
        return cls(np.array(codes, np.int32), list(places))


# Integers, floats or booleans (rows,), or texts.
Column: TypeAlias = NDArray[Any] | Texts


class Record(NamedTuple):
    """The description of a file, from its metadata.

    Attributes:
        digest: SHA-256 of the record, in hexadecimal.
        data: The record's JSON: "study" (identity), "rows", "columns" (name -> checksum), and
            entries that the writer added.
    """

    digest: str
    data: dict[str, Any]


def arrow(module: str = "pyarrow") -> Any:
    """Imports pyarrow, or a module of it.

    Raises:
        ImportError: pyarrow is not installed.
    """
    return require(module, extra="study", purpose="a study's folder (pyarrow)")


def encode(
    columns: Mapping[str, Column],
    study: str,
    more: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
    nulls: bool = False,
) -> memoryview:
    """Encodes a Parquet file, in memory.

    Args:
        columns: Name -> numbers or texts, all with the same number of rows.
        study: The identity of the study to which they belong.
        more: Further entries of the record, as plain data.
        units: Name -> unit, for the metadata of the columns.
        nulls: Whether NaN is written as null; it is read as NaN in both cases.
    """
    pa, parquet = arrow(), arrow("pyarrow.parquet")
    arrays, fields, checksums = [], [], {}
    for name, column in columns.items():
        missing = None
        if nulls and not isinstance(column, Texts) and column.dtype.kind == "f":
            missing = np.isnan(column)
            if missing.any():
                # A null loses NaN's payload bits, so the checksum uses the NaN that a reader gets.
                column = np.where(missing, np.nan, column)
        arrays.append(_to_arrow(pa, column, missing))
        checksums[name] = _checksum(column)
        metadata = {"unit": units[name]} if units else None
        fields.append(pa.field(name, arrays[-1].type, metadata=metadata))
    rows = len(arrays[0])
    record = json.dumps({"study": study, "rows": rows, **more, "columns": checksums}).encode()
    entry = b"softpinch-record %s %s\n" % (hashlib.sha256(record).hexdigest().encode(), record)
    sink = pa.BufferOutputStream()
    parquet.write_table(
        pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata={_KEY: entry})),
        sink,
        # Zstandard halves the size at 0.1 us a run, and every Parquet reader supports it.
        compression="zstd",
        compression_level=1,
        # Only texts repeat; building dictionaries of doubles takes long and gains nothing.
        use_dictionary=[name for name, column in columns.items() if isinstance(column, Texts)],
        write_page_checksum=True,
    )
    return memoryview(sink.getvalue())


def read_record(path: Path, study: str) -> Record:
    """Reads the record of a file.

    It reads only the end of the file and decodes only the record: decoding the Parquet metadata of
    thousands of parts would take seconds.

    Raises:
        StoreError: The file is missing, damaged, or belongs to another study.
    """
    with _opened(path) as file:
        size = file.seek(0, 2)
        file.seek(max(size - _FOOTER, 0))
        end = file.read()
        length = int.from_bytes(end[-8:-4], "little")
        if end[-4:] != _END or length > min(_MOST_FOOTER, size - 8):
            raise ValueError("it does not end like a Parquet file")
        if length > len(end) - 8:
            file.seek(size - 8 - length)
            end = file.read(length + 8)
        found = _ENTRY.search(end[-8 - length : -8])
        if found is None:
            raise ValueError("its footer has no record of softpinch")
        return _record(found, study)


def read(path: Path, study: str, digest: str, names: Sequence[str] | None = None) -> dict[str, Any]:
    """Reads columns of a file and verifies their checksums.

    Args:
        path: The file.
        study: The identity of its study.
        digest: The expected SHA-256 of the file's record.
        names: The columns to read; None reads all.

    Returns:
        Name -> array (rows,) or `Texts`.

    Raises:
        StoreError: The file is missing or damaged, or has another record.
    """
    parquet = arrow("pyarrow.parquet")
    with (
        _opened(path) as source,
        parquet.ParquetFile(source, page_checksum_verification=True) as file,
    ):
        metadata = file.metadata
        found = _ENTRY.fullmatch((metadata.metadata or {}).get(_KEY.encode(), b""))
        if found is None:
            raise ValueError("its metadata has no record of softpinch")
        record = _record(found, study)
        if record.digest != digest:
            raise ValueError("it was replaced by another file")
        counts = [metadata.row_group(k).num_rows for k in range(metadata.num_row_groups)]
        if min(counts, default=0) < 0 or sum(counts) != record.data["rows"]:
            raise ValueError(
                f"it has {sum(counts)} rows, but its record says {record.data['rows']}"
            )
        checksums = record.data["columns"]
        wanted = list(checksums if names is None else names)
        # For a small file, starting threads takes longer than reading.
        table = file.read(columns=wanted, use_threads=record.data["rows"] > _FEW_ROWS)
        columns: dict[str, Column] = {n: _from_arrow(table.column(n)) for n in wanted}
        for name, column in columns.items():
            if _checksum(column) != checksums[name]:
                raise ValueError(f"the checksum of its column {name} differs from its record")
        return columns


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    """Opens a file to read, and turns errors inside the block into a StoreError with a remedy."""
    try:
        # Opening a named pipe in the file's place would otherwise wait forever.
        with open(path, "rb", opener=without_waiting) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise ValueError("it is not a regular file")
            yield file
    except StoreError:
        raise
    except FileNotFoundError:
        raise StoreError(
            f"{path}: is missing: restore it, or resume the study, which computes its runs again"
        ) from None
    except MemoryError as error:
        raise StoreError(
            f"{path}: cannot be read: out of memory: {one_line(error)}; if there is enough "
            "memory, the file is damaged: delete it and resume the study"
        ) from None
    # For damaged bytes pyarrow raises errors of many types, OSError among them.
    except Exception as error:
        if by_handler(error):
            raise
        # Errors with an errno come from the system and do not mean damage, except EISDIR: a folder
        # stands in the file's place.
        if isinstance(error, OSError) and error.errno not in (None, errno.EISDIR):
            raise StoreError(f"{path}: cannot be read: {error.strerror}") from None
        raise StoreError(
            f"{path}: is damaged: {one_line(error)}; delete it and resume the study, which "
            "computes its runs again"
        ) from None


def _record(found: re.Match[bytes], study: str) -> Record:
    digest, text = found[1].decode(), found[2]
    if hashlib.sha256(text).hexdigest() != digest:
        raise ValueError("its record has been altered")
    data = json.loads(text)
    if data["study"] != study:
        raise ValueError("it belongs to another study than the manifest describes")
    if type(data["rows"]) is not int or not 0 < data["rows"] <= _MOST_ROWS:
        raise ValueError(f"its record has rows = {data['rows']}")
    return Record(digest, data)


def _checksum(column: Column) -> str:
    """The first 128 bits of a SHA-256 of a column's content, enough against accidental damage."""
    if isinstance(column, Texts):
        total = hashlib.sha256(json.dumps(column.words).encode())
        column = column.codes
    else:
        total = hashlib.sha256(column.dtype.str.encode())
    total.update(np.ascontiguousarray(column).data)
    return total.hexdigest()[:32]


# The next three functions convert through Arrow's buffers, because its own conversions from and to
# NumPy first import pandas, which takes longer than writing a million rows.
def _to_arrow(pa: Any, column: Column, missing: NDArray[np.bool_] | None) -> Any:
    if isinstance(column, Texts):
        data = [word.encode() for word in column.words]
        ends = np.cumsum([0, *map(len, data)]).astype(np.int32)
        buffers = [None, pa.py_buffer(ends), pa.py_buffer(b"".join(data))]
        words = pa.Array.from_buffers(pa.string(), len(data), buffers)
        return pa.DictionaryArray.from_arrays(_to_arrow(pa, column.codes, None), words)
    bits = None
    if missing is not None and missing.any():
        bits = pa.py_buffer(np.packbits(~missing, bitorder="little"))
    if column.dtype == bool:  # Arrow keeps eight in a byte
        packed = pa.py_buffer(np.packbits(column, bitorder="little"))
        return pa.Array.from_buffers(pa.bool_(), len(column), [bits, packed])
    values = pa.py_buffer(np.ascontiguousarray(column))
    kind = getattr(pa, column.dtype.name)()
    return pa.Array.from_buffers(kind, len(column), [bits, values])


def _from_arrow(column: Any) -> Column:
    if hasattr(column.type, "value_type"):
        array = column.unify_dictionaries().combine_chunks()
        return Texts(_numbers(array.indices), array.dictionary.to_pylist())
    kind = column.type.to_pandas_dtype()
    return np.concatenate([np.empty(0, kind), *map(_numbers, column.chunks)])


def _numbers(array: Any) -> NDArray[Any]:
    """The numbers of an Arrow array, with NaN for null."""
    kind = array.type.to_pandas_dtype()
    if not len(array):
        return np.empty(0, kind)
    bits, data = array.buffers()
    here = slice(array.offset, array.offset + len(array))
    values: NDArray[Any]
    if kind is np.bool_:
        values = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")[here].astype(bool)
    else:
        values = np.frombuffer(data, kind)[here]
    if array.null_count:
        valid = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")[here]
        values = np.where(valid.astype(bool), values, np.nan)
    return values
