"""Files that are whole at any time, and what the operating system says where one is not.

A file is written under a hidden name beside its place, flushed to the disk, renamed, and then its
folder is flushed. Whatever ends the writer, the file is there and whole, or it is not there.
"""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

from .interrupt import ignoring_system, of_system

if sys.platform == "darwin":
    import fcntl

# How the name of a file ends that is not whole yet.
PARTIAL = ".partial"


def write_whole(path: Path, data: memoryview | bytes) -> None:
    """Writes a file, or leaves what was there before.

    Raises:
        OSError: It cannot be written.
    """
    partial = path.with_name(f".{path.name}{PARTIAL}")
    try:
        # A link in its place would lead what is written elsewhere.
        remove_partial(partial)
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


def remove_partial(partial: Path) -> None:
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
