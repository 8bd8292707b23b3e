"""Parquet files whose every number is checked when it is read. Parts and kept paths are such files.

The Parquet metadata of a file has one entry of ours, "softpinch": a line with the SHA-256 of a
record, and the record itself in JSON. It says what the file holds, and has a checksum of the
content of each column. Parquet's own page checksums are written and verified, too; they cover the
bytes of pages only, while a change of a page's header or of the footer shows in the content.
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
# It begins with a word, so that it is found fast.
_ENTRY = re.compile(rb"softpinch-record ([0-9a-f]{64}) (\{[^\n]*\})\n")
_END = b"PAR1"
# How much of a file's end holds the whole footer, most often.
_FOOTER = 2**14
# No footer of ours comes near the first, no table near the second.
_MOST_FOOTER, _MOST_ROWS = 2**26, 2**27
_FEW_ROWS = 2**16


class Texts(NamedTuple):
    """A column of texts, of which most are equal.

    Attributes:
        codes: (rows,) int32, the place of each row's text in `words`.
        words: The different texts, in the order in which they first appear.
    """

    codes: NDArray[np.int32]
    words: list[str]

    @classmethod
    def of(cls, texts: Sequence[str]) -> Self:
        """Of one text a row."""
        places: dict[str, int] = {}
        codes = [places.setdefault(text, len(places)) for text in texts]
        return cls(np.array(codes, np.int32), list(places))


# Numbers (rows,), integers or floats, or texts.
Column: TypeAlias = NDArray[Any] | Texts


class Record(NamedTuple):
    """What a file says about itself.

    Attributes:
        digest: SHA-256 of the record, in hexadecimal.
        data: Its JSON: "study", "rows", "columns" (name -> checksum), and what the writer added.
    """

    digest: str
    data: dict[str, Any]


def arrow(module: str = "pyarrow") -> Any:
    """pyarrow, or a module of it.

    Raises:
        ImportError: It is not installed.
    """
    return require(module, extra="study", purpose="a study's folder (pyarrow)")


def encode(
    columns: Mapping[str, Column],
    study: str,
    more: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
    nulls: bool = False,
) -> memoryview:
    """A Parquet file, in memory.

    Args:
        columns: Name -> numbers or texts, all with the same number of rows.
        study: The identity of the study to which they belong.
        more: What else the record has, as plain data.
        units: Name -> unit, for the metadata of the columns.
        nulls: Whether NaN is written as null; it is read as NaN either way.
    """
    pa, parquet = arrow(), arrow("pyarrow.parquet")
    arrays, fields, checksums = [], [], {}
    for name, column in columns.items():
        missing = None
        if nulls and not isinstance(column, Texts) and column.dtype.kind == "f":
            missing = np.isnan(column)
            if missing.any():
                # Null has no payload, so the checksum is of the NaN that a reader gets.
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
        # Half the bytes for 0.1 us a run; every reader has it.
        compression="zstd",
        compression_level=1,
        # Only texts repeat; trying the same for doubles takes long.
        use_dictionary=[name for name, column in columns.items() if isinstance(column, Texts)],
        write_page_checksum=True,
    )
    return memoryview(sink.getvalue())


def read_record(path: Path, study: str) -> Record:
    """What a file says about itself.

    Only the end of the file is read, and nothing but the record is decoded: of thousands of parts,
    Parquet's own metadata would take seconds.

    Raises:
        StoreError: The file is gone, damaged, or belongs to another study.
    """
    with _opened(path) as file:
        size = file.seek(0, 2)
        file.seek(max(size - _FOOTER, 0))
        end = file.read()
        length = int.from_bytes(end[-8:-4], "little")
        if end[-4:] != _END or length > min(_MOST_FOOTER, size - 8):
            raise ValueError("it does not end as a Parquet file does")
        if length > len(end) - 8:
            file.seek(size - 8 - length)
            end = file.read(length + 8)
        found = _ENTRY.search(end[-8 - length : -8])
        if found is None:
            raise ValueError("its footer has no record of softpinch")
        return _record(found, study)


def read(path: Path, study: str, digest: str, names: Sequence[str] | None = None) -> dict[str, Any]:
    """Columns of a file (all without names): arrays or `Texts`, compared with their checksums.

    Args:
        path: The file.
        study: The identity of its study.
        digest: Of the record that the file has.
        names: The columns.

    Raises:
        StoreError: The file is gone or damaged, or has another record.
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
            raise ValueError("it is another file than before")
        counts = [metadata.row_group(k).num_rows for k in range(metadata.num_row_groups)]
        if min(counts, default=0) < 0 or sum(counts) != record.data["rows"]:
            raise ValueError(f"it has {sum(counts)} rows, and its record {record.data['rows']}")
        checksums = record.data["columns"]
        wanted = list(checksums if names is None else names)
        # Starting threads takes longer than reading a small file.
        table = file.read(columns=wanted, use_threads=record.data["rows"] > _FEW_ROWS)
        columns: dict[str, Column] = {n: _from_arrow(table.column(n)) for n in wanted}
        for name, column in columns.items():
            if _checksum(column) != checksums[name]:
                raise ValueError(f"its column {name} has another checksum than its record says")
        return columns


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    """A file to read; whatever is wrong with its bytes is an error that says what to do."""
    try:
        # A pipe in its place would otherwise be waited for forever.
        with open(path, "rb", opener=without_waiting) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise ValueError("it is no file")
            yield file
    except StoreError:
        raise
    except FileNotFoundError:
        raise StoreError(
            f"{path}: is gone: put it back, or resume the study, and what it held is computed again"
        ) from None
    except MemoryError as error:
        raise StoreError(
            f"{path}: cannot be read: out of memory: {one_line(error)}; if there is enough, it is "
            "damaged: delete it and resume the study"
        ) from None
    # Damaged bytes raise errors of many types in pyarrow, and OSError among them.
    except Exception as error:
        if by_handler(error):
            raise
        # The system's errors say nothing about the bytes, but that they are a folder's.
        if isinstance(error, OSError) and error.errno not in (None, errno.EISDIR):
            raise StoreError(f"{path}: cannot be read: {error.strerror}") from None
        raise StoreError(
            f"{path}: is damaged: {one_line(error)}; delete it and resume the study, and what it "
            "held is computed again"
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
    """Of a column's content; 128 bits are enough against accidents, and it stands in each file."""
    if isinstance(column, Texts):
        total = hashlib.sha256(json.dumps(column.words).encode())
        column = column.codes
    else:
        total = hashlib.sha256(column.dtype.str.encode())
    total.update(np.ascontiguousarray(column).data)
    return total.hexdigest()[:32]


# Arrow's arrays are made from buffers, and taken apart into buffers: its own conversions from and
# to NumPy import pandas first, which takes longer than writing a million rows.
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
    """The numbers of an Arrow array; NaN for null."""
    kind = array.type.to_pandas_dtype()
    if not len(array):
        return np.empty(0, kind)
    bits, data = array.buffers()
    here = slice(array.offset, array.offset + len(array))
    values: NDArray[Any] = np.frombuffer(data, kind)[here]
    if array.null_count:
        valid = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")[here]
        values = np.where(valid.astype(bool), values, np.nan)
    return values
