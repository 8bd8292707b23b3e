"""The files of a study's folder, written atomically, and Parquet files that have a digest.

manifest.toml                           the study's settings and the software that computed it
parts/000000.parquet                    results, one row for each run
trajectories/17.parquet                 the recorded trajectory of run 17
digests/parts-000000.parquet.sha256     the SHA-256 of that file, in the format of `sha256sum`
arrays/8f43ab.npy                       an array given in `vary`, whose SHA-256 the manifest has
lock                                    held by the process that writes
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..support import StoreError, require
from ..support.files import one_line, write_whole

MANIFEST, LOCK = "manifest.toml", "lock"
PARTS, TRAJECTORIES, DIGESTS, ARRAYS = "parts", "trajectories", "digests", "arrays"
# The entry of a Parquet file's metadata with facts about its rows, in JSON.
_KEY = b"softpinch"
_REMEDY = "delete it and resume the study, which computes it again"


def arrow(module: str = "pyarrow") -> Any:
    """Imports pyarrow, or a module of it."""
    return require(module, extra="study", purpose="a study's folder (pyarrow)")


def write(path: Path, data: memoryview | bytes) -> None:
    """Writes a file as a whole, and makes its folder if that is missing."""
    try:
        path.parent.mkdir(exist_ok=True)
        write_whole(path, data)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror}") from None


@contextmanager
def reading(path: Path, remedy: str = _REMEDY) -> Iterator[None]:
    """Turns errors of reading a file into a StoreError with the file's name and a remedy."""
    try:
        yield
    except StoreError:
        raise
    except FileNotFoundError:
        advice = "restore it, or resume the study, which computes it again"
        raise StoreError(f"{path}: is missing: {advice}") from None
    # pyarrow raises errors of many types for damaged bytes, and OSError without a number.
    except (OSError, ValueError, LookupError, TypeError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise StoreError(f"{path}: cannot be read: {error.strerror}") from None
        raise StoreError(f"{path}: is damaged: {one_line(error)}; {remedy}") from None


def encode(
    columns: Mapping[str, NDArray[Any]],
    facts: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
) -> memoryview:
    """Encodes columns (rows,) and facts about them as a Parquet file; with `units` NaN is null."""
    pa, parquet = arrow(), arrow("pyarrow.parquet")
    arrays, fields, texts = [], [], []
    for name, values in columns.items():
        array = pa.array(values, from_pandas=units is not None)
        if values.dtype.kind in "OU":
            array = array.dictionary_encode()
            texts.append(name)
        arrays.append(array)
        metadata = {"unit": units[name]} if units else None
        fields.append(pa.field(name, array.type, metadata=metadata))
    schema = pa.schema(fields, metadata={_KEY: json.dumps(facts)})
    sink = pa.BufferOutputStream()
    # Zstandard halves the size at 0.1 us a run. Only texts repeat, and gain by dictionaries.
    table = pa.Table.from_arrays(arrays, schema=schema)
    parquet.write_table(table, sink, compression="zstd", compression_level=1, use_dictionary=texts)
    return memoryview(sink.getvalue())


def write_with_digest(path: Path, data: memoryview) -> None:
    """Writes a file, and before it its SHA-256."""
    line = f"{hashlib.sha256(data).hexdigest()}  {path.parent.name}/{path.name}\n"
    write(_digest_file(path), line.encode())
    write(path, data)


def read_digest(path: Path) -> str:
    """Reads the SHA-256 that was written beside a file."""
    file = _digest_file(path)
    with reading(file):
        if not file.exists():
            raise StoreError(f"{path}: has no digest in {DIGESTS}; {_REMEDY}")
        return file.read_bytes()[:64].decode("ascii", "replace")


def _digest_file(path: Path) -> Path:
    return path.parent.parent / DIGESTS / f"{path.parent.name}-{path.name}.sha256"


def facts_of(metadata: Any) -> dict[str, Any]:
    """Reads the facts from the metadata of a Parquet file."""
    entries = metadata.metadata or {}
    if _KEY not in entries:
        raise ValueError("it is not a file of softpinch")
    facts: dict[str, Any] = json.loads(entries[_KEY])
    return facts


def read(
    path: Path, digest: str, names: Sequence[str] | None = None
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Reads columns (rows,) and facts of a Parquet file, compared with its SHA-256 `digest`."""
    pa, parquet = arrow(), arrow("pyarrow.parquet")
    with reading(path):
        data = path.read_bytes()
        if hashlib.sha256(data).hexdigest() != digest:
            raise ValueError(f"its SHA-256 differs from that in {DIGESTS}")
        file = parquet.ParquetFile(pa.BufferReader(data))
        # Threads of Arrow may still hold `data` when the interpreter ends, which then aborts.
        table = file.read(columns=None if names is None else list(names), use_threads=False)
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        return columns, facts_of(file.metadata)
