"""The modes of the contacts of a run, and their changes."""

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..support.arrays import Floats

Modes: TypeAlias = NDArray[np.uint8]


class ContactMode(IntEnum):
    """The mode of a tip, which is free, sticks, slips or grazes (touches without a force)."""

    FREE = 0
    STICK = 1
    SLIP = 2
    GRAZE = 3


class ContactChange(NamedTuple):
    """A change of a contact's mode: time in s, "right" or "left", the modes before and after."""

    time: float
    finger: str
    before: ContactMode
    after: ContactMode

    @property
    def sensitivity(self) -> Mapping[str, Floats]:
        """Path -> the derivatives of the time, in a run with `sensitivities`; else empty.

        They have the shape of the value at the path, and are NaN where they do not exist.
        """
        return getattr(self, "_by_path", {})


class DifferentiatedChange(ContactChange):
    """A change in a run with `sensitivities`."""

    _by_path: Mapping[str, Floats]


def active(modes: Modes | None, rows: int) -> NDArray[np.bool_]:
    """Returns which of C^H and C^N constrain the motion (rows, 4): all without modes (rows, 2)."""
    if modes is None:
        return np.ones((rows, 4), dtype=bool)
    return np.hstack([modes != ContactMode.FREE, modes == ContactMode.STICK])


def grazes(contacts: Floats) -> NDArray[np.bool_]:
    """Returns the rows (n,) of contacts (n, 4) in which a tip grazes."""
    return np.asarray((_modes(contacts) == ContactMode.GRAZE).any(axis=1))


def _modes(contacts: Floats) -> Modes:
    # The sign of a code is the direction of a slip; 4 is graze while the face moves.
    return np.minimum(np.abs(contacts[:, :2]), ContactMode.GRAZE).astype(np.uint8)


def known_modes(result: Mapping[str, Any]) -> Modes | None:
    """Returns the modes of all rows (n, 2), or of the last (1, 2); None in bilateral contact."""
    last = result["final"]["contacts"]
    if last is None:
        return None
    codes = last[None] if result["contacts"] is None else result["contacts"]
    recorded: Modes | None = result["contact"]
    return _modes(codes) if recorded is None else recorded
