"""The names of a study's files, and functions that write and clean up.

manifest.toml            the study's settings and the software that computed it, with a checksum
parts/000000.parquet     results, one row for each run
trajectories/17.parquet  the recorded trajectory of run 17
arrays/8f43ab.npy        an array given in `vary`, named by its SHA-256
lock                     the process that writes
"""

from __future__ import annotations

from pathlib import Path

from ..support.disk import PARTIAL, reason, remove_partial, write_whole
from ..support.errors import StoreError

MANIFEST, PARTS, TRAJECTORIES, ARRAYS, LOCK = (
    "manifest.toml",
    "parts",
    "trajectories",
    "arrays",
    "lock",
)


def write(path: Path, data: memoryview | bytes) -> None:
    """Writes a file as a whole, and makes its folder if that is missing.

    Raises:
        StoreError: The file cannot be written; its earlier content is unchanged.
    """
    try:
        path.parent.mkdir(exist_ok=True)
        write_whole(path, data)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {reason(error)}") from None


def clean_up(path: Path) -> None:
    """Removes half-written files of a killed writer. The caller must hold the lock.

    Raises:
        StoreError: A half-written file cannot be removed.
    """
    for folder in (path, path / PARTS, path / TRAJECTORIES, path / ARRAYS):
        for file in folder.glob(f".*{PARTIAL}"):
            try:
                remove_partial(file)
            except OSError as error:
                raise StoreError(f"{folder}: cannot be written: {reason(error)}") from None
