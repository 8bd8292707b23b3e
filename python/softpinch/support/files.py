"""Writing files atomically, names in a folder, and the formats of figures."""

import os
from contextlib import suppress
from pathlib import Path

FORMATS = ("png", "pdf", "svg")
# The suffix of a file that is still being written.
PARTIAL = ".partial"


def write_whole(path: Path, data: memoryview | bytes) -> None:
    """Writes a file so that a crash at any moment leaves either its old or its new content."""
    partial = path.with_name(f".{path.name}{PARTIAL}")
    try:
        partial.unlink(missing_ok=True)
        with partial.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
        flush_folder(path.parent)
    except OSError:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise


def flush_folder(folder: Path) -> None:
    """Flushes a folder's entries to the disk, so that a rename survives a power failure."""
    if os.name == "nt":  # Windows cannot flush a folder
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def visible(folder: Path) -> list[str]:
    """Returns the sorted names in a folder without hidden files, which desktops leave behind."""
    return sorted(name for name in os.listdir(folder) if not name.startswith("."))


def one_line(error: Exception) -> str:
    """Returns an error's text without line breaks, or the error's type if it has no text."""
    return " ".join(str(error).split()) or type(error).__name__
