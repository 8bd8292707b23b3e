"""Plain data in which an entry `kind` selects the record class, such as kind = "pulse"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from . import checks
from .record import Record

Kind = TypeVar("Kind", bound=Record)


def kind_of(record: Record, kinds: Mapping[str, type[Record]], place: str) -> str:
    """Returns the name of a record's class in the table `kinds`; errors call the table `place`.

    Raises:
        TypeError: The class is not in the table.
    """
    for kind, cls in kinds.items():
        if type(record) is cls:
            return kind
    raise TypeError(f"{type(record).__name__} has no kind: add it to {place}")


def chosen(
    base: type[Record], cls: type[Kind], kinds: Mapping[str, type[Record]], data: Any, path: str
) -> tuple[type[Kind], Any]:
    """Returns the class that the entry `kind` selects, and the data without that entry.

    Args:
        base: The common base class of all kinds.
        cls: The class whose `from_dict` is called: `base`, or a derived class, for which `kind` is
            optional.
        kinds: Kind -> class.
        data: Plain data.
        path: The dotted path of the data, for error messages.

    Raises:
        ValueError: The kind is missing, or does not belong to `cls` or a class derived from it.
        TypeError: The kind is not text.
    """
    known = {kind: each for kind, each in kinds.items() if issubclass(each, cls)}
    if not isinstance(data, Mapping) or ("kind" not in data and cls is not base):
        return cls, data
    where = f"{base.__name__}.kind{checks.at(path)}"
    if "kind" not in data:
        raise ValueError(f"{where}: is missing; must be one of {checks.quoted(known)}")
    found = known[checks.choice(where, data["kind"], known)]
    return found, {name: value for name, value in data.items() if name != "kind"}


def without_kind(place: str, data: Any, kind: str, path: str) -> Any:
    """Returns plain data of one kind without its optional entry `kind`.

    Raises:
        ValueError: The entry is another kind.
        TypeError: The entry is not text.
    """
    if not isinstance(data, Mapping) or "kind" not in data:
        return data
    checks.choice(f"{place}.kind{checks.at(path)}", data["kind"], (kind,))
    return {name: value for name, value in data.items() if name != "kind"}
