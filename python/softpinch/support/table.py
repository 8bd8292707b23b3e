"""Tables as CSV files and arrays as NPZ files: what every `save` writes."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import checks
from .files import writing


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table.

    Attributes:
        columns: Header of each column, with its unit.
        rows: Numbers and text, as many as there are columns; numbers unrounded.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def save(self, path: Path) -> Path:
        """Writes the CSV file, numbers exact."""
        return save_csv(path, self.columns, self.rows)


def save_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Writes rows under a header, numbers exact."""
    with writing(path), path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)
    return path


def save_npz(path: Path, arrays: Mapping[str, NDArray[Any]], provenance: Mapping[str, Any]) -> Path:
    """Writes arrays, and as text their provenance in JSON."""
    named: dict[str, Any] = {"provenance": np.array(json.dumps(provenance)), **arrays}
    with writing(path), path.open("wb") as file:
        np.savez(file, **named)
    return path


def save_by_suffix(path: object, writers: Mapping[str, Callable[[Path], object]]) -> Path:
    """Writes a file with the writer of its suffix.

    Raises:
        ValueError: There is none for it.
        TypeError: It is no path.
        OSError: The file cannot be written.
    """
    path = checks.path("path", path)
    if path.suffix.lower() not in writers:
        raise ValueError(f"path = {str(path)!r}: must end in {' or '.join(writers)}")
    writers[path.suffix.lower()](path)
    return path
