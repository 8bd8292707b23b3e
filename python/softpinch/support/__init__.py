"""Utilities that every other room imports. They know nothing about grasps or studies.

Values: `checks` (arguments), `record` and `result` (frozen dataclasses), `arrays`, `choices`,
`display`, `suggest` ("did you mean"). Files: `toml`, `table` (CSV and NPZ), `files` (atomic
writes). The process: `errors`, `extras` (imports at the point of use), `interrupt` (Ctrl-C) and
`progress`. No module here imports from another room. Other rooms import the names below from here.
"""

from . import errors
from .arrays import Bools, Complexes, Floats, Texts, read_only
from .choices import ContactModel, Fingers, Formulation, Hold, Method, Recordable, Violation
from .display import Shown, ShownTable, text_of
from .errors import *
from .errors import warn
from .extras import require
from .progress import Report, reporting
from .record import SIDES, Kinded, Record, plain
from .result import ByValue, Result
from .table import Table, read_csv, save_csv, save_map, save_npz

__all__ = ["SIDES", "Bools", "ByValue", "Complexes", "ContactModel", "Fingers", "Floats"]
__all__ += ["Formulation", "Hold", "Kinded", "Method", "Record", "Recordable", "Report", "Result"]
__all__ += ["Shown", "ShownTable", "Table", "Texts", "Violation", "plain", "read_csv", "read_only"]
__all__ += ["reporting", "require", "save_csv", "save_map", "save_npz", "text_of", "warn"]
__all__ += errors.__all__
