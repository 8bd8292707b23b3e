"""Utilities that every other room imports. They know nothing about grasps or studies.

Values: `checks` (arguments), `record` and `result` (frozen dataclasses), `arrays`, `choices`,
`display`, `suggest` ("did you mean"). Files: `toml`, `table` (CSV and NPZ), `files` (atomic
writes). The process: `errors`, `extras` (imports at the point of use), `interrupt` (Ctrl-C) and
`progress`. No module here imports from another room.
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
