"""The paper's simulation, end to end: every run, Figures 4 to 7 and two more, tables, verdicts.

    >>> from pathlib import Path
    >>> from softpinch.reproduce import reproduce
    >>> result = reproduce(Path("results"))  # doctest: +SKIP
    >>> result.show()  # doctest: +SKIP

Needs the extra `plot` for the figures, and `cli` for `show`.
"""

from ..support.formats import FORMATS
from .experiment import Progress, Runs, simulate_all
from .reproduction import Reproduction, reproduce
from .verdict import find

__all__ = [
    "FORMATS",
    "Progress",
    "Reproduction",
    "Runs",
    "find",
    "reproduce",
    "simulate_all",
]
