"""Suggestions for errors: the field of a record, or of its parts, that is closest to a name."""

from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from itertools import count, islice
from typing import Any

# Fields that hold one value for both sides, or a pair (right, left).
_SIDED = ("tip", "control", "friction")
# Least similarity of two names, from 0 to 1.
_ALIKE = 0.5
# The most fields that are compared; a scene may have a million disturbances.
_MOST = 1000


def hint(name: str, owner: Any, path: str = "") -> str:
    """Returns '; did you mean "hand.tip.radius"?' if a field of the owner at `path` is close."""
    from difflib import SequenceMatcher  # only an error needs it

    def similarity(found: tuple[str, Any]) -> tuple[float, ...]:
        known, value = found
        # Users also write the name of the class, such as "object" for "grasped".
        kind = type(value).__name__.lower() if is_dataclass(value) else ""
        pairs = ((name, known), (last, known.rpartition(".")[2]), (last, kind))
        whole, *parts = (SequenceMatcher(None, one, other).ratio() for one, other in pairs)
        return max(whole, *parts), whole, -len(known)

    last = name.rpartition(".")[2]
    # The record that lacks the name is not meant; the error lists its fields.
    known = [each for each in islice(places(owner), _MOST) if not name.startswith(f"{each[0]}.")]
    best = max(known, key=similarity, default=None)
    if best is None or similarity(best)[0] < _ALIKE:
        return ""
    place = f"{path}.{best[0]}" if path else best[0]
    return f'; did you mean "{place}"?'


def places(owner: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yields path and value of each field of a record and of its parts, but not of arrays."""
    for f in fields(owner):
        if isinstance(owner, type):
            value = f.default if f.default_factory is MISSING else f.default_factory()
        else:
            value = getattr(owner, f.name)
        here = f"{path}.{f.name}" if path else f.name
        yield here, value
        if is_dataclass(value):
            yield from places(value, here)
        elif isinstance(value, tuple):
            sided = f.name in _SIDED
            for name, item in zip(("right", "left") if sided else count(), value, strict=False):
                inside = f"{here}.{name}"
                if is_dataclass(item):
                    yield from places(item, inside)
                elif sided:
                    yield inside, item
