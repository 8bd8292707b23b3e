"""Writers of CSV tables and NPZ arrays, which every `save` method uses."""

import csv
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import checks
from .arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of numbers and text."""

    columns: tuple[str, ...]  # the header of each column, with its unit
    rows: tuple[tuple[Any, ...], ...]  # an entry for each column; numbers are not rounded

    def save(self, path: Path) -> Path:
        """Writes a CSV file with exact numbers."""
        return save_csv(path, self.columns, self.rows)


def read_csv(path: str | Path, counts: Sequence[int], rule: str, most: int | None = None) -> Floats:
    """Reads at `most` so many columns of a CSV file, of allowed `counts`; skips heading and #."""
    content = checks.path("path", path).read_bytes()
    with suppress(ValueError):
        # Spreadsheets begin a file with a mark of its encoding, and may quote its numbers.
        text = content.decode("utf-8-sig").replace('"', "")
        lines = (line.strip() for line in text.splitlines())
        rows = [line.split(",")[:most] for line in lines if line and line[0] != "#"]
        try:
            float(rows[0][0])
        except (ValueError, IndexError):
            rows = rows[1:]
        table = np.array(rows, dtype=np.float64)
        if table.shape[1:] in [(count,) for count in counts]:
            return table
    raise ValueError(f"{path}: must have {rule}")


def save_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Writes a header and rows as a CSV file with exact numbers."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)
    return path


def save_npz(path: Path, arrays: Mapping[str, NDArray[Any]], provenance: Mapping[str, Any]) -> Path:
    """Writes an NPZ file of arrays, and of their provenance as JSON text."""
    named: dict[str, Any] = {"provenance": np.array(json.dumps(provenance)), **arrays}
    with path.open("wb") as file:
        np.savez(file, **named)
    return path


def save_map(
    path: str | Path,
    header: Sequence[str],
    rows: Iterable[Sequence[Any]],
    arrays: Mapping[str, NDArray[Any]],
    provenance: Mapping[str, Any],
) -> Path:
    """Writes rows as .csv, or arrays with their provenance as .npz, by the suffix of the path."""
    writers: dict[str, Callable[[Path], object]] = {
        ".npz": lambda file: save_npz(file, arrays, provenance),
        ".csv": lambda file: save_csv(file, header, rows),
    }
    return save_by_suffix(path, writers)


def save_by_suffix(path: str | Path, writers: Mapping[str, Callable[[Path], object]]) -> Path:
    """Writes a file with the writer of its suffix: ".csv" -> function that writes the file."""
    path = checks.path("path", path)
    if path.suffix.lower() not in writers:
        raise ValueError(f"path = {str(path)!r}: must end in {' or '.join(writers)}")
    writers[path.suffix.lower()](path)
    return path
