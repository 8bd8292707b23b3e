"""Conversions and checks of user arguments. Each error names the field, the value and the rule.

The rules for single numbers of a scene are defined only in the Rust core: `_core.RULES` lists them
and `_core.validate` applies them. `name` is always the argument's name in error messages.
"""

import math
import operator
import os
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .arrays import Floats, read_only

# NumPy dtype kinds that can hold real numbers: integers, floats, and objects such as fractions.
_NUMBERS = "iufO"
# A name out of a table; a literal type where the table has one.
Name = TypeVar("Name", bound=str)


def number(name: str, value: object) -> float:
    """Converts any kind of real number, but no text, to a float, which may be infinite or NaN."""
    try:
        given = read(name, value)
        if given.ndim == 0 and given.dtype.kind in _NUMBERS:
            return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{name} = {shown(value)}: must be a number")


def number_that(name: str, value: object, holds: Callable[[float], bool], rule: str) -> float:
    """Converts a number for which `holds` is true to a float; `rule` says in the error which."""
    result = number(name, value)
    if not holds(result):
        raise ValueError(f"{name} = {result}: {rule}")
    return result


def _rule(holds: Callable[[float], bool], rule: str) -> Callable[[str, object], float]:
    return lambda name, value: number_that(name, value, holds, rule)


finite = _rule(math.isfinite, "must be finite")
positive = _rule(lambda x: 0.0 < x < math.inf, "must be finite and > 0")
non_negative = _rule(lambda x: 0.0 <= x < math.inf, "must be finite and >= 0")
not_nan = _rule(lambda x: not math.isnan(x), "must not be NaN")
share = _rule(lambda x: 0.0 < x < 1.0, "must be above 0 and below 1")


def integer(name: str, value: object, least: int | None = None, most: int | None = None) -> int:
    """Converts an integer from `least` to `most`, if these are given. Refuses booleans."""
    try:
        if isinstance(value, bool | np.bool_):
            raise TypeError
        result = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(f"{name} = {shown(value)}: must be an integer") from None
    if least is not None and result < least:
        raise ValueError(f"{name} = {shown(result)}: must be at least {least}")
    if most is not None and result > most:
        raise ValueError(f"{name} = {shown(result)}: must be at most {most}")
    return result


# The most entries of an argument, because an iterable may be infinite.
_LONGEST = 1_000_000


def several(name: str, value: object, what: str) -> list[Any]:
    """Converts an iterable to a list; refuses text, mappings and endless ones: "must be `what`"."""
    if isinstance(value, np.ndarray):
        value = read(name, value)
    try:
        # An ensemble would be iterated by __getitem__, which takes names.
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
            raise TypeError
        things = list(islice(value, _LONGEST + 1))
    except TypeError:
        raise TypeError(f"{name} = {shown(value)}: must be {what}") from None
    if len(things) > _LONGEST:
        raise ValueError(f"{name}: must have at most {_LONGEST} entries")
    return things


def boolean(name: str, value: object) -> bool:
    """Converts a Python or NumPy boolean to bool. Refuses other values, truthy or not."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} = {shown(value)}: must be True or False")
    return bool(value)


def function(name: str, value: object) -> None:
    """Refuses a value that is not callable."""
    if not callable(value):
        raise TypeError(f"{name} = {shown(value)}: must be a function")


def read(name: str, value: object) -> NDArray[Any]:
    """Converts a value to an array of any dtype; refuses a mask, which NumPy would drop."""
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{name}: must not be a masked array; take filled() or compressed() of it")
    try:
        return np.asarray(value)
    except ValueError:
        raise ValueError(f"{name} is ragged: its rows must have the same length") from None


def numbers(name: str, value: object) -> Floats:
    """Converts real numbers to float64 (not copied); refuses None and text, unlike NumPy."""
    given = read(name, value)
    kind = given.dtype.kind
    wrong = (kind not in _NUMBERS and given.size > 0) or (
        kind == "O" and any(x is None or isinstance(x, str | bytes | bool) for x in given.flat)
    )
    try:
        if not wrong:
            with np.errstate(over="ignore"):
                return given.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{name} = {shown(value)}: must hold numbers")


def array(name: str, value: object, shape: tuple[int | str, ...], meaning: str = "") -> Floats:
    """Converts finite numbers to a read-only copy; a letter in `shape` is any length above 0."""
    wanted = "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
    given = numbers(name, value)
    if given.ndim != len(shape) or any(
        length != asked if isinstance(asked, int) else length == 0
        for length, asked in zip(given.shape, shape, strict=True)
    ):
        rule = f"must have shape {wanted}{meaning and ', '}{meaning}"
        rule += " and must not be empty" if 0 in given.shape else ""
        raise ValueError(f"{name} has shape {given.shape}: {rule}")
    result = np.array(given)
    require_finite(name, result)
    return read_only(result)


def number_or_array(
    name: str, value: object, check: Callable[[str, object], float]
) -> float | Floats:
    """Applies `check` to a number, or to each entry of an array and returns a read-only array."""
    given = read(name, value)
    if given.ndim == 0:
        return check(name, value)
    if given.size == 0:
        raise ValueError(f"{name} has shape {given.shape}: must not be empty")
    each = [check(f"{name}{list(index)}", given[index]) for index in np.ndindex(given.shape)]
    return read_only(np.array(each).reshape(given.shape))


def require_finite(name: str, values: Floats) -> None:
    """Refuses an array of any shape with a non-finite entry; the message names the first one."""
    if not np.isfinite(values).all():
        where = tuple(map(int, np.argwhere(~np.isfinite(values))[0]))
        raise ValueError(f"{name}{list(where) or ''} = {values[where]}: must be finite")


def increasing(name: str, value: object, what: str = "value") -> Floats:
    """Converts finite, strictly increasing numbers (k,) to a read-only array."""
    result = array(name, value, ("k",))
    late = np.flatnonzero(result[1:] <= result[:-1])
    if late.size:
        k = int(late[0]) + 1
        rule = f"must be greater than the {what} before it, {result[k - 1]}"
        raise ValueError(f"{name}[{k}] = {result[k]}: {rule}")
    return result


def times(name: str, value: object) -> Floats:
    """Converts finite, strictly increasing times (k,), s, to a read-only array."""
    return increasing(name, value, "time")


def same_length(name: str, values: Floats, other: str, length: int) -> None:
    """Refuses `values` without exactly `length` rows, one for each entry of `other`."""
    if len(values) != length:
        rule = f"must have one for each of {other}, {length}"
        raise ValueError(f"{name} has {len(values)} rows: {rule}")


def pair(name: str, value: object) -> tuple[float, float]:
    """Converts two finite numbers to a tuple of floats."""
    first, second = array(name, value, (2,), "a pair of numbers").tolist()
    return first, second


# Shortens values in error messages.
_repr = reprlib.Repr()
_repr.maxstring = _repr.maxother = _repr.maxlong = 60


def shown(value: object) -> str:
    """Returns a short text for a value of any size, on one line, for an error message."""
    return " ".join(_repr.repr(value).split())


def path(name: str, value: object, what: str = "a path") -> Path:
    """Converts text or an `os.PathLike` of text to a path. Errors say that it must be `what`."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str):
        raise TypeError(f"{name} = {shown(value)}: must be {what}, as text or an os.PathLike")
    if not text:
        # pathlib would read an empty path as the current folder.
        raise ValueError(f"{name} is empty: must be {what}")
    return Path(text)


