"""Text of objects for a terminal, at most ten lines, and tables for a notebook."""

import html
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from itertools import islice
from typing import Any

import numpy as np

# A terminal shows a title and at most so many lines below it.
_LINES = 8
_LINE = 100
_LONG_NUMBER = re.compile(r"(?<![\w.])\d+\.\d{6,}(?:e[-+]?\d+)?")
_STYLE = 'style="text-align:left;padding:0.1em 0.8em 0.1em 0;vertical-align:top"'


@dataclass(frozen=True)
class ShownTable:
    """A table in a notebook."""

    columns: tuple[str, ...]  # the header of each column, with its unit
    rows: Sequence[Sequence[Any]]  # an entry for each column; `short` formats all but text
    caption: str = ""  # a line above the table
    folded: bool = False  # whether it is hidden until a reader clicks on its caption

    def html(self) -> str:
        """The table as HTML, with all text escaped."""
        caption = html.escape(self.caption)
        lines = [f"<caption {_STYLE}>{caption}</caption>" if caption and not self.folded else ""]
        lines += [_row("th", self.columns), *(_row("td", row) for row in self.rows)]
        table = f"<table>{''.join(lines)}</table>"
        return f"<details><summary>{caption}</summary>{table}</details>" if self.folded else table

    def text(self) -> str:
        """The table as at most ten lines of text, without its caption."""
        rows = [self.columns, *(tuple(map(short, row)) for row in self.rows[:_LINES])]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [
            "  ".join(f"{entry:{width}}" for entry, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        more = len(self.rows) - _LINES
        return "\n".join([*lines, f"and {more} more"] if more > 0 else lines)


def _row(kind: str, entries: Iterable[Any]) -> str:
    cells = (f"<{kind} {_STYLE}>{html.escape(short(entry))}</{kind}>" for entry in entries)
    return f"<tr>{''.join(cells)}</tr>"


class Shown:
    """Base class of objects that notebooks show as their `repr`, `_picture` and `_tables`."""

    def _tables(self) -> Iterable[ShownTable]:
        """The tables below the text; none by default."""
        return ()

    def _picture(self) -> str:
        """An SVG drawing between text and tables; empty for none."""
        return ""

    def _repr_html_(self) -> str:
        # Unwrapped, long lines would make the whole page wider.
        text = f'<pre style="white-space:pre-wrap">{html.escape(repr(self))}</pre>'
        return html_of(f"{text}{self._picture()}", self._tables())


def html_of(head: str, tables: Iterable[ShownTable]) -> str:
    """HTML with tables below it."""
    return f"<div>{head}{''.join(table.html() for table in tables)}</div>"


def text_of(title: str, facts: Mapping[str, Any]) -> str:
    """Names and values: on one line if they fit there, else a title and some lines below it."""
    shown = {name: short(value) for name, value in facts.items()}
    line = f"<{title}: {', '.join(f'{name} = {value}' for name, value in shown.items())}>"
    if len(line) <= _LINE:
        return line
    width = max(map(len, shown))
    some = islice(shown.items(), _LINES)
    lines = [_cut(f"  {name:{width}}  {value}", _LINE) for name, value in some]
    if len(shown) > _LINES:
        lines.append(f"  and {len(shown) - _LINES} more")
    return "\n".join([f"<{title}", *lines]) + ">"


def short(value: Any) -> str:
    """A value on one short line; of large arrays the shape and the smallest and largest number."""
    if value is None:
        return "not set"
    if isinstance(value, str):
        return _cut(" ".join(value.split()), 500)
    by_default: Any = object.__str__
    if type(value).__str__ is not by_default and not isinstance(value, np.generic | np.ndarray):
        return _cut(" ".join(str(value).split()), 500)
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | complex | np.inexact):
        return f"{value:.6g}"
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, Mapping):
        return _several([f"{short(key)}: {short(entry)}" for key, entry in value.items()])
    if isinstance(value, tuple | list):
        kinds = {type(entry) for entry in value}
        if len(kinds) == 1 and len(value) > 1 and is_dataclass(kind := kinds.pop()):
            return f"{len(value)} of {kind.__name__}"
        return _several([short(entry) for entry in value])
    # A record's repr has all digits, so that it can be pasted; a table shows six of them.
    text = _LONG_NUMBER.sub(lambda found: f"{float(found[0]):.6g}", repr(value))
    return _cut(" ".join(text.split()), 200)


def _several(entries: list[str]) -> str:
    text = ", ".join(entries)
    if len(text) <= _LINE:
        return text or "none"
    return f"{_cut(entries[0], _LINE)}, and {len(entries) - 1} more"


def _array(array: np.ndarray[Any, Any]) -> str:
    if array.ndim == 0:
        return short(array.item())
    if array.ndim == 1 and array.size <= 6:
        return _several([short(entry) for entry in array.tolist()])
    shape = " x ".join(map(str, array.shape))
    if array.dtype.kind not in "iuf" or not array.size:
        return f"{shape} values"
    known = array[np.isfinite(array)] if array.dtype.kind == "f" else array
    if not known.size:
        return f"{shape} values, none finite"
    unknown = "" if known.size == array.size else f", {array.size - known.size} not finite"
    return f"{shape} values, {short(known.min().item())} to {short(known.max().item())}{unknown}"


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."
