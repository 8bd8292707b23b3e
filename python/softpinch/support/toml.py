"""TOML files, written with exact numbers and read up to a size.

Files may come from strangers. The limit also ends the reading of a device that has no end.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from . import checks, extras

# The most bytes of a file, or characters of a text.
MOST_BYTES = 2**26


def dumps(data: Mapping[str, Any], what: str) -> str:
    """Converts plain data to TOML with exact numbers. A first comment names the kind of file."""
    tomli_w = extras.require("tomli_w", extra="cli", purpose="writing TOML")
    text: str = tomli_w.dumps(data)
    return f"# A softpinch {what}: SI units, angles in radians.\n{text}"


def read(source: str | Path) -> dict[str, Any]:
    """Parses TOML text (`str`), or the file at a `Path`."""
    if isinstance(source, str):
        advice = "" if "\n" in source else "; for a file pass a pathlib.Path"
        with checks.reworded("source: ", advice, kind=ValueError):
            return _loads(source)
    checks.instance("source", source, Path, "TOML text, or the pathlib.Path of a file")
    path = checks.path("source", source)
    with checks.reworded(f"{path}: ", kind=ValueError):
        return contents(path)


def contents(path: Path) -> dict[str, Any]:
    """Parses a TOML file as `read` does, but error messages do not name the file."""
    with path.open("rb") as file:
        return _loads(file.read(MOST_BYTES + 1))


def _loads(given: str | bytes) -> dict[str, Any]:
    import tomllib  # `import softpinch` does not need it

    if len(given) > MOST_BYTES:
        raise ValueError(f"has more than {MOST_BYTES >> 20} MiB")
    # Some editors write a byte order mark first.
    text = given if isinstance(given, str) else given.decode("utf-8-sig")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
