"""TOML files, written with exact numbers and read with limits.

Files may come from strangers, so limits on the size, on the nesting of tables and arrays and on
the digits of an integer bound the cost of reading. The size limit also ends the reading of a pipe
or a device that has no end.
"""

from __future__ import annotations

import io
import os
import re
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from . import checks, extras
from .files import without_waiting

# Limits of a file.
MOST_BYTES = 2**26
MOST_LEVELS = 100
MOST_DIGITS = 1000
_CHUNK = 2**20

# Possessive quantifiers never backtrack, so searches take linear time on any input.
_LONG_TEXT = r"""\"{3}(?:[^"\\]++|\\.|"(?!""))*+(?:"{3}|\Z)|'{3}(?:[^']++|'(?!''))*+(?:'{3}|\Z)"""
_TEXT = r""""(?:[^"\\\n]++|\\.)*+"|'[^'\n]*+'"""
_COMMENT = r"\#[^\n]*+"
_PART = rf"(?:[\w-]++|{_TEXT})"
_LONG_NAME = rf"(?<![\w.-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MOST_LEVELS},}}+"
_ANY_LONG_NAME = re.compile(_LONG_NAME, re.S)
_NAMES = re.compile(rf"{_LONG_TEXT}|{_COMMENT}|(?P<found>{_LONG_NAME})|{_TEXT}", re.S)
_BRACKETS = re.compile(rf"{_LONG_TEXT}|{_COMMENT}|{_TEXT}|(?P<found>[][{{}}])", re.S)
_LONG_INTEGER = re.compile(rf"[0-9][0-9_]{{{MOST_DIGITS},}}+")


def dumps(data: Mapping[str, Any], what: str) -> str:
    """Converts plain data to TOML with exact numbers. A first comment names the kind of file.

    Raises:
        ImportError: tomli_w is not installed.
    """
    tomli_w = extras.require("tomli_w", extra="cli", purpose="writing TOML")
    text: str = tomli_w.dumps(data)
    return f"# A softpinch {what}: SI units, angles in radians.\n{text}"


