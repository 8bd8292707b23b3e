"""What every room stands on, and what knows nothing of grasps.

Checks of arguments, frozen records and results, TOML, errors, files, signals and progress. Nothing
here imports from another room.
"""

from .errors import (
    LostRunsWarning,
    NotRecordedError,
    StabilityWarning,
    StoreError,
    SuspiciousValueWarning,
    VersionMismatchError,
)

__all__ = [
    "LostRunsWarning",
    "NotRecordedError",
    "StabilityWarning",
    "StoreError",
    "SuspiciousValueWarning",
    "VersionMismatchError",
]
