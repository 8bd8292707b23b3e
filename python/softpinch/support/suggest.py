"""Suggestions for errors: the field of a record, or of its parts, that is closest to a name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from itertools import count, islice
from typing import Any

# Fields that hold one value for both sides, or a pair (right, left).
_SIDED = ("tip", "control", "friction")
# Least similarity of two names, from 0 to 1: for fields of the record itself, and for fields of
# nested records. Nested fields need more, because more names resemble each other by chance.
_ALIKE, _ALIKE_BELOW = 0.5, 0.6
# The most fields that are compared; a scene may have a million disturbances.
_MOST = 1000


def hint(name: str, owner: Any, path: str = "") -> str:
    """Returns '; did you mean "hand.tip.radius"?' if a field is close, otherwise an empty text.

    The fields are those of a dataclass, an instance or a class with its defaults, and of nested
    ones. `path` is the place of the owner, which goes in front of the suggestion.
    """
    import difflib  # only an error needs it

    def alike(one: str, other: str) -> float:
        return difflib.SequenceMatcher(None, one, other).ratio()

    last = name.rpartition(".")[2]
    best: tuple[float, float, int] = (0.0, 0.0, 0)
    found = ""
    for known, value in islice(places(owner), _MOST):
        if name.startswith(f"{known}."):
            continue  # the record that lacks the name; the error lists its fields
        whole = alike(name, known)
        # Users also write the name of the class, such as "object" for "grasped".
        kind = type(value).__name__.lower() if is_dataclass(value) else ""
        score = max(whole, alike(last, known.rpartition(".")[2]), alike(last, kind))
        enough = _ALIKE_BELOW if "." in known else _ALIKE
        if score >= enough and (score, whole, -len(known)) > best:
            best, found = (score, whole, -len(known)), known
    return f'; did you mean "{_below(path, found)}"?' if found else ""


def places(owner: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yields the dotted path and the value of each field of a record, and of all inside it.

    Entries of pairs have the names of their sides, records in other tuples their indices. Numbers
    in tuples and arrays are not listed.
    """
    for each in fields(owner):
        value = _default(each) if isinstance(owner, type) else getattr(owner, each.name)
        here = _below(path, each.name)
        yield here, value
        if is_dataclass(value):
            yield from places(value, here)
        elif isinstance(value, tuple):
            sided = each.name in _SIDED
            for name, item in zip(("right", "left") if sided else count(), value, strict=False):
                inside = f"{here}.{name}"
                if is_dataclass(item):
                    yield from places(item, inside)
                elif sided:
                    yield inside, item


def _below(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _default(each: Field[Any]) -> Any:
    return each.default_factory() if each.default_factory is not MISSING else each.default
