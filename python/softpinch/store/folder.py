"""A study's folder: finding, reading and adding parts, and recorded trajectories of single runs.

A part is a Parquet file with one row for each run, which any tool reads. A value of several numbers
has one column for each number, named as in `Ensemble.to_pandas`. NaN, such as the time of an event
that never happened, is null. The metadata of every column has its unit. A trajectory is a Parquet
file with a row for each recorded instant; values that are not arrays, such as the status, are JSON
in its metadata.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..run import Options, Run
from ..run.ledger import LEDGER
from ..scene.fields import headers
from ..study.compute import MOST_BLOCKS
from ..study.rows import Edges, Rows, Spans
from ..study.sources import BLOCK
from ..study.spec import RECORDING, StudySpec
from ..support import StoreError, plain, require
from ..support.files import PARTIAL, flush_folder, visible
from . import files
from .files import ARRAYS, DIGESTS, LOCK, MANIFEST, PARTS, TRAJECTORIES

if TYPE_CHECKING:
    from filelock import BaseFileLock

# Rows are buffered for about this long before they become a part, s; a kill loses the buffer.
GATHER_SECONDS = 5.0
# Buffered rows become a part once they hold this many numbers, 64 MB.
MOST_NUMBERS = 2**23
# Rows that one call of the core returns; a part may exceed MOST_NUMBERS by this many rows.
_AT_ONCE = MOST_BLOCKS * BLOCK
_PART_NAME = re.compile(r"[0-9]{6,18}\.parquet")


class Part(NamedTuple):
    """A file of rows, as found when it was opened."""

    path: Path
    digest: str  # the SHA-256 that was written beside it
    edges: Edges  # (k, 2), first and one past the last run of each interval

    @classmethod
    def open(cls, path: Path, study: str) -> Part:
        """Opens a part of the study with the identity `study`; reads its footer and its digest."""
        digest = files.read_digest(path)
        with files.reading(path):
            footer = files.arrow("pyarrow.parquet").read_metadata(path)
            facts, rows = files.facts_of(footer), footer.num_rows
            if facts["study"] != study:
                raise ValueError(f"it belongs to another study than {MANIFEST} describes")
            edges = np.array(facts["runs"], dtype=np.int64).reshape(-1, 2)
            inner = edges.ravel()
            if (inner < 0).any() or (inner[1:] <= inner[:-1]).any():
                raise ValueError("its intervals of runs do not increase")
            # A stranger's small file may decompress to many gigabytes of equal numbers.
            too_many = (rows - _AT_ONCE) * footer.num_columns > MOST_NUMBERS
            if rows != Spans(edges).count or too_many:
                raise ValueError(f"it has {rows} rows, not those that a study writes")
        return cls(path, digest, edges)


class Folder:
    """A study's folder as it was opened; `identity` is a hash of all that decides its rows."""

    def __init__(self, path: Path, spec: StudySpec, identity: str) -> None:
        # An absolute path stays valid when the process changes its working directory.
        self.path = path.absolute()
        self.spec = spec
        self.identity = identity
        self.parts: list[Part] = []
        self.done = Spans.upto(0)
        folder = self.path / PARTS
        with files.reading(folder):
            found = visible(folder) if folder.exists() else []
        # Numbers from a million on have more than six digits, so lengths are compared first.
        for name in sorted(found, key=lambda name: (len(name), name)):
            if not _PART_NAME.fullmatch(name):
                rule = "is not a part of a study (parts are called 000000.parquet and so on)"
                raise StoreError(f"{folder / name}: {rule}: move it elsewhere")
            part = Part.open(folder / name, identity)
            try:
                self.add(part)
            except ValueError as error:
                advice = "delete it and resume the study, which computes missing runs again"
                raise StoreError(
                    f"{part.path}: has runs that are in other parts too ({error}): {advice}"
                ) from None
        self._last: tuple[Part, Rows] | None = None

    def add(self, part: Part) -> None:
        """Adds a part; a ValueError names a run that it shares with others."""
        self.done = Spans.joined([self.done.edges, part.edges])
        self.parts.append(part)

    def read(self, part: Part, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Reads entries of `Results.to_dict`, each (runs, ...), or single columns of entries."""
        schema = self.spec.schema.entries
        wanted = {name: list(schema[name].columns) if name in schema else [name] for name in names}
        flat = [column for columns in wanted.values() for column in columns]
        found, _ = files.read(part.path, part.digest, flat)
        return {
            name: schema[name].joined([found[column] for column in columns])
            if name in schema
            else found[name]
            for name, columns in wanted.items()
        }

    def rows(self, part: Part) -> Rows:
        """Reads all rows of a part. The last part is kept, because replays ask for it again."""
        if self._last is None or self._last[0] is not part:
            self._last = part, Rows(columns=self.read(part, tuple(self.spec.empty().columns)))
        return self._last[1]


class Trajectories(Mapping[int, Run]):
    """The trajectories in a folder of runs that have a row: number -> `Run`, read on access."""

    def __init__(self, folder: Folder, scene_of: Any) -> None:
        self._folder = folder
        self._scene_of = scene_of

    def __iter__(self) -> Iterator[int]:
        found = _runs((self._folder.path / TRAJECTORIES).glob("*.parquet"))
        return iter([run for run in found if run in self])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, run: object) -> bool:
        if not isinstance(run, int | np.integer):
            return False
        return self._folder.done.has(int(run)) and self._file(int(run)).exists()

    def __getitem__(self, run: int) -> Run:
        if run in self.missing():
            raise KeyError(f"{self._file(run)} is missing; `resume()` computes it again")
        if run not in self:
            raise KeyError(f"the trajectory of run {run} is not kept: pass trajectories=({run},)")
        options, result = self.read(int(run))
        return Run(self._scene_of(run), options, result)

    def missing(self) -> list[int]:
        """The runs whose trajectories were written, and whose files are no longer there."""
        digests = (self._folder.path / DIGESTS).glob(f"{TRAJECTORIES}-*.parquet.sha256")
        written = _runs(Path(file.stem.removeprefix(f"{TRAJECTORIES}-")) for file in digests)
        return [run for run in written if self._folder.done.has(run) and run not in self]

    def read(self, run: int) -> tuple[Options, dict[str, Any]]:
        """Reads a file back into the options and the core's result."""
        file = self._file(run)
        columns, facts = files.read(file, files.read_digest(file))
        with files.reading(file):
            if (facts["study"], facts["run"]) != (self._folder.identity, run):
                raise ValueError("it belongs to another study or another run")
            result: dict[str, Any] = dict(facts["result"])
            numerics = self._folder.spec.options.numerics()
            options = Options.checked(**numerics, **facts["options"])
            for name, own in facts["arrays"].items():
                result[name] = (
                    columns[own]
                    if isinstance(own, str)
                    else np.stack([columns[each] for each in own], axis=1)
                )
            result["final"] = {
                name: np.array(value) if isinstance(value, list) else value
                for name, value in result["final"].items()
            }
            intervals = result["violation_intervals"]
            result["violation_intervals"] = {k: np.array(v) for k, v in intervals.items()}
            if result["begun"] is not None:
                result["begun"] = tuple(result["begun"])
            return options, result

    def _file(self, run: int) -> Path:
        return self._folder.path / TRAJECTORIES / f"{run}.parquet"

    def add(self, run: int, path: Run) -> None:
        """Writes the trajectory `path` of a run."""
        # Without this column, tools that read many files could not tell the runs apart.
        columns: dict[str, NDArray[Any]] = {"run": np.full(len(path), run)}
        names: dict[str, str | list[str]] = {}
        result = {}
        for name, value in path._result.items():
            if not isinstance(value, np.ndarray):
                result[name] = plain(value)
            elif value.ndim == 1:
                columns[name], names[name] = value, name
            else:
                # The names of the columns are those of `Run.save`, without units.
                width = value.shape[1]
                own = headers(name) or [f"{name}.{k}" for k in range(width)]
                if name == "energy":
                    own = [f"energy_{each}" for each in LEDGER[:width]]
                names[name] = [header.partition(" [")[0] for header in own]
                columns.update(zip(names[name], value.T, strict=True))
        facts = {
            "study": self._folder.identity,
            "run": run,
            "options": {name: plain(getattr(path._options, name)) for name in RECORDING},
            "arrays": names,
            "result": result,
        }
        files.write_with_digest(self._file(run), files.encode(columns, facts))


def _runs(files: Iterable[Path]) -> list[int]:
    """The sorted numbers of the runs whose trajectories have these files' names."""
    # Run numbers have at most 19 digits.
    return sorted(int(f.stem) for f in files if f.stem.isdecimal() and len(f.stem) < 20)


class Writer:
    """Adds parts to a study's folder. It buffers rows until they are worth a part."""

    def __init__(self, folder: Folder, lock: BaseFileLock) -> None:
        """Takes a folder that was opened under its lock, which this process holds."""
        self._folder = folder
        self._lock = lock
        self._rows: list[Rows] = []
        self._count = 0
        self._since = time.monotonic()
        # Half-written files are those of a killed writer, because this process holds the lock.
        for name in (".", PARTS, TRAJECTORIES, DIGESTS, ARRAYS):
            for file in (folder.path / name).glob(f".*{PARTIAL}"):
                file.unlink()
        self._next = max((int(part.path.stem) for part in folder.parts), default=-1) + 1

    def add(self, rows: Rows) -> None:
        """Buffers rows, possibly none; writes a part if the buffer is large or old enough."""
        if len(rows):
            self._rows.append(rows)
            # `len(rows)` counts the failure time, a column that is added when a part is encoded.
            self._count += len(rows) + sum(values.size for values in rows.columns.values())
        if self._count >= MOST_NUMBERS or time.monotonic() - self._since >= GATHER_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Writes the buffered rows as one part."""
        self._since = time.monotonic()
        if not self._rows:
            return
        rows = Rows.joined(self._rows).in_order()
        # Clear the buffer even on failure; a retry would fail too.
        self._rows, self._count = [], 0
        folder, entries = self._folder, rows.entries()
        columns, units = {}, {}
        for entry in folder.spec.schema.entries.values():
            for name, (values, unit) in entry.split(entries[entry.name]).items():
                # Some Parquet readers lack unsigned 64-bit integers.
                columns[name] = values.astype(np.int64) if entry.dtype is np.uint64 else values
                units[name] = unit
        facts = {"study": folder.identity, "runs": Spans.of(rows.run).edges.tolist()}
        path = folder.path / PARTS / f"{self._next:06}.parquet"
        try:
            files.write_with_digest(path, files.encode(columns, facts, units))
        except StoreError as error:
            lost = f"the last {len(rows)} runs are lost"
            kept = f"the {folder.done.count} runs before them are stored"
            raise StoreError(f"{error}: {lost}; {kept}, and resume continues there") from None
        self._next += 1
        folder.add(Part.open(path, folder.identity))

    def close(self) -> None:
        """Writes the buffered rows and releases the lock."""
        try:
            self.flush()
        finally:
            self._lock.release()


def locked(path: Path) -> BaseFileLock:
    """Makes a study's folder if it is missing, and takes its lock, which ends with this process."""
    filelock = require("filelock", extra="study", purpose="a study's folder (filelock)")
    try:
        for name in (PARTS, DIGESTS):
            (path / name).mkdir(parents=True, exist_ok=True)
        flush_folder(path)
        lock: BaseFileLock = filelock.FileLock(path / LOCK, timeout=0)
        lock.acquire()
    except filelock.Timeout:
        raise StoreError(f"{path}: is being written by another process or thread") from None
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror}") from None
    return lock


def refuse_other_content(path: Path) -> None:
    """Refuses a folder with more than a study leaves that was killed before its manifest."""
    try:
        for name in visible(path):
            below = path / name
            if name in (PARTS, TRAJECTORIES) and below.is_dir():
                if visible(below):
                    rule = f"belongs to a study whose {MANIFEST} is missing"
                    raise StoreError(f"{below}: {rule}: restore it, or use another folder")
            elif name not in (LOCK, DIGESTS, ARRAYS):
                rule = f"is not empty and not a study: it contains {name}"
                raise StoreError(f"{path}: {rule}; give a new folder or an empty one")
    except FileNotFoundError:
        return
    except NotADirectoryError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror}") from None
