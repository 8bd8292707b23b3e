"""Suggestions for errors: the closest field to an unknown name, and the part that was meant."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from itertools import islice
from typing import Any

# Least similarity of two names, from 0 to 1: for fields of the record itself, and for fields of
# nested records. Nested fields need more, because more names resemble each other by chance.
_ALIKE, _ALIKE_BELOW = 0.5, 0.6
# The most fields that are compared; a scene may have a million disturbances.
_MOST = 1000


def hint(name: str, owner: Any, path: str = "") -> str:
    """Returns '; did you mean "hand.tip.radius"?' if a field is close, otherwise an empty text.

    Args:
        name: The unknown name or dotted path.
        owner: The dataclass to search, with nested dataclasses: an instance, or a class, whose
            default values are searched.
        path: The dotted path of the owner, which goes in front of the suggestion.
    """
    import difflib  # only an error needs it

    def alike(one: str, other: str) -> float:
        return difflib.SequenceMatcher(None, one, other).ratio()

    last = name.rpartition(".")[2]
    best: tuple[float, float, int] = (0.0, 0.0, 0)
    found = ""
    for known, kinds in islice(places(owner), _MOST):
        if name.startswith(f"{known}."):
            continue  # the record that lacks the name; the error lists its fields
        whole = max(alike(name, known), alike(name, kinds))
        score = max(whole, *(alike(last, path.rpartition(".")[2]) for path in (known, kinds)))
        enough = _ALIKE_BELOW if "." in known else _ALIKE
        if score >= enough and (score, whole, -len(known)) > best:
            best, found = (score, whole, -len(known)), known
    return f'; did you mean "{_below(path, found)}"?' if found else ""


def part(name: str, value: object, cls: type[object]) -> str:
    """Returns "; pass grip.scene" if a `Grip` is given as `scene` and has one, else an empty text.

    Args:
        name: The argument's name, or a field with its class ("Scene.schedule").
        value: The value that is no `cls`.
        cls: The wanted class.
    """
    wanted = name.rpartition(".")[2]
    try:
        found = isinstance(getattr(value, wanted, None), cls)
    except Exception:  # a fit to several experiments has no single scene
        return ""
    return f"; pass {_words(type(value).__name__)}.{wanted}" if found else ""


def places(owner: Any, path: str = "", kinds: str = "") -> Iterator[tuple[str, str]]:
    """Yields the dotted path of each field of a record and of nested records, in two forms.

    The second form names nested records by their class instead of their field, because users also
    write paths such as "grasped_object.mass" for "grasped.mass".
    """
    for each in fields(owner):
        value = _default(each) if isinstance(owner, type) else getattr(owner, each.name)
        here = _below(path, each.name)
        kind = _below(kinds, _words(type(value).__name__) if is_dataclass(value) else each.name)
        yield here, kind
        items: Mapping[str, Any] = {}
        if is_dataclass(value):
            items = {"": value}
        elif isinstance(value, tuple):
            sides = each.name in ("tip", "control")
            names = ("right", "left") if sides else map(str, range(len(value)))
            items = dict(zip(names, value, strict=False))
        for name, item in items.items():
            if is_dataclass(item):
                inside = (here, kind) if not name else (f"{here}.{name}", f"{kind}.{name}")
                yield from places(item, *inside)


def _below(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _default(each: Field[Any]) -> Any:
    return each.default_factory() if each.default_factory is not MISSING else each.default


def _words(name: str) -> str:
    """The name of a class in lower case, with underscores between its words."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
