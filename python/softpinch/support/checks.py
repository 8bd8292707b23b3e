"""Conversions and checks of what Python users pass: each refuses with a field, a value and a rule.

The rules for single numbers of a scene live in the Rust core, once: `_core.RULES` names them and
`_core.validate` applies them.
"""

from __future__ import annotations

import math
import operator
import os
import reprlib
from collections.abc import Callable, Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import Floats, read_only

# NumPy's kinds that hold real numbers: integers, floats, and objects such as fractions.
_NUMBERS = "iufO"
_MOST_AXES = 31


def number(name: str, value: object) -> float:
    """`value` as a float, whatever kind of number it is; `name` is what errors call it.

    Raises:
        TypeError: It is no real number. Text is refused although float() takes it: in a scene file
            a quoted number is a slip.
        ValueError: It is an integer too large for a float.
    """
    try:
        given = read(name, value)
        if given.ndim == 0 and given.dtype.kind in _NUMBERS:
            return float(value)  # type: ignore[arg-type]
    except OverflowError:
        raise ValueError(f"{name} = {shown(value)}: must be finite") from None
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{name} = {shown(value)}: must be a number")


def finite(name: str, value: object) -> float:
    """A number that is finite."""
    result = number(name, value)
    if not np.isfinite(result):
        raise ValueError(f"{name} = {result}: must be finite")
    return result


def positive(name: str, value: object) -> float:
    """A number that is finite and above zero."""
    result = number(name, value)
    if not (np.isfinite(result) and result > 0):
        raise ValueError(f"{name} = {result}: must be finite and > 0")
    return result


def non_negative(name: str, value: object) -> float:
    """A number that is finite and not below zero."""
    result = number(name, value)
    if not (np.isfinite(result) and result >= 0):
        raise ValueError(f"{name} = {result}: must be finite and >= 0")
    return result


def not_nan(name: str, value: object) -> float:
    """A number that may be infinite, but not NaN."""
    result = number(name, value)
    if math.isnan(result):
        raise ValueError(f"{name} = {result}: must not be NaN")
    return result


def integer(name: str, value: object, least: int | None = None, most: int | None = None) -> int:
    """An integer that is not below `least` and not above `most`, where these are given."""
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


def several(name: str, value: object, what: str, at_most: int = 1_000_000) -> list[Any]:
    """The things in a sequence or another iterable, as a list; not the letters of a text.

    An iterable may have no end, so a bound ends it.
    """
    if isinstance(value, np.ndarray):
        value = read(name, value)
    try:
        if isinstance(value, str | bytes | Mapping):
            raise TypeError
        things = list(islice(value, at_most + 1))  # type: ignore[call-overload]
    except TypeError:
        raise TypeError(f"{name} = {shown(value)}: must be {what}") from None
    if len(things) > at_most:
        raise ValueError(f"{name}: must be at most {at_most} in number")
    return things


