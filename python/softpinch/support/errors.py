"""Every exception and warning that users meet by name, and how a warning finds their line."""

from __future__ import annotations

import sys
import warnings


class SuspiciousValueWarning(UserWarning):
    """A number is far from what is usual; the message has its field, its value and the range.

    Often it was given in another unit: degrees for radians, millimetres for metres. Nothing is
    changed or refused. To silence it where the number is meant:
    `warnings.simplefilter("ignore", sp.SuspiciousValueWarning)`.
    """


class StabilityWarning(UserWarning):
    """The step is beyond what the method damps; the message has what would do."""


class NotRecordedError(AttributeError):
    """The run was not asked to record this; the message says how to ask."""


class LostRunsWarning(UserWarning):
    """Runs could not be computed: their workers failed, again and again."""


class StoreError(OSError):
    """A study's folder cannot be written or read, or is damaged; the message has file and rule."""


class VersionMismatchError(RuntimeError):
    """A worker has another softpinch than the process that sent it work."""


def warn(text: str, category: type[Warning]) -> None:
    """Warns at the line outside of softpinch from which it was called."""
    level = 2
    frame = sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == "softpinch":
        frame = frame.f_back
        level += 1
    warnings.warn(text, category, stacklevel=level)
