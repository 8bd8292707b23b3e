"""A study's folder: parts that appear whole or not at all, and the list of them.

    manifest.toml        what is computed, and with what (`_manifest`); a study file
    parts.jsonl          one line a part: its runs, size and SHA-256; it belongs to the manifest
    parts/000000.parquet one row a run
    trajectories/17.arrow  the paths of runs that are kept
    arrays/8f43ab.npy    what arrays in `vary` hold, by its SHA-256
    lock                 whoever writes

A part is written beside, brought to the disk, renamed, and only then listed. So whatever ends a
writer, a part is there and whole, or not there; one that is not yet listed is by the next writer.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _parts
from ._lock import Lock, LockedError
from ._rows import Rows
from ._setup import Setup
from ._spans import Edges, Spans
from .results import StoreError

if sys.platform == "darwin":
    import fcntl

MANIFEST, PARTS, LIST, TRAJECTORIES, ARRAYS = (
    "manifest.toml",
    "parts",
    "parts.jsonl",
    "trajectories",
    "arrays",
)
_NAME = re.compile(r"\d{6,}\.parquet")
_LOCK, _BEGUN = "lock", ".begun"
# Rows gather for so long before they become a part: what a kill costs at most, s.
_SECONDS = 5.0
# Numbers that a part holds at most: 64 MB.
_MOST = 2**23


class Part(NamedTuple):
    """A line of the list.

    Attributes:
        name: Of its file.
        size: Of it, bytes.
        sha256: Of its bytes, in hexadecimal.
        edges: (k, 2), first and one past the last run of each interval.
    """

    name: str
    size: int
    sha256: str
    edges: Edges

    @classmethod
    def of(cls, name: str, data: memoryview | bytes, spans: Spans) -> Part:
        """Of a file's bytes."""
        return cls(name, len(data), hashlib.sha256(data).hexdigest(), spans.edges)

    def line(self) -> str:
        """As JSON, with the line's end."""
        runs = self.edges.tolist()
        return json.dumps({**self._asdict(), "edges": runs}, separators=(",", ":")) + "\n"

    @classmethod
    def parse(cls, line: str) -> Part:
        """From JSON; an error of any kind where it is none."""
        data = json.loads(line)
        edges = np.array(data.pop("edges"), np.int64).reshape(-1, 2)
        if not _NAME.fullmatch(data["name"]) or (np.diff(edges.ravel(), prepend=-1) <= 0).any():
            raise ValueError("it names no part, or no runs")
        return cls(**data, edges=edges)


