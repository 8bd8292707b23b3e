"""Files: opened without waiting, and errors of writing that name the file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Names the file in errors of the system that do not: a full disk is met by a `write`.

    Raises:
        OSError: As inside, with the file's name.
    """
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def without_waiting(path: str, flags: int) -> int:
    """An `opener` for `open`: a named pipe is opened at once, though no other process writes."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
