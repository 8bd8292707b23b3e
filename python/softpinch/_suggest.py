"""What a name that nobody knows was meant to be: the closest field, with its dotted path."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any

from . import _record
from ._record import SIDES, Record

# How alike two names must be, from 0 to 1: among more names more are alike by chance.
_ALIKE, _ALIKE_BELOW = 0.5, 0.6
# Longer names are no slips of the finger, and slow to compare.
_LONGEST = 100


def hint(name: str, owner: Record | type[Record], path: str = "") -> str:
    """'; did you mean "hand.tip.radius"?' where a field of `owner` or below it is close.

    Args:
        name: What was given; perhaps a dotted path.
        owner: The record, or its class, which stands for its defaults.
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
    for known, kinds in places(owner):
        whole = max(alike(name, known), alike(name, kinds))
        score = max(whole, *(alike(last, path.rpartition(".")[2]) for path in (known, kinds)))
        enough = _ALIKE_BELOW if "." in known else _ALIKE
        if score >= enough and (score, whole, -len(known)) > best:
            best, found = (score, whole, -len(known)), known
    return f'; did you mean "{_record.below(path, found)}"?' if found else ""


def places(
    owner: Record | type[Record], path: str = "", kinds: str = ""
) -> Iterator[tuple[str, str]]:
    """Dotted paths of the fields of a record and of those below it, each in two forms.

    The second has the classes of records for the names of the fields that hold them: a field may
    also be called by that, as in "grasped_object.mass".
    """
    for each in fields(owner):
        value = _default(each) if isinstance(owner, type) else getattr(owner, each.name)
        here = _record.below(path, each.name)
        kind = _record.below(kinds, _in_words(value) or each.name)
        yield here, kind
        items: Mapping[str, Any] = {}
        if isinstance(value, Record):
            items = {"": value}
        elif isinstance(value, tuple):
            pair = each.name in ("tip", "control")
            items = dict(zip(SIDES if pair else map(str, range(len(value))), value, strict=False))
        for name, item in items.items():
            if isinstance(item, Record):
                inside = (here, kind) if not name else (f"{here}.{name}", f"{kind}.{name}")
                yield from places(item, *inside)


def _default(each: Field[Any]) -> Any:
    return each.default_factory() if each.default_factory is not MISSING else each.default


def _in_words(value: object) -> str:
    if not isinstance(value, Record):
        return ""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", type(value).__name__).lower()
