"""The names of a study's files, and errors of writing them.

manifest.toml            what is computed, and with what; a study file with a checksum
parts/000000.parquet     one row a run
trajectories/17.parquet  the path of run 17
arrays/8f43ab.npy        an array that was given in `vary`, named by its SHA-256
lock                     who writes
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
    """Writes a file, and makes its folder where there is none.

    Raises:
        StoreError: It cannot be written; what was there before is still there.
    """
    try:
        path.parent.mkdir(exist_ok=True)
        write_whole(path, data)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {reason(error)}") from None


def clean_up(path: Path) -> None:
    """Removes what a killed writer has left in a study's folder. Only the lock's owner may.

    Raises:
        StoreError: Something of such a name cannot be removed.
    """
    for folder in (path, path / PARTS, path / TRAJECTORIES, path / ARRAYS):
        for file in folder.glob(f".*{PARTIAL}"):
            try:
                remove_partial(file)
            except OSError as error:
                raise StoreError(f"{folder}: cannot be written: {reason(error)}") from None
