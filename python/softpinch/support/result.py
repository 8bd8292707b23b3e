"""Frozen dataclasses that are compared by value, and results, whose arrays are read-only."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from .arrays import read_only
from .display import Shown, ShownTable, html_of, text_of


class ByValue(Shown):
    """Base class of frozen dataclasses that are compared, copied and pickled by value."""

    def _values(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        # NaN equals NaN, because it marks a missing number.
        if type(other) is not type(self):
            return NotImplemented
        return same(self._values(), other._values())

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor, because an unpickled array would be writable.
        return _rebuild, (type(self), self._values())


class Result(ByValue):
    """Base class of results, whose arrays stay read-only, also if unpickled or copied."""

    def __post_init__(self) -> None:
        for value in self._values().values():
            if isinstance(value, np.ndarray):
                read_only(value)

    def __repr__(self) -> str:
        return text_of(type(self).__name__, self._facts())

    def _facts(self) -> dict[str, Any]:
        return self._values()

    def _tables(self) -> Iterator[ShownTable]:
        """A table of each value that is a tuple of results of one kind."""
        for name, value in self._values().items():
            if _listed(value):
                rows = [tuple(one._values().values()) for one in value]
                yield ShownTable(tuple(value[0]._values()), rows, name)

    def _repr_html_(self) -> str:
        if type(self).__repr__ is not Result.__repr__:
            return super()._repr_html_()
        # Without what is None or NaN.
        facts = self._facts().items()
        values = {k: v for k, v in facts if v is not None and not same(v, math.nan)}
        # What the result says comes first, and tables of their own are not rows of this one.
        said = {"message": values.pop("message")} if "message" in values else {}
        rows = [(name, value) for name, value in {**said, **values}.items() if not _listed(value)]
        head = ShownTable(("", ""), rows, type(self).__name__)
        return html_of(self._picture(), (head, *self._tables()))

    def __hash__(self) -> int:
        # Text, integers and booleans only, which is fast and consistent with equality.
        kept = (str, int, bool)
        return hash((type(self), *(v for v in self._values().values() if isinstance(v, kept))))


def _listed(value: Any) -> bool:
    """Whether a value is a tuple of results, which a notebook shows as a table."""
    return isinstance(value, tuple) and bool(value) and isinstance(value[0], Result)


def _rebuild(cls: type[ByValue], values: dict[str, Any]) -> ByValue:
    return cls(**values)


def same(a: Any, b: Any) -> bool:
    """Compares values of fields: arrays, NaN, and what contains them."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind in "fc" and b.dtype.kind in "fc")
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(same(value, b[name]) for name, value in a.items())
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, float) and isinstance(b, float) and a != a:
        return b != b
    return type(a) is type(b) and bool(a == b)
