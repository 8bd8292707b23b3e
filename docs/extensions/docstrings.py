"""Docstrings are plain text in Google's style: what reStructuredText would take for markup is kept.

|error|, 10**u and theta_ are text. Indented lines ahead of the sections are code. A constant has
the comment above it in place of its type's docstring.
"""

from __future__ import annotations

import inspect
import re
import sys
from importlib.util import resolve_name
from typing import Any

from sphinx.application import Sphinx

_SECTION = re.compile(r"(Args|Attributes|Returns|Raises|Warns|Yields|Example|Examples):")
# Code between backticks stays; elsewhere these characters are text.
_CODE_OR_MARK = re.compile(r"(``.+?``|`[^`]+`)|([*|\\]|(?<=\w)_(?!\w))")


def _keep(match: re.Match[str]) -> str:
    return match[1] or "\\" + match[2]


def _escape(lines: list[str]) -> list[str]:
    text = "\n".join(lines)
    if ">>>" in text:
        return [line if ">>>" in line else _CODE_OR_MARK.sub(_keep, line) for line in lines]
    return _CODE_OR_MARK.sub(_keep, text).split("\n")


def _plain(_: Sphinx, what: str, name: str, __: Any, ___: Any, lines: list[str]) -> None:
    """Escapes a docstring, before napoleon reads its sections."""
    if what == "data":
        lines[:] = _comment(name)
    first = next((k for k, line in enumerate(lines) if _SECTION.match(line)), len(lines))
    made: list[str] = []
    code = False
    text: list[str] = []
    for line in lines[:first]:
        starts = line.startswith("    ") and not (text and text[-1].strip()) and not code
        if code and line.strip() and not line.startswith("    "):
            code = False
        if starts and ">>>" not in line:
            made += [*_escape(text), "::", ""]
            text, code = [], True
        if code:
            made.append(line)
        else:
            text.append(line)
    lines[:] = [*made, *_escape(text), *_escape(lines[first:])]
    if what in ("property", "attribute"):
        _break_before_colon(lines, 0, "")
    elif "Returns:" in lines:
        _break_before_colon(lines, lines.index("Returns:") + 1, "    ")


def _break_before_colon(lines: list[str], place: int, indent: str) -> None:
    """Moves the word with the first colon to the next line: napoleon reads types from the first."""
    head, colon, tail = lines[place].partition(": ")
    if colon:
        words, _, last = head.rpartition(" ")
        lines[place : place + 1] = [words, f"{indent}{last}: {tail}"]


def _comment(name: str) -> list[str]:
    """The comment above a constant, in the module from which this one imports it."""
    module, _, constant = name.rpartition(".")
    source = inspect.getsource(sys.modules[module])
    found = re.search(rf"((?:^# .*\n)+){constant}\b", source, re.MULTILINE)
    if found:
        return [line[2:] for line in found[1].splitlines()]
    imported = re.search(rf"^from (\.\S+) import .*\b{constant}\b", source, re.MULTILINE)
    if imported is None:
        return []
    origin = resolve_name(imported[1], sys.modules[module].__package__)
    return _comment(f"{origin}.{constant}")


# `numpy.typing.ArrayLike`, spelled out.
_ARRAY_LIKE = re.compile(r"\S*_Buffer \| \S*_SupportsArray.*?_NestedSequence\[[^\[\]]*\]")


def _short(
    _: Sphinx, __: str, ___: str, ____: Any, _____: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Writes ArrayLike for what NumPy means by it."""
    shown = [each and _ARRAY_LIKE.sub("ArrayLike", each) for each in (signature, returns)]
    return shown[0], shown[1]


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension, ahead of napoleon."""
    app.connect("autodoc-process-docstring", _plain, priority=400)
    app.connect("autodoc-process-signature", _short)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