class Folder:
    """A study's folder, to read: its parts as they are listed when it is opened.

    Attributes:
        path: Where it is.
        setup: What the runs have in common.
        identity: Of the study, which its parts have, too.
        parts: In the order in which they were written.
        done: The runs that there are.
    """

    def __init__(self, path: Path, setup: Setup, identity: str) -> None:
        """Reads the list.

        Raises:
            StoreError: It is damaged.
        """
        # A study stays where it is when the process goes elsewhere.
        self.path = path.absolute()
        self.setup = setup
        self.identity = identity
        self.refresh()
        # Files that were seen to have their checksum: how they were then.
        self._verified: dict[str, tuple[int, int, int]] = {}

    def refresh(self) -> None:
        """Reads the list again: another process may have added to it.

        Raises:
            StoreError: It is damaged.
        """
        self.parts = list(self._listed())
        try:
            self.done = Spans.joined([part.edges for part in self.parts])
        except ValueError as error:
            raise StoreError(f"{self.path / LIST}: {error}") from None

    def _listed(self) -> Iterator[Part]:
        path = self.path / LIST
        try:
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        except FileNotFoundError:
            return
        except UnicodeDecodeError as error:
            raise StoreError(f"{path}: is damaged: {error}; {_REMAKE}") from None
        except OSError as error:
            raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from None
        for k, line in enumerate(lines):
            # The end of the last line comes with its part: without, a writer is, or was, at it.
            if not line.endswith("\n") and k == len(lines) - 1:
                return
            try:
                yield Part.parse(line)
            except (AttributeError, KeyError, TypeError, ValueError):
                raise StoreError(
                    f"{path}: line {k + 1} is damaged: {line[:80]!r}; {_REMAKE}"
                ) from None

    def read(self, part: Part, entries: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Some entries of a part, each (runs, ...); its checksum is looked at first.

        Raises:
            StoreError: The file is gone, cut short or altered, or of another study.
        """
        path = self.path / PARTS / part.name
        try:
            found = path.stat()
            now = (found.st_size, found.st_mtime_ns, found.st_ino)
            if self._verified.get(part.name) == now:
                return _parts.decode(path, entries, self.setup)
            data = path.read_bytes()
        except FileNotFoundError:
            raise StoreError(f"{path}: is gone: put it back, or {_AGAIN}") from None
        except OSError as error:
            raise StoreError(f"{path}: cannot be read: {error.strerror or error}{_MEND}") from None
        if len(data) != part.size:
            raise StoreError(
                f"{path}: has been cut or altered: it has {len(data)} bytes, and the list of parts "
                f"says {part.size}{_MEND}"
            )
        if hashlib.sha256(data).hexdigest() != part.sha256:
            raise StoreError(
                f"{path}: has been altered: its SHA-256 is not that of the list of parts{_MEND}"
            )
        source = _parts.arrow().BufferReader(data)
        if _parts.identity_of(source) != self.identity:
            raise StoreError(
                f"{path}: its rows are of another study than {MANIFEST} says: put that back as it "
                "was when they were written"
            )
        self._verified[part.name] = now
        return _parts.decode(source, entries, self.setup)

    def rows(self, part: Part) -> Rows:
        """All of a part."""
        return Rows(columns=self.read(part, tuple(self.setup.empty().columns)))

    def damaged(self) -> list[str]:
        """What is wrong with parts, one line each."""
        found = []
        for part in self.parts:
            self._verified.pop(part.name, None)
            try:
                runs = self.read(part, ("run",))["run"]
                if not np.array_equal(Spans.of(runs).edges, part.edges):
                    found.append(f"{self.path / LIST}: has other runs than {part.name}; {_REMAKE}")
            except StoreError as error:
                found.append(str(error))
        return found


_REMAKE = "delete the file and resume the study, and it is made again from the parts"
_AGAIN = "resume the study, and its runs are computed again"
_MEND = f"; delete it and {_AGAIN}"


class Writer:
    """The one that writes a study's folder. Rows gather until they make a part."""

    def __init__(self, folder: Folder, lock: Lock) -> None:
        """Brings the list in order: parts that are gone leave it, and those that it lacks come."""
        self._folder = folder
        self._lock = lock
        self._rows: list[Rows] = []
        self._count = 0
        self._since = time.monotonic()
        self._mend()
        numbers = [int(part.name.split(".")[0]) for part in folder.parts]
        self._next = max(numbers, default=-1) + 1

    def _mend(self) -> None:
        folder = self._folder
        (folder.path / _BEGUN).unlink(missing_ok=True)
        # Desktops and network file systems leave hidden files.
        there = {
            entry.name: entry
            for entry in os.scandir(folder.path / PARTS)
            if not entry.name.startswith(".")
        }
        listed = {part.name for part in folder.parts}
        kept = [part for part in folder.parts if part.name in there]
        for part in kept:
            size = there[part.name].stat().st_size
            if size != part.size:
                raise StoreError(
                    f"{folder.path / PARTS / part.name}: has been cut or altered: it has {size} "
                    f"bytes, and the list of parts says {part.size}{_MEND}"
                )
        done = Spans.joined(part.edges for part in kept)
        for name in sorted(there.keys() - listed):
            kept.append(self._adopted(Path(there[name].path), done))
            done = Spans.joined([done.edges, kept[-1].edges])
        text = "".join(part.line() for part in kept)
        path = folder.path / LIST
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            replace(path, text.encode())
        folder.refresh()

    def _adopted(self, path: Path, done: Spans) -> Part:
        """A part that its writer was killed before listing: renamed, so it is whole."""
        setup = self._folder.setup
        try:
            if not _NAME.fullmatch(path.name):
                raise ValueError("it is not called as one")
            data = path.read_bytes()
            source = _parts.arrow().BufferReader(data)
            if _parts.identity_of(source) != self._folder.identity:
                raise ValueError("it is of another one")
            rows = _parts.decode(source, tuple(setup.empty().columns), setup)
            part = Part.of(path.name, data, Spans.of(rows["run"]))
            Spans.joined([done.edges, part.edges])  # refuses what stands twice
            return part
        except Exception as error:
            raise StoreError(
                f"{path}: is no part of this study: {error}; move it elsewhere, and resume"
            ) from None

    def add(self, rows: Rows) -> None:
        """Takes rows, perhaps none; writes a part where it is time.

        Raises:
            StoreError: It cannot be written.
        """
        if len(rows):
            self._rows.append(rows)
            self._count += sum(values.size for values in rows.columns.values())
        if self._count >= _MOST or time.monotonic() - self._since >= _SECONDS:
            self.flush()

    def flush(self) -> None:
        """Writes what has gathered.

        Raises:
            StoreError: It cannot be written; what was before is kept.
        """
        self._since = time.monotonic()
        if not self._rows:
            return
        rows = Rows.joined(self._rows).in_order()
        # Whether or not it can be written: it would not be another time.
        self._rows, self._count = [], 0
        folder = self._folder
        data = _parts.encode(rows, folder.setup, folder.identity)
        part = Part.of(f"{self._next:06}.parquet", data, Spans.of(rows.run))
        try:
            _write(folder.path / _BEGUN, data)
            os.replace(folder.path / _BEGUN, folder.path / PARTS / part.name)
            _sync(folder.path / PARTS)
            with (folder.path / LIST).open("ab") as file:
                file.write(part.line().encode())
                file.flush()
                _flush(file.fileno())
        except OSError as error:
            with suppress(OSError):
                (folder.path / _BEGUN).unlink(missing_ok=True)
            raise StoreError(
                f"{folder.path}: {error.strerror or error}: the last {len(rows)} runs cannot be "
                f"written; the {folder.done.count} before them are kept, and resume goes on there"
            ) from None
        self._next += 1
        folder.parts.append(part)
        folder.done = Spans.joined([folder.done.edges, part.edges])

    def close(self) -> None:
        """Writes what has gathered, and lets others write."""
        try:
            self.flush()
        finally:
            self._lock.release()


def locked(path: Path) -> Lock:
    """Makes a study's folder where it is not there, and takes its lock.

    Raises:
        StoreError: It cannot be made or written, or another process writes it.
    """
    try:
        (path / PARTS).mkdir(parents=True, exist_ok=True)
        return Lock(path / _LOCK)
    except LockedError as error:
        raise StoreError(f"{path}: is being written by {error}") from None
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from None


def refuse_foreign(path: Path) -> None:
    """Refuses a folder that has files and is no study, before anything is written into it.

    Raises:
        StoreError: It is such a folder.
    """
    if (path / MANIFEST).exists() or not path.is_dir():
        return
    # A study that was killed as it began leaves these, and desktops leave hidden files. The study
    # file that is being run may lie in its own folder, with the scene that it names.
    ours = {PARTS, LIST, TRAJECTORIES, ARRAYS, _LOCK}
    try:
        others = sorted(
            name
            for name in os.listdir(path)
            if name not in ours and not name.startswith(".") and not name.endswith(".toml")
        )
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from None
    if others:
        raise StoreError(
            f"{path}: holds no study, but other files, such as {others[0]!r}: must be a study, "
            "empty or not there yet"
        )


def refuse_remains(path: Path) -> None:
    """Refuses a folder with what belongs to a manifest that is not there.

    Raises:
        StoreError: Rows or paths of another study would pass for those of the one that begins.
    """
    for name in (PARTS, LIST, TRAJECTORIES):
        found = path / name
        if found.is_dir() and not any(found.iterdir()):
            continue
        if found.exists():
            raise StoreError(
                f"{found}: belongs to a study whose {MANIFEST} is gone: put that back, or begin "
                "in another folder"
            )


def replace(path: Path, data: memoryview | bytes) -> None:
    """Writes a file that is whole at any time."""
    beside = path.with_name(f".{path.name}")
    try:
        _write(beside, data)
        os.replace(beside, path)
        _sync(path.parent)
    except OSError as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from None


def _write(path: Path, data: memoryview | bytes) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        _flush(file.fileno())


def _sync(folder: Path) -> None:
    """Brings the names in a folder to the disk."""
    if os.name == "nt":  # which has no such thing
        return
    fd = os.open(folder, os.O_RDONLY)
    try:
        _flush(fd)
    finally:
        os.close(fd)


def _flush(fd: int) -> None:
    """Brings what has been written to the disk, and on macOS out of the disk's own memory."""
    if sys.platform == "darwin":
        with suppress(OSError):  # not every file system can
            fcntl.fcntl(fd, fcntl.F_FULLFSYNC)
            return
    os.fsync(fd)
