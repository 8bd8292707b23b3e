"""Records of several kinds in plain data, where each says by `kind` which it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from . import checks
from .record import Record

Kind = TypeVar("Kind", bound=Record)


def kind_of(record: Record, kinds: Mapping[str, type[Record]], place: str) -> str:
    """The kind of a record; `place` is where they are listed.

    Raises:
        TypeError: The class has no line there.
    """
    for kind, cls in kinds.items():
        if type(record) is cls:
            return kind
    raise TypeError(f"{type(record).__name__} has no kind: add it to {place}")


def chosen(
    base: type[Record], cls: type[Kind], kinds: Mapping[str, type[Record]], data: Any, path: str
) -> tuple[type[Kind], Any]:
    """The class that plain data asks for by `kind`, and the rest of the data.

    Args:
        base: Of all kinds.
        cls: Which is read: `base`, or one below it, which needs no `kind`.
        kinds: Kind -> class.
        data: Plain data.
        path: At which they stand.

    Raises:
        ValueError: The kind is missing, or is none of those below `cls`.
        TypeError: It is no text.
    """
    known = {kind: each for kind, each in kinds.items() if issubclass(each, cls)}
    if not isinstance(data, Mapping) or ("kind" not in data and cls is not base):
        return cls, data
    where = f"{base.__name__}.kind{checks.at(path)}"
    if "kind" not in data:
        raise ValueError(f"{where}: is missing; must be one of {checks.quoted(known)}")
    found = known[checks.choice(where, data["kind"], known)]
    return found, {name: value for name, value in data.items() if name != "kind"}
