"""The base class of a scene's parts: a frozen dataclass, validated and compared by value.

It also converts records to plain dictionaries, as TOML and JSON need them, and back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self, TypeAlias, TypeVar

import numpy as np

from .. import _core
from .arrays import Floats
from .checks import at, below, choice, number, quoted, refuse_unknown, reworded, shown
from .display import ShownTable
from .result import ByValue, same

# (plain data, its dotted path) -> the value of the field.
Parser: TypeAlias = Callable[[Any, str], Any]

RecordType = TypeVar("RecordType", bound="Record")

SIDES = ("right", "left")
# A repr prints arrays up to this number of entries, and only the shape of larger ones.
_SHOWN = 32


def plain(value: Any) -> Any:
    """Converts records, arrays and tuples to dictionaries and lists of numbers and text."""
    if isinstance(value, Record):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return value


def _show(value: object) -> str:
    if isinstance(value, np.ndarray):
        return repr(value.tolist()) if value.size <= _SHOWN else f"<array {value.shape}>"
    return repr(value)


def unchecked(record: RecordType, values: Mapping[str, Any]) -> RecordType:
    """Returns a copy with other values, which are not checked."""
    copy = object.__new__(type(record))
    for name, value in {**record._values(), **values}.items():
        object.__setattr__(copy, name, value)
    return copy


def bare(record: RecordType, values: Mapping[str, Floats]) -> RecordType:
    """Returns an unchecked copy for `compile`, whose numbers have the runs as their first axis."""
    many = {
        name: np.asarray(value)[None]
        for name, value in record._values().items()
        if isinstance(value, float | tuple | np.ndarray)
    }
    return unchecked(record, {**many, **values})


def runs_of(
    record: RecordType, values: Mapping[str, Floats], runs: Iterable[int] | None = None
) -> Iterator[RecordType]:
    """Yields the record of each of the runs; `values` are the fields that differ (runs, ...)."""
    for run in range(len(next(iter(values.values())))) if runs is None else runs:
        with reworded(f"run {run}: "):
            one = replace(record, **{name: value[run] for name, value in values.items()})
        yield one


@dataclass(frozen=True, eq=False, repr=False)
class Record(ByValue):
    """Base class of the parts of a scene.

    Derive with `@dataclass(frozen=True, kw_only=True, eq=False, repr=False)`. Fields that
    `_core.RULES` lists under the class's name are converted to float and validated. None is
    accepted if it is the field's default.
    """

    # Field -> parser, for fields that hold more than numbers and text.
    _parsers: ClassVar[Mapping[str, Parser]] = {}

    def __new__(cls, *args: Any, **values: Any) -> Self:  # noqa: D102
        if not values.keys() <= cls.__dataclass_fields__.keys():
            import inspect  # only an error needs it

            # A class may have a constructor of its own, with other arguments than its fields.
            names = list(inspect.signature(cls.__init__).parameters)[1:]
            if cls.__dataclass_fields__.keys() >= {*names}:
                with reworded(kind=TypeError):
                    refuse_unknown(cls.__name__, values, names, "", cls)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        kind = next((c.__name__ for c in type(self).__mro__ if c.__name__ in _core.RULES), "")
        rules = _core.RULES.get(kind, {})
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in rules and not (value is None and f.default is None):
                value = number(f"{kind}.{f.name}", value)
                _core.validate(kind, f.name, value)
                self._set(f.name, value)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        # -0.0 equals 0.0, so both must hash alike: adding zero turns -0.0 into 0.0.
        keys = (
            (value.shape, (value + 0.0).tobytes()) if isinstance(value, np.ndarray) else value
            for value in self._values().values()
        )
        return hash((type(self), *keys))

    def _call(self) -> tuple[str, dict[str, Any]]:
        """A call that makes an equal record: a function, and the arguments that are no defaults."""
        shown = {}
        for f in fields(self):
            value = getattr(self, f.name)
            default = f.default_factory() if f.default_factory is not MISSING else f.default
            if not same(value, default):
                shown[f.name] = value
        return type(self).__name__, shown

    def _tables(self) -> Iterator[ShownTable]:
        yield ShownTable(("field", "value"), tuple(self._values().items()))

    def __repr__(self) -> str:
        function, arguments = self._call()
        shown = ", ".join(f"{name}={_show(value)}" for name, value in arguments.items())
        return f"{function}({shown})"

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Prints the repr, for IPython and Hypothesis, which would print other attributes too."""
        printer.text(repr(self))

    def to_dict(self) -> dict[str, Any]:
        """Converts to numbers, text, lists and dictionaries; omits None and arrays of size 0."""
        return {k: plain(x) for k, x in self._values().items() if getattr(x, "size", x is not None)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Makes a record from the output of `to_dict`; errors have the place in the data."""
        return cls._parse(data, "")

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        known = fields(cls)
        needed = [f.name for f in known if f.default is MISSING and f.default_factory is MISSING]
        refuse_unknown(cls.__name__, data, [f.name for f in known], path, cls, needed)
        values = {
            name: cls._parsers[name](value, below(path, name)) if name in cls._parsers else value
            for name, value in data.items()
        }
        with reworded(after=at(path)):
            return cls(**values)


@dataclass(frozen=True, eq=False, repr=False)
class Kinded(Record):
    """Base class of records of several kinds; `_kinds` of a direct subclass is kind -> class."""

    _kinds: ClassVar[Mapping[str, type[Kinded]]] = {}

    def to_dict(self) -> dict[str, Any]:
        """Converts to a dictionary with the entry `kind`, which `from_dict` needs."""
        for kind, cls in self._kinds.items():
            if type(self) is cls:
                return {"kind": kind, **super().to_dict()}
        raise TypeError(f"{type(self).__name__} has no kind, so that no file can hold it")

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        """Selects the class by `kind`, which is optional if `cls` is a kind itself."""
        if not isinstance(data, Mapping) or ("kind" not in data and Kinded not in cls.__bases__):
            return super()._parse(data, path)
        known = {kind: each for kind, each in cls._kinds.items() if issubclass(each, cls)}
        where = f"{cls.__name__}.kind{at(path)}"
        if "kind" not in data:
            raise ValueError(f"{where}: is missing; must be one of {quoted(known)}")
        found = known[choice(where, data["kind"], known)]
        rest = {name: value for name, value in data.items() if name != "kind"}
        return super(Kinded, found)._parse(rest, path)


def array_of(cls: type[Record], field: str) -> Parser:
    """Returns a parser of an array of tables, of a `field` such as "Scene.disturbances"."""

    def parse(data: Any, path: str) -> Any:
        if not isinstance(data, list | tuple):
            raise TypeError(f"{field} = {shown(data)}: must be an array of tables")
        return tuple(cls._parse(item, below(path, k)) for k, item in enumerate(data))

    return parse