def instance(
    name: str, value: object, cls: type[object] | tuple[type[object], ...], kind: str = ""
) -> None:
    """Refuses a value that is no `cls`, named `kind`; of a result, the error says what to pass."""
    if isinstance(value, cls):
        return
    part, hint = name.rpartition(".")[2], ""
    first = cls[0] if isinstance(cls, tuple) else cls
    with suppress(ValueError):  # a fit to several experiments has no single scene
        if isinstance(getattr(value, part, None), cls):
            hint = f"; pass its .{part}"
    raise TypeError(f"{name} = {shown(value)}: must be {kind or f'a {first.__name__}'}{hint}")


def choice(name: str, value: object, allowed: Iterable[Name]) -> Name:
    """Returns one of the allowed names. The error lists them all and suggests the closest."""
    allowed = tuple(allowed)
    if not isinstance(value, str):
        raise TypeError(f"{name} = {shown(value)}: must be one of {quoted(allowed)}")
    if value not in allowed:
        rule = f"must be one of {quoted(allowed)}{hint(value, allowed)}"
        raise ValueError(f"{name} = {shown(value)}: {rule}")
    return value


def names(name: str, value: object, allowed: Iterable[str]) -> tuple[str, ...]:
    """Returns one name or several out of the allowed ones, in their order and each once."""
    given = (value,) if isinstance(value, str) else value
    if not isinstance(given, tuple | list) or not given:
        error = ValueError if isinstance(given, tuple | list) else TypeError
        raise error(f"{name} = {shown(value)}: must be names out of {quoted(allowed)}")
    found = tuple(choice(f"{name}[{k}]", one, allowed) for k, one in enumerate(given))
    for one in found:
        if found.count(one) > 1:
            raise ValueError(f'{name}: "{one}" is there more than once')
    return found


def quoted(names: Iterable[str]) -> str:
    """Joins the names, each in quotes, with commas."""
    return ", ".join(f'"{name}"' for name in names)


def hint(name: str, allowed: Iterable[str]) -> str:
    """Returns '; did you mean "..."?' if an allowed name is close, otherwise an empty text."""
    import difflib  # only an error needs it

    close = difflib.get_close_matches(name, list(allowed), n=1, cutoff=0.5)
    return f'; did you mean "{close[0]}"?' if close else ""


@contextmanager
def reworded(
    before: str = "", after: str = "", drop: str = "", kind: type[Exception] | None = None
) -> Iterator[None]:
    """Adds the place of a wrong value to its error, without the error's beginning `drop`."""
    try:
        yield
    except (TypeError, ValueError) as error:
        text = f"{before}{str(error).removeprefix(drop)}{after}"
        raise (kind or type(error))(text) from None


def refuse_unknown(
    owner: str,
    data: object,
    allowed: Iterable[str],
    path: str,
    cls: type[Any] | None = None,
    needed: Iterable[str] = (),
) -> None:
    """Refuses data that is no mapping, has a name that is not allowed, or lacks a needed one."""
    if not isinstance(data, Mapping):
        raise TypeError(f"{owner}{at(path)} = {shown(data)}: must be a table")
    allowed = tuple(allowed)
    for name in data:
        if name not in allowed:
            from . import suggest  # only an error needs it

            close = suggest.hint(name, cls, path) if cls else hint(name, allowed)
            rule = f"must be one of {quoted(allowed)}{close}"
            raise ValueError(f"{owner}.{name}{at(path)}: unknown name; {rule}")
    for name in needed:
        if name not in data:
            raise ValueError(f"{owner}.{name}{at(path)}: is missing")


def at(path: str) -> str:
    """Returns a path as ' (in hand.right)' for an error message, or '' at the top level."""
    return f" (in {path})" if path else ""


def below(path: str, name: str | int) -> str:
    """Appends a name or an index to a dotted path."""
    return f"{path}.{name}" if path else str(name)
