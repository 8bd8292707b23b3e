"""Utilities that every other room imports. They know nothing about grasps or studies.

Values: `checks` (arguments), `record`, `kinds` and `result` (frozen dataclasses), `arrays`,
`suggest` ("did you mean"). Files: `toml`, `table` (CSV and NPZ), `files`, `disk` (atomic writes),
`formats` (figures). The process: `errors`, `extras` (optional imports), `interrupt` (signals) and
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
