"""Arrays given in `vary`: each is a NumPy file, named by the SHA-256 of its numbers."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..study.array_files import checksum, load
from ..support import checks
from ..support.arrays import Floats
from . import files
from .files import ARRAYS, MANIFEST

_FILE = re.compile(rf"{ARRAYS}/[0-9a-f]{{16}}\.npy")
_SHA256 = re.compile("[0-9a-f]{64}")


def described(
    vary: Mapping[Any, Any], plan: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Floats]]:
    """Adds a file name and a checksum to the description of each array in `vary`.

    Args:
        vary: The argument of `monte_carlo`.
        plan: The table `vary` of `Plan.describe`.

    Returns:
        The completed table, and a dictionary from file name to array.
    """
    result, found = dict(plan), {}
    for key, value in vary.items():
        name = key if isinstance(key, str) else ", ".join(key)
        if plan[name]["kind"] == "array":
            array = np.ascontiguousarray(value, dtype=np.float64)
            total = checksum(array)
            file = f"{ARRAYS}/{total[:16]}.npy"
            found[file] = array
            result[name] = {**plan[name], "file": file, "sha256": total}
    return result, found


def write(path: Path, given: Mapping[str, Floats]) -> None:
    """Writes the arrays whose files are missing or damaged.

    Args:
        path: The study's folder.
        given: File name, relative to the folder -> array.

    Raises:
        StoreError: A file cannot be written.
    """
    for file, array in given.items():
        entry = {"shape": list(array.shape), "sha256": checksum(array)}
        if (path / file).exists() and _wrong(path / file, entry) is None:
            continue
        buffer = io.BytesIO()
        np.save(buffer, array)
        files.write(path / file, buffer.getbuffer())


def check_entry(name: str, entry: Mapping[str, Any]) -> None:
    """Refuses a manifest entry that does not describe an array.

    Raises:
        ValueError: A field breaks its rule or is missing.
        TypeError: A field has the wrong type.
    """
    checks.refuse_unknown(name, entry, ("kind", "shape", "file", "sha256"), "")
    for field, rule in (("file", _FILE), ("sha256", _SHA256)):
        value = entry.get(field)
        if not isinstance(value, str) or not rule.fullmatch(value):
            raise ValueError(f"{name}.{field} = {value!r}: must match {rule.pattern}")
    checks.instance(f"{name}.shape", entry.get("shape"), list)
    for length in entry["shape"]:
        checks.integer(f"{name}.shape", length, 0, 2**62)


def damaged(path: Path, vary: Mapping[str, Any]) -> Iterator[str]:
    """Yields one line for each missing or damaged array; `vary` is the manifest's table."""
    for name, entry in vary.items():
        if entry["kind"] == "array":
            file = path / entry["file"]
            wrong = _wrong(file, entry)
            if wrong is not None:
                yield (
                    f"{file}: {wrong}: restore it, or call monte_carlo again with the original "
                    f"{name}, which writes it again"
                )


def _wrong(file: Path, entry: Mapping[str, Any]) -> str | None:
    """The fault of an array's file in words; None if the file is sound."""
    try:
        array = load(file, entry["sha256"])
    except ValueError as error:
        return str(error)
    if list(array.shape) != entry["shape"]:
        return f"has been altered: it has another shape than {MANIFEST} says"
    return None