def read(source: str | Path) -> dict[str, Any]:
    """Parses TOML text (`str`), or the file at a `Path`.

    Raises:
        TypeError: `source` is neither text nor a `Path`.
        ValueError: The source is not TOML, or exceeds a limit. The message has the file and place.
        OSError: The file cannot be read.
    """
    if isinstance(source, str):
        if len(source) > MOST_BYTES:
            raise ValueError(f"source: has more than {MOST_BYTES >> 20} MiB")
        try:
            return _loads(source)
        except ValueError as error:
            raise ValueError(f"source: {error}") from None
    if not isinstance(source, Path):
        raise TypeError(
            f"source = {checks.shown(source)}: must be TOML text, or the pathlib.Path of a file"
        )
    path = checks.path("source", source)
    try:
        return contents(path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def contents(path: Path) -> dict[str, Any]:
    """Parses a TOML file as `read` does, but error messages do not name the file."""
    return _loads(_decoded(read_bytes(path)), "")


def read_bytes(path: Path) -> bytes:
    """Returns the content of a file, a pipe or a device.

    Raises:
        ValueError: The content exceeds `MOST_BYTES`, or the file is a pipe that stayed empty.
        OSError: The file cannot be read.
    """
    parts, count = [], 0
    with open(path, "rb", buffering=0, opener=without_waiting) as file:
        mode = os.fstat(file.fileno())
        if stat.S_ISREG(mode.st_mode) and mode.st_size > MOST_BYTES:
            raise ValueError(f"has more than {MOST_BYTES >> 20} MiB")
        while True:
            part = file.read(_CHUNK)
            if part is None:  # the other end of a pipe or a terminal has not written yet
                _wait(file)
                continue
            if not part:
                break
            parts.append(part)
            count += len(part)
            if count > MOST_BYTES:
                raise ValueError(f"has more than {MOST_BYTES >> 20} MiB")
    if not count and stat.S_ISFIFO(mode.st_mode):
        raise ValueError("is a pipe that nothing was written into")
    return b"".join(parts)


def _wait(file: io.RawIOBase) -> None:
    """Waits until data is available or the other end is closed."""
    import selectors  # rarely needed

    with selectors.DefaultSelector() as selector:
        selector.register(file, selectors.EVENT_READ)
        selector.select()


def _decoded(data: bytes) -> str:
    try:
        # Some editors write a byte order mark first.
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ValueError(f"line {line}: is not UTF-8 text, byte {data[error.start]:#04x}") from None


def _loads(text: str, advice: str = "; for a file pass a pathlib.Path") -> dict[str, Any]:
    import tomllib  # `import softpinch` does not need it

    long_name = _long_name(text)
    if long_name is not None:
        raise ValueError(f"{_line(text, long_name)}: a name has over {MOST_LEVELS} parts")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        said = str(error)
        raise ValueError(
            f"{said if len(said) <= 200 else said[:200] + '...'}{'' if chr(10) in text else advice}"
        ) from None
    except RecursionError:
        place = _line(text, _deepest(text))
        raise ValueError(f"{place}: is nested deeper than {MOST_LEVELS} levels") from None
    except ValueError:
        # Python refuses to parse an integer of thousands of digits.
        found = _LONG_INTEGER.search(text)
        if found is None:
            raise
        place = _line(text, found.start())
        raise ValueError(f"{place}: an integer has over {MOST_DIGITS} digits") from None
    _refuse_unbounded(data)
    return data


def _refuse_unbounded(data: dict[str, Any]) -> None:
    """Refuses integers with too many digits, and tables and arrays nested too deeply."""
    bits = int(MOST_DIGITS * 3.33)
    # Entries are (table or array, place, level). A place is (place of the parent, name).
    waiting: list[tuple[Any, tuple[Any, ...], int]] = [(data, (), 0)]
    while waiting:
        node, place, level = waiting.pop()
        if level > MOST_LEVELS:
            raise ValueError(f"{_dotted(place)}: is nested deeper than {MOST_LEVELS} levels")
        for name, value in node.items() if isinstance(node, dict) else enumerate(node):
            if isinstance(value, dict | list):
                waiting.append((value, (place, name), level + 1))
            elif isinstance(value, int) and value.bit_length() > bits:
                raise ValueError(
                    f"{_dotted((place, name))}: an integer has over {MOST_DIGITS} digits"
                )


def _dotted(place: tuple[Any, ...]) -> str:
    names: list[str] = []
    while place:
        place, name = place
        names.append(checks.printable(str(name)))
    names.reverse()
    return ".".join(names[:5]) + (" ..." if len(names) > 5 else "")


def _line(text: str, position: int) -> str:
    """Returns the line number of a position and the first characters of that line."""
    start = text.rfind("\n", 0, position) + 1
    beginning = text[start : start + 40].partition("\n")[0]
    return f"line {text.count(chr(10), 0, start) + 1} ({checks.printable(beginning)})"


def _found(tokens: re.Pattern[str], text: str) -> Iterator[re.Match[str]]:
    """Yields the matches of group `found`, which lie outside text and comments."""
    return (token for token in tokens.finditer(text) if token["found"])


def _long_name(text: str) -> int | None:
    """Returns the position of the first dotted name with too many parts, or None.

    The standard library's parser takes time quadratic in the number of parts.
    """
    # A quick search that also looks inside text and comments settles nearly every file.
    if text.count(".") < MOST_LEVELS or _ANY_LONG_NAME.search(text) is None:
        return None
    return next((token.start() for token in _found(_NAMES, text)), None)


def _deepest(text: str) -> int:
    """Returns the position of the first value that is nested too deeply."""
    level = start = 0
    for token in _found(_BRACKETS, text):
        if token["found"] in "[{":
            start = token.start() if level == 0 else start
            level += 1
            if level > MOST_LEVELS:
                return start
        else:
            level = max(0, level - 1)
    return 0
