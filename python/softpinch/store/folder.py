"""A study's folder: finding and reading its parts, and adding parts under the folder's lock."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..study.rows import Rows
from ..study.setup import Setup
from ..study.spans import Spans
from ..support.disk import reason, visible, write_whole
from ..support.errors import StoreError
from . import part as parts
from .files import ARRAYS, LOCK, MANIFEST, PARTS, TRAJECTORIES, clean_up
from .lock import Lock, LockedError
from .part import MOST_NUMBERS, Part

# Rows are buffered for about this long before they become a part, s; a kill loses the buffer.
GATHER_SECONDS = 5.0
_PART_NAME = re.compile(r"[0-9]{6,18}\.parquet")


class Folder:
    """A study's folder for reading, with the parts found at the last `refresh`.

    Attributes:
        path: The folder, absolute.
        setup: Scene, options and summaries that all runs share.
        identity: Hash of everything on which the rows depend; each part's footer repeats it.
        parts: The parts in the order of their names, which is the order of writing.
        done: The runs whose rows are in the parts.
    """

    def __init__(self, path: Path, setup: Setup, identity: str) -> None:
        """Reads the footers of all parts.

        Raises:
            StoreError: A part is damaged or belongs to another study.
        """
        # An absolute path stays valid when the process changes its working directory.
        self.path = path.absolute()
        self.setup = setup
        self.identity = identity
        self.parts: list[Part] = []
        self.refresh()

    def refresh(self) -> None:
        """Looks for parts that have been added or deleted since.

        Raises:
            StoreError: A part is damaged or belongs to another study, or two parts share runs.
        """
        known = {part.path.name: part for part in self.parts}
        folder = self.path / PARTS
        self.parts = [
            known.get(name) or Part.open(folder / name, self.identity)
            for name in self._part_names()
        ]
        try:
            self.done = Spans.joined([part.edges for part in self.parts])
        except ValueError:
            raise self._overlap() from None

    def _part_names(self) -> list[str]:
        """File names of the parts, in the order of their numbers."""
        folder = self.path / PARTS
        try:
            found = visible(folder)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise StoreError(f"{folder}: cannot be read: {reason(error)}") from None
        for name in found:
            if not _PART_NAME.fullmatch(name):
                raise StoreError(
                    f"{folder / name}: is not a part of a study (parts are called 000000.parquet "
                    "and so on): move it elsewhere"
                )
        # Numbers from a million on have more than six digits, so lengths are compared first.
        return sorted(found, key=lambda name: (len(name), name))

    def _overlap(self) -> StoreError:
        """The error for the first part that shares runs with the parts before it."""
        before = Spans.upto(0)
        for part in self.parts:
            try:
                before = Spans.joined([before.edges, part.edges])
            except ValueError as error:
                return StoreError(
                    f"{part.path}: has runs that are in other parts too ({error}): delete it and "
                    "resume the study, which computes missing runs again"
                )
        raise AssertionError("the parts do not overlap")

    def read(self, part: Part, entries: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Reads entries of a part, each (runs, ...), and verifies their checksums.

        Raises:
            StoreError: The file is missing or damaged.
        """
        return part.read(self.identity, entries, self.setup)

    def rows(self, part: Part) -> Rows:
        """Reads all rows of a part."""
        return Rows(columns=self.read(part, tuple(self.setup.empty().columns)))

    def damaged(self) -> Iterator[str]:
        """Reads every part, and yields one line for each damaged part."""
        for part in self.parts:
            try:
                self.rows(part)
            except StoreError as error:
                yield str(error)


class Writer:
    """Adds parts to a study's folder. It buffers rows until they are worth a part."""

    def __init__(self, folder: Folder, lock: Lock) -> None:
        """Takes a folder and its lock, which this process must hold."""
        self._folder = folder
        self._lock = lock
        self._rows: list[Rows] = []
        self._count = 0
        self._since = time.monotonic()
        clean_up(folder.path)
        folder.refresh()
        self._next = max((int(part.path.stem) for part in folder.parts), default=-1) + 1

    def add(self, rows: Rows) -> None:
        """Buffers rows, possibly none; writes a part if the buffer is large or old enough.

        Raises:
            StoreError: The part cannot be written.
        """
        if len(rows):
            self._rows.append(rows)
            # `len(rows)` counts the failure time, a column that is added when a part is encoded.
            self._count += len(rows) + sum(values.size for values in rows.columns.values())
        if self._count >= MOST_NUMBERS or time.monotonic() - self._since >= GATHER_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Writes the buffered rows as one part.

        Raises:
            StoreError: The part cannot be written; earlier parts are unchanged.
        """
        self._since = time.monotonic()
        if not self._rows:
            return
        rows = Rows.joined(self._rows).in_order()
        # Clear the buffer even on failure; a retry would fail too.
        self._rows, self._count = [], 0
        folder = self._folder
        path = folder.path / PARTS / f"{self._next:06}.parquet"
        data = parts.encode(rows, folder.setup, folder.identity)
        try:
            write_whole(path, data)
        except OSError as error:
            raise StoreError(
                f"{folder.path}: {reason(error)}: the last {len(rows)} runs cannot be written; "
                f"the {folder.done.count} runs before them are stored, and resume continues there"
            ) from None
        self._next += 1
        part = Part.open(path, folder.identity)
        folder.parts.append(part)
        folder.done = Spans.joined([folder.done.edges, part.edges])

    def close(self) -> None:
        """Writes the buffered rows and releases the lock."""
        try:
            self.flush()
        finally:
            self._lock.release()


def locked(path: Path) -> Lock:
    """Makes a study's folder if it is missing, and takes its lock.

    Raises:
        StoreError: The folder cannot be made or written, a subfolder is a symbolic link, or another
            process holds the lock.
    """
    for name in (PARTS, TRAJECTORIES, ARRAYS):
        # A folder from a stranger must not redirect our files to another place.
        if (path / name).is_symlink():
            raise StoreError(f"{path / name}: cannot be written: it is a symbolic link")
    try:
        (path / PARTS).mkdir(parents=True, exist_ok=True)
        return Lock(path / LOCK)
    except LockedError as error:
        raise StoreError(f"{path}: is being written by {error}") from None
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {reason(error)}") from None


def refuse_other_content(path: Path) -> None:
    """Refuses to begin a study in a folder that has no manifest but other content.

    A lock and arrays are accepted: a study killed before it wrote its manifest leaves them.

    Raises:
        StoreError: The folder has foreign files, or parts or trajectories without a manifest.
    """
    try:
        found = visible(path)
    except FileNotFoundError:
        return
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {reason(error)}") from None
    for name in found:
        below = path / name
        if name in (PARTS, TRAJECTORIES) and below.is_dir():
            if visible(below):
                raise StoreError(
                    f"{below}: belongs to a study whose {MANIFEST} is missing: restore it, or "
                    "use another folder"
                )
        elif name not in (LOCK, ARRAYS):
            raise StoreError(
                f"{path}: is not empty and not a study: it contains {name}; give a new folder or "
                "an empty one"
            )
