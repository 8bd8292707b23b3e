"""Every public exception and warning, and `warn`, which reports the user's own line of code."""

import sys
import warnings

__all__ = ["LostRunsWarning", "NotRecordedError", "StabilityWarning", "StoreError"]
__all__ += ["SuspiciousValueWarning", "VersionMismatchError"]


class SuspiciousValueWarning(UserWarning):
    """A number is far from its usual range; the message has the field, the value and the range.

    Often the number has the wrong unit: degrees for radians, millimetres for metres. softpinch
    uses the number unchanged. If the number is intended, silence the warning with
    `warnings.simplefilter("ignore", sp.SuspiciousValueWarning)`.
    """


class StabilityWarning(UserWarning):
    """The step is too long for the method to be stable; the message says which step would do."""


class NotRecordedError(AttributeError):
    """The run did not record this quantity; the message says which argument records it."""


class LostRunsWarning(UserWarning):
    """Runs are missing: their workers failed repeatedly, or a study's folder lacks their rows."""


class StoreError(OSError):
    """A study's folder is unwritable, unreadable or damaged; the message has the file and rule."""


class VersionMismatchError(RuntimeError):
    """A worker runs another version of softpinch than the process that submitted the work."""


def warn(text: str, category: type[Warning]) -> None:
    """Issues a warning at the innermost caller outside softpinch, which is the user's line."""
    level = 2
    frame = sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == "softpinch":
        frame = frame.f_back
        level += 1
    warnings.warn(text, category, stacklevel=level)
