"""The names of a study's files, and how one is written so that it is whole at any time.

    manifest.toml            what is computed, and with what; a study file with a checksum
    parts/000000.parquet     one row a run
    trajectories/17.parquet  the path of run 17
    arrays/8f43ab.npy        an array that was given in `vary`, named by its SHA-256
    lock                     who writes

A file is written under a hidden name beside its place, flushed to the disk, renamed, and then its
folder is flushed. Whatever ends the writer, the file is there and whole, or it is not there.
"""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

from ..support.errors import StoreError
from ..support.interrupt import ignoring_system, of_system

if sys.platform == "darwin":
    import fcntl

MANIFEST, PARTS, TRAJECTORIES, ARRAYS, LOCK = (
    "manifest.toml",
    "parts",
    "trajectories",
    "arrays",
    "lock",
)
_PARTIAL = ".partial"


def write_whole(path: Path, data: memoryview | bytes) -> None:
    """Writes a file, or leaves what was there before.

    Raises:
        OSError: It cannot be written.
    """
    partial = path.with_name(f".{path.name}{_PARTIAL}")
    try:
        # A link in its place would lead what is written elsewhere.
        _remove(partial)
        with partial.open("xb") as file:
            file.write(data)
            file.flush()
            _flush(file.fileno())
        os.replace(partial, path)
        flush_folder(path.parent)
    except OSError:
        with ignoring_system():
            partial.unlink(missing_ok=True)
        raise


def write(path: Path, data: memoryview | bytes) -> None:
    """Writes a file, and makes its folder where there is none.

    Raises:
        StoreError: It cannot be written; what was there before is still there.
    """
    try:
        path.parent.mkdir(exist_ok=True)
        write_whole(path, data)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {reason(error)}") from None


def remove_partial(path: Path) -> None:
    """Removes what a killed writer has left in a study's folder. Only the lock's owner may.

    Raises:
        StoreError: Something of such a name cannot be removed.
    """
    for folder in (path, path / PARTS, path / TRAJECTORIES, path / ARRAYS):
        for file in folder.glob(f".*{_PARTIAL}"):
            try:
                _remove(file)
            except OSError as error:
                raise StoreError(f"{folder}: cannot be written: {reason(error)}") from None


def _remove(partial: Path) -> None:
    """Removes a half-written file, if there is one; a folder of its name is no writer's."""
    if partial.is_dir() and not partial.is_symlink():
        raise OSError(errno.EISDIR, f"{partial.name} is a folder: move it elsewhere")
    partial.unlink(missing_ok=True)


def visible(folder: Path) -> list[str]:
    """The names in a folder, in order, without hidden ones, which desktops leave everywhere."""
    return sorted(name for name in os.listdir(folder) if not name.startswith("."))


def one_line(error: Exception) -> str:
    """An error's text without line breaks."""
    return " ".join(str(error).split()) or type(error).__name__


def reason(error: OSError) -> str:
    """What the operating system says is wrong.

    Raises:
        OSError: `error` is not the system's: a deadline's `TimeoutError` is no fault of a file.
    """
    if not of_system(error):
        raise error
    return error.strerror or str(error)


def flush_folder(folder: Path) -> None:
    """Brings the names in a folder to the disk."""
    if os.name == "nt":  # Windows cannot flush a folder
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        _flush(descriptor)
    finally:
        os.close(descriptor)


def _flush(descriptor: int) -> None:
    """Brings what has been written to the disk, and on macOS out of the disk's own cache."""
    if sys.platform == "darwin":
        with ignoring_system():  # not every file system supports it
            fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
            return
    os.fsync(descriptor)
