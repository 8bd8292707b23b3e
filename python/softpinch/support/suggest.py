"""What a name that nobody knows was meant to be: the closest field, with its dotted path."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from itertools import islice
from typing import Any

# How alike two names must be, from 0 to 1: among more names more are alike by chance.
_ALIKE, _ALIKE_BELOW = 0.5, 0.6
# Longer names are no slips of the finger, and slow to compare.
_LONGEST = 100
# A scene may have a million disturbances: no more fields than these are compared.
_MOST = 1000


def hint(name: str, owner: Any, path: str = "") -> str:
    """'; did you mean "hand.tip.radius"?' where a field of `owner` or below it is close.

    Args:
        name: What was given; perhaps a dotted path.
        owner: The record, a dataclass, or its class, which stands for its defaults.
        path: Where the owner is, put in front.
    """
    if len(name) > _LONGEST:
        return ""
    import difflib  # only an error needs it

    def alike(one: str, other: str) -> float:
        return difflib.SequenceMatcher(None, one, other).ratio()

    last = name.rpartition(".")[2]
    best: tuple[float, float, int] = (0.0, 0.0, 0)
    found = ""
    for known, kinds in islice(places(owner), _MOST):
        whole = max(alike(name, known), alike(name, kinds))
        score = max(whole, *(alike(last, path.rpartition(".")[2]) for path in (known, kinds)))
        enough = _ALIKE_BELOW if "." in known else _ALIKE
        if score >= enough and (score, whole, -len(known)) > best:
            best, found = (score, whole, -len(known)), known
    return f'; did you mean "{_below(path, found)}"?' if found else ""


def places(owner: Any, path: str = "", kinds: str = "") -> Iterator[tuple[str, str]]:
    """Dotted paths of the fields of a record and of those below it, each in two forms.

    The second has the classes of records for the names of the fields that hold them: a field may
    also be called by that, as in "grasped_object.mass".
    """
    for each in fields(owner):
        value = _default(each) if isinstance(owner, type) else getattr(owner, each.name)
        here = _below(path, each.name)
        kind = _below(kinds, _in_words(value) or each.name)
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


def _in_words(value: object) -> str:
    if not is_dataclass(value):
        return ""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", type(value).__name__).lower()
