"""A study's folder: the parts in it, and the one process that may add to them."""

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

# Rows gather for so long before they become a part: what a kill costs at most, s.
GATHER_SECONDS = 5.0
_PART_NAME = re.compile(r"[0-9]{6,18}\.parquet")


class Folder:
    """A study's folder, to read: the parts that were there when it was opened.

    Attributes:
        path: Where it is.
        setup: What the runs have in common.
        identity: Of the study; every part has it in its footer.
        parts: In the order of their names, which is the order in which they were written.
        done: The runs that there are.
    """

    def __init__(self, path: Path, setup: Setup, identity: str) -> None:
        """Reads the footers of all parts.

        Raises:
            StoreError: One is damaged, or no part of this study.
        """
        # A study stays where it is when the process changes its directory.
        self.path = path.absolute()
        self.setup = setup
        self.identity = identity
        self.parts: list[Part] = []
        self.refresh()

    def refresh(self) -> None:
        """Looks for parts that another process has added, or someone has deleted.

        Raises:
            StoreError: One is damaged, or no part of this study.
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
        """The names of the parts' files, in the order of their numbers."""
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
                    f"{folder / name}: is no part of a study, which are called 000000.parquet and "
                    "so on: move it elsewhere"
                )
        # Beyond a million parts a number has more digits.
        return sorted(found, key=lambda name: (len(name), name))

    def _overlap(self) -> StoreError:
        """What to say of parts that have runs in common."""
        before = Spans.upto(0)
        for part in self.parts:
            try:
                before = Spans.joined([before.edges, part.edges])
            except ValueError as error:
                return StoreError(
                    f"{part.path}: has runs that are in other parts too ({error}): delete it and "
                    "resume the study, and what it alone held is computed again"
                )
        raise AssertionError("the parts do not overlap")

    def read(self, part: Part, entries: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Some entries of a part, each (runs, ...), compared with their checksums.

        Raises:
            StoreError: The file is gone or damaged.
        """
        return part.read(self.identity, entries, self.setup)

    def rows(self, part: Part) -> Rows:
        """All rows of a part."""
        return Rows(columns=self.read(part, tuple(self.setup.empty().columns)))

    def damaged(self) -> Iterator[str]:
        """What is wrong with parts, one line each."""
        for part in self.parts:
            try:
                self.rows(part)
            except StoreError as error:
                yield str(error)


class Writer:
    """The one that adds parts to a study's folder. Rows gather until they make a part."""

    def __init__(self, folder: Folder, lock: Lock) -> None:
        """Takes a folder whose lock this process holds."""
        self._folder = folder
        self._lock = lock
        self._rows: list[Rows] = []
        self._count = 0
        self._since = time.monotonic()
        clean_up(folder.path)
        folder.refresh()
        self._next = max((int(part.path.stem) for part in folder.parts), default=-1) + 1

    def add(self, rows: Rows) -> None:
        """Takes rows, perhaps none; writes a part where it is time.

        Raises:
            StoreError: It cannot be written.
        """
        if len(rows):
            self._rows.append(rows)
            # A part has a column more, of when a run failed.
            self._count += len(rows) + sum(values.size for values in rows.columns.values())
        if self._count >= MOST_NUMBERS or time.monotonic() - self._since >= GATHER_SECONDS:
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
        # Cleared even if they cannot be written: a second attempt would fail, too.
        self._rows, self._count = [], 0
        folder = self._folder
        path = folder.path / PARTS / f"{self._next:06}.parquet"
        data = parts.encode(rows, folder.setup, folder.identity)
        try:
            write_whole(path, data)
        except OSError as error:
            raise StoreError(
                f"{folder.path}: {reason(error)}: the last {len(rows)} runs cannot be "
                f"written; the {folder.done.count} before them are kept, and resume goes on there"
            ) from None
        self._next += 1
        part = Part.open(path, folder.identity)
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
        StoreError: It cannot be made or written, has links in it, or another process writes it.
    """
    for name in (PARTS, TRAJECTORIES, ARRAYS):
        # A study may come from a stranger, and what is written must stay in its folder.
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
    """Refuses a folder without a manifest in which a study cannot begin.

    What a study leaves that was killed before it had a manifest is no hindrance.

    Raises:
        StoreError: It has files that are not a study's, or rows or paths whose manifest is gone.
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
                    f"{below}: belongs to a study whose {MANIFEST} is gone: put that back, or "
                    "begin in another folder"
                )
        elif name not in (LOCK, ARRAYS):
            raise StoreError(
                f"{path}: is not empty, and holds no study: it has {name}; give a new folder, or "
                "an empty one"
            )
