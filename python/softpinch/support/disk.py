"""Atomic, durable file writes, and the text of operating-system errors.

A file is written under a hidden temporary name in the same folder, flushed to the disk, renamed,
and then the folder is flushed. A crash at any moment leaves either the complete file or none.
"""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

from .interrupt import ignoring_system, of_system

if sys.platform == "darwin":
    import fcntl

# The suffix of a file that is still being written.
PARTIAL = ".partial"


def write_whole(path: Path, data: memoryview | bytes) -> None:
    """Writes a file atomically: after a failure, the previous content is still there.

    Raises:
        OSError: The file cannot be written.
    """
    partial = path.with_name(f".{path.name}{PARTIAL}")
    try:
        # A symbolic link under this name would redirect the data to another file.
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
    """Removes a half-written file if it exists.

    Raises:
        OSError: A folder has this name (softpinch never creates one), or removal fails.
    """
    if partial.is_dir() and not partial.is_symlink():
        raise OSError(errno.EISDIR, f"{partial.name} is a folder: move it elsewhere")
    partial.unlink(missing_ok=True)


def visible(folder: Path) -> list[str]:
    """Returns the sorted names in a folder without hidden files, which desktops leave behind."""
    return sorted(name for name in os.listdir(folder) if not name.startswith("."))


def one_line(error: Exception) -> str:
    """Returns an error's text without line breaks, or the error's type if it has no text."""
    return " ".join(str(error).split()) or type(error).__name__


def reason(error: OSError) -> str:
    """Returns the operating system's description of an error.

    Raises:
        OSError: `error` itself, if the operating system did not raise it. For example, the
            `TimeoutError` of a user's deadline must reach the caller.
    """
    if not of_system(error):
        raise error
    return error.strerror or str(error)


def flush_folder(folder: Path) -> None:
    """Flushes a folder's entries to the disk, so that a rename survives a power failure."""
    if os.name == "nt":  # Windows cannot flush a folder
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        _flush(descriptor)
    finally:
        os.close(descriptor)


def _flush(descriptor: int) -> None:
    """Flushes written data to the disk, and on macOS also the disk's own cache."""
    if sys.platform == "darwin":
        with ignoring_system():  # not every file system supports it
            fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
            return
    os.fsync(descriptor)
