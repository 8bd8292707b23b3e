"""The base class of a scene's parts: a frozen dataclass, validated and compared by value.

It also converts records to plain dictionaries, as TOML and JSON need them, and back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, ClassVar, Self, TypeAlias, TypeVar

import numpy as np

from .. import _core
from .arrays import Floats
from .checks import at, below, number, refuse_unknown
from .display import Shown, ShownTable

# (plain data, its dotted path) -> the value of the field.
Parser: TypeAlias = Callable[[Any, str], Any]

RecordType = TypeVar("RecordType", bound="Record")

SIDES = ("right", "left")
# A repr prints arrays up to this number of entries, and only the shape of larger ones.
_SHOWN = 32


def _refuse_arguments(cls: type[Record], values: Mapping[str, Any]) -> None:
    """Refuses unknown arguments of a constructor and suggests the closest field.

    Raises:
        TypeError: An argument is unknown; Python uses this type for unknown arguments too.
    """
    import inspect  # only an error needs it

    # A subclass may define its own constructor, with arguments that are not fields.
    own = list(inspect.signature(cls.__init__).parameters.values())[1:]
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in own):
        return
    names = [parameter.name for parameter in own]
    generated = cls.__dataclass_fields__.keys() >= set(names)
    try:
        refuse_unknown(cls.__name__, values, names, "", cls if generated else None)
    except ValueError as error:
        raise TypeError(str(error)) from None


def plain(value: Any) -> Any:
    """Converts records, arrays and tuples to dictionaries and lists of numbers and text."""
    if isinstance(value, Record):
        return value.to_dict()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return value


def _key(value: object) -> object:
    # -0.0 equals 0.0, so both must hash alike: adding zero turns -0.0 into 0.0.
    return (value.shape, (value + 0.0).tobytes()) if isinstance(value, np.ndarray) else value


def _same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    return type(a) is type(b) and bool(a == b)


def _show(value: object) -> str:
    if isinstance(value, np.ndarray):
        return repr(value.tolist()) if value.size <= _SHOWN else f"<array {value.shape}>"
    return repr(value)


def bare(record: RecordType, values: Mapping[str, Floats]) -> RecordType:
    """Returns a copy of `record` for many runs, whose numbers have the runs as their first axis.

    The copy is for `compile` only, because nothing is checked. A field that is not in `values`
    keeps its value and gets a first axis of length one.
    """
    many = object.__new__(type(record))
    for name, value in record._values().items():
        if name in values:
            value = values[name]
        elif isinstance(value, float | tuple | np.ndarray):
            value = np.asarray(value)[None]
        object.__setattr__(many, name, value)
    return many


def runs_of(
    record: RecordType, values: Mapping[str, Floats], runs: Iterable[int] | None = None
) -> Iterator[RecordType]:
    """Yields the record of each run.

    Args:
        record: The record that all runs share, apart from `values`.
        values: Fields that differ between runs -> (runs, ...).
        runs: Indices of the wanted runs; None yields all.

    Raises:
        ValueError: A run's value breaks a rule; the message names the run.
    """
    for run in range(len(next(iter(values.values())))) if runs is None else runs:
        try:
            yield replace(record, **{name: value[run] for name, value in values.items()})
        except ValueError as error:
            raise ValueError(f"run {run}: {error}") from None


def _rebuild(cls: type[Record], values: dict[str, Any]) -> Record:
    return cls(**values)


@dataclass(frozen=True, eq=False, repr=False)
class Record(Shown):
    """Base class of the parts of a scene.

    Derive with `@dataclass(frozen=True, kw_only=True, eq=False, repr=False)`. Fields that
    `_core.RULES` lists under the class's name are converted to float and validated. None is
    accepted if it is the field's default.
    """

    # Field -> parser, for fields that hold more than numbers and text.
    _parsers: ClassVar[Mapping[str, Parser]] = {}

    def __new__(cls, *args: Any, **values: Any) -> Self:
        """Refuses unknown arguments and suggests the closest field.

        The `__init__` that `dataclass` generates would refuse them too, but without a suggestion.
        """
        if not values.keys() <= cls.__dataclass_fields__.keys():
            _refuse_arguments(cls, values)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Converts and validates the numbers."""
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

    def _values(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __eq__(self, other: object) -> bool:
        """Compares by value, arrays included."""
        if not isinstance(other, Record) or type(other) is not type(self):
            return NotImplemented
        return all(map(_same, self._values().values(), other._values().values()))

    def __hash__(self) -> int:
        """Hashes by value, arrays included."""
        return hash((type(self), *map(_key, self._values().values())))

    def _shown(self) -> Iterator[tuple[str, Any]]:
        """The fields that differ from their defaults."""
        for f in fields(self):
            value = getattr(self, f.name)
            default = f.default_factory() if f.default_factory is not MISSING else f.default
            if not _same(value, default):
                yield f.name, value

    def _tables(self) -> Iterator[ShownTable]:
        """All fields, defaults too."""
        yield ShownTable(("field", "value"), tuple(self._values().items()))

    def __repr__(self) -> str:
        """Shows only the fields that differ from their defaults."""
        shown = ", ".join(f"{name}={_show(value)}" for name, value in self._shown())
        return f"{type(self).__name__}({shown})"

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Prints the repr over several lines, for IPython and Hypothesis."""
        with printer.group(4, f"{type(self).__name__}(", ")"):
            for k, (name, value) in enumerate(self._shown()):
                printer.text("," if k else "")
                printer.breakable(" " if k else "")
                printer.text(f"{name}=")
                if isinstance(value, np.ndarray):
                    printer.text(_show(value))
                else:
                    printer.pretty(value)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles through the constructor, because an unpickled array would be writable."""
        return _rebuild, (type(self), self._values())

    def to_dict(self) -> dict[str, Any]:
        """Converts to a dictionary of numbers, text, lists and dictionaries; omits None fields."""
        return {name: plain(value) for name, value in self._values().items() if value is not None}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Makes a record from the output of `to_dict`. Omitted fields take their defaults.

        Raises:
            ValueError: A name is unknown (the message lists the allowed names and suggests the
                closest), a required field is missing, or a value breaks its rule. The message has
                the place in the data.
            TypeError: A value has the wrong type for its field.
        """
        return cls._parse(data, "")

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        known = fields(cls)
        refuse_unknown(cls.__name__, data, [f.name for f in known], path, cls)
        for f in known:
            if f.name not in data and f.default is MISSING and f.default_factory is MISSING:
                raise ValueError(f"{cls.__name__}.{f.name}{at(path)}: is missing")
        values = {
            name: cls._parsers[name](value, below(path, name)) if name in cls._parsers else value
            for name, value in data.items()
        }
        try:
            return cls(**values)
        except (TypeError, ValueError) as error:
            raise type(error)(f"{error}{at(path)}") from None
