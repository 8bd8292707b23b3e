"""The modes of the contacts of a run, and their changes."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class ContactMode(IntEnum):
    """What a tip does: it is free, sticks, slips or grazes (touches without a force)."""

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
