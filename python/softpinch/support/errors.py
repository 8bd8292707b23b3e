"""Every exception and warning that users meet by name."""

from __future__ import annotations


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
