"""Tables of numbers and text, as CSV files."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
        with writing(path), path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([self.columns, *self.rows])
        return path