def boolean(name: str, value: object) -> bool:
    """True or False, NumPy's too; nothing else that Python would take for one."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} = {shown(value)}: must be True or False")
    return bool(value)


def share(name: str, value: object) -> float:
    """A number above 0 and below 1."""
    result = finite(name, value)
    if not 0.0 < result < 1.0:
        raise ValueError(f"{name} = {result}: must be above 0 and below 1")
    return result


def function(name: str, value: object) -> None:
    """Refuses what cannot be called."""
    if not callable(value):
        raise TypeError(f"{name} = {shown(value)}: must be a function")


def read(name: str, value: object) -> NDArray[Any]:
    """What a user gave, as an array of whatever it holds: every array is read here.

    Raises:
        TypeError: It is masked. NumPy would drop the mask, and compute with what it hides.
        ValueError: It is ragged.
    """
    parts = value if isinstance(value, list | tuple) else ()
    if any(isinstance(each, np.ma.MaskedArray) for each in (value, *parts)):
        raise TypeError(f"{name}: must not be a masked array; take filled() or compressed() of it")
    try:
        return np.asarray(value)
    except ValueError:
        raise ValueError(f"{name} is ragged: its rows must have the same length") from None


def numbers(name: str, value: object) -> Floats:
    """An array of real numbers as float64, infinite and NaN ones too; not a copy where it is one.

    Raises:
        TypeError: It holds something else. Among objects NumPy would make NaN of None, and numbers
            of text.
        ValueError: It is ragged, or holds an integer too large for a float.
    """
    given = read(name, value)
    kind = given.dtype.kind
    wrong = (kind not in _NUMBERS and given.size > 0) or (
        kind == "O" and any(x is None or isinstance(x, str | bytes | bool) for x in given.flat)
    )
    try:
        if not wrong:
            with np.errstate(over="ignore"):
                return given.astype(np.float64, copy=False)
    except OverflowError:
        raise ValueError(f"{name} = {shown(value)}: must be finite") from None
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{name} = {shown(value)}: must hold numbers")


def array(name: str, value: object, shape: tuple[int | str, ...]) -> Floats:
    """A read-only float64 copy with finite numbers, of the shape (letters: any length above 0).

    Raises:
        TypeError: It holds something else than real numbers.
        ValueError: Its shape is another, or a number is not finite.
    """
    wanted = "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
    given = numbers(name, value)
    if given.ndim != len(shape) or any(
        length != asked if isinstance(asked, int) else length == 0
        for length, asked in zip(given.shape, shape, strict=True)
    ):
        raise ValueError(f"{name} has shape {given.shape}: must have shape {wanted}")
    result = np.array(given)
    require_finite(name, result)
    return read_only(result)


def number_or_array(
    name: str, value: object, check: Callable[[str, object], float]
) -> float | Floats:
    """A number, or a read-only array of numbers, each of which passes the check."""
    given = read(name, value)
    require_few_axes(name, given)
    if given.ndim == 0:
        return check(name, value)
    if given.size == 0:
        raise ValueError(f"{name} has shape {given.shape}: must not be empty")
    each = [check(f"{name}{list(index)}", given[index]) for index in np.ndindex(given.shape)]
    return read_only(np.array(each).reshape(given.shape))


def require_few_axes(name: str, values: ArrayLike) -> None:
    """Refuses what NumPy cannot broadcast: it takes 32 axes, of which draws need one for runs."""
    axes = np.ndim(values)
    if axes > _MOST_AXES:
        raise ValueError(f"{name} has {axes} axes: must have at most {_MOST_AXES}")


def require_finite(name: str, values: Floats) -> None:
    """Refuses values of any shape of which one is not finite; the message has the first."""
    if not np.isfinite(values).all():
        where = tuple(map(int, np.argwhere(~np.isfinite(values))[0]))
        raise ValueError(f"{name}{list(where) or ''} = {values[where]}: must be finite")


def times(name: str, value: object) -> Floats:
    """Finite times (k,) in seconds, each later than the one before it."""
    result = array(name, value, ("k",))
    late = np.flatnonzero(result[1:] <= result[:-1])
    if late.size:
        k = int(late[0]) + 1
        raise ValueError(
            f"{name}[{k}] = {result[k]}: must be greater than the time before it, {result[k - 1]}"
        )
    return result


def same_length(name: str, values: Floats, other: str, length: int) -> None:
    """Refuses `values` whose rows are not one for each of the `other`."""
    if len(values) != length:
        raise ValueError(
            f"{name} has {len(values)} rows: must have one for each of {other}, {length}"
        )


def pair(name: str, value: object) -> tuple[float, float]:
    """Two finite numbers."""
    first, second = array(name, value, (2,)).tolist()
    return first, second


# What errors show of a value.
_repr = reprlib.Repr()
_repr.maxstring = _repr.maxother = _repr.maxlong = 60


def shown(value: object) -> str:
    """A value in an error message: short, however long it is, and printable."""
    if isinstance(value, int) and value.bit_length() > 3000:
        # Python writes out no integer of thousands of digits.
        return f"<integer of {value.bit_length()} bits>"
    try:
        text = _repr.repr(value)
        return " ".join(text.split()) if "\n" in text else text
    except Exception:  # what the repr of a user's object raises says nothing about the value
        return f"<{type(value).__name__}>"


def printable(name: str) -> str:
    """A name out of a file in an error message: one line, short, without control characters."""
    name = name if len(name) <= 60 else f"{name[:57]}..."
    return name if name.isprintable() else repr(name)


def path(name: str, value: object, what: str = "a path") -> Path:
    """A path, from text or what stands for a path, such as a `pathlib.Path`.

    Raises:
        TypeError: It is neither.
        ValueError: It is empty, or has a character that no path can have.
    """
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str):
        raise TypeError(f"{name} = {shown(value)}: must be {what}, as text or an os.PathLike")
    if len(text) > 4096:
        raise ValueError(f"{name} has {len(text)} characters: no path has more than 4096")
    if not text:
        # For Python this is the folder one is in.
        raise ValueError(f"{name} is empty: must be {what}")
    try:
        possible = b"\0" not in os.fsencode(text)
    except UnicodeEncodeError:
        possible = False
    if not possible:
        raise ValueError(f"{name} = {shown(text)}: must be {what}; no path has such a character")
    return Path(text)


def instance(name: str, value: object, cls: type[object], kind: str = "") -> None:
    """Refuses what is no `cls`; `kind` is what users call it, where that is not its name."""
    if not isinstance(value, cls):
        raise TypeError(f"{name} = {shown(value)}: must be {kind or f'a {cls.__name__}'}")


def choice(name: str, value: object, allowed: Iterable[str]) -> str:
    """One of the allowed names, or an error with all of them and the closest."""
    allowed = tuple(allowed)
    if not isinstance(value, str):
        raise TypeError(f"{name} = {shown(value)}: must be one of {quoted(allowed)}")
    if value not in allowed:
        raise ValueError(
            f"{name} = {shown(value)}: must be one of {quoted(allowed)}{hint(value, allowed)}"
        )
    return value


def quoted(names: Iterable[str]) -> str:
    """The names in quotes, with commas."""
    return ", ".join(f'"{name}"' for name in names)


def hint(name: str, allowed: Iterable[str]) -> str:
    """'; did you mean "..."?' where one is close."""
    if len(name) > 100:  # no slip of the finger, and slow to compare
        return ""
    import difflib  # only an error needs it

    close = difflib.get_close_matches(name, list(allowed), n=1, cutoff=0.5)
    return f'; did you mean "{close[0]}"?' if close else ""


def refuse_unknown(
    owner: str,
    data: object,
    allowed: Iterable[str],
    path: str,
    cls: type[Any] | None = None,
) -> None:
    """Refuses what is no mapping with names out of `allowed`, the fields of `cls` perhaps."""
    if not isinstance(data, Mapping):
        raise TypeError(f"{owner}{at(path)} = {shown(data)}: must be a table")
    allowed = tuple(allowed)
    for name in data:
        if not isinstance(name, str):
            raise TypeError(f"{owner}{at(path)}: {shown(name)}: names must be text")
        if name not in allowed:
            raise ValueError(
                f"{owner}.{printable(name)}{at(path)}: unknown name; must be one of "
                f"{quoted(allowed)}{_hint_of(name, allowed, path, cls)}"
            )


def _hint_of(name: str, allowed: Iterable[str], path: str, cls: type[Any] | None) -> str:
    if cls is None:
        return hint(name, allowed)
    from . import suggest  # only an error needs it

    return suggest.hint(name, cls, path)


def at(path: str) -> str:
    """' (in hand.right)', or nothing at the top."""
    return f" (in {path})" if path else ""


def below(path: str, name: str | int) -> str:
    """The path one step further down."""
    return f"{path}.{name}" if path else str(name)
