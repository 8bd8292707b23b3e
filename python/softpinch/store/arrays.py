"""Arrays that were given in `vary`: a NumPy file each, named by the SHA-256 of its numbers."""

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
    """What `Plan.describe` has of `vary`, with a file for each array; and file -> array."""
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
    """Writes the arrays that are not there yet, or that are damaged.

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
    """Refuses an entry of a manifest that describes no array.

    Raises:
        ValueError: Something breaks its rule, or is missing.
        TypeError: Something is of another type.
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
    """What is wrong with the arrays of a folder, one line each; `vary` is of its manifest."""
    for name, entry in vary.items():
        if entry["kind"] == "array":
            file = path / entry["file"]
            wrong = _wrong(file, entry)
            if wrong is not None:
                yield (
                    f"{file}: {wrong}: put it back, or call monte_carlo again with {name} as it "
                    "was, and it is written again"
                )


def _wrong(file: Path, entry: Mapping[str, Any]) -> str | None:
    """What is wrong with the file of an array; None where nothing is."""
    try:
        array = load(file, entry["sha256"])
    except ValueError as error:
        return str(error)
    if list(array.shape) != entry["shape"]:
        return f"has been altered: it has another shape than {MANIFEST} says"
    return None
