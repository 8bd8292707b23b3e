"""NumPy files with the arrays of a study file or manifest, which has their names and checksums."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np

from ..support.arrays import Floats
from ..support.disk import one_line
from ..support.interrupt import by_handler

_MAGIC = b"\x93NUMPY"


def checksum(array: Floats) -> str:
    """SHA-256 of an array's numbers."""
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


def load(file: Path, sha256: str) -> Floats:
    """Opens the array in a file as a memory map, and verifies its checksum.

    Raises:
        ValueError: The file is missing, is not an array of floats, or has another checksum. The
            message continues a sentence that begins with the file's name.
    """
    try:
        if not file.is_file():
            raise ValueError("is not a file" if os.path.lexists(file) else "is missing")
        with file.open("rb") as stream:
            # NumPy would try to load other files as archives or pickles.
            if stream.read(len(_MAGIC)) != _MAGIC:
                raise ValueError("is damaged: it is not a NumPy file")
        # Ignore warnings: the size of a damaged shape may overflow 64 bits.
        with np.errstate(all="ignore"):
            array: Floats = np.load(file, mmap_mode="r", allow_pickle=False)
    except ValueError as error:
        text = one_line(error)
        raise ValueError(text if text.startswith("is ") else f"is damaged: {text}") from None
    # For damaged bytes NumPy raises errors of many types, OSError among them.
    except Exception as error:
        if by_handler(error):
            raise
        raise ValueError(f"is damaged: {one_line(error)}") from None
    if array.dtype != np.float64 or not array.ndim:
        raise ValueError("has been altered: its shape or type is not one that a study writes")
    if checksum(array) != sha256:
        raise ValueError("has been altered: its checksum differs")
    return array
