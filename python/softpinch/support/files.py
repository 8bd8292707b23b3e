"""Helpers for file access: non-blocking opening, and write errors that name the file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Adds the file's name to system errors that lack it, such as a full disk during `write`.

    Raises:
        OSError: The error raised inside the block, with the file's name.
    """
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def without_waiting(path: str, flags: int) -> int:
    """An `opener` for `open` which does not block on a named pipe without a writer."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
