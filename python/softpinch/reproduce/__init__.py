"""Reproduction of the paper: its simulations, Figures 4 to 7 and five more, tables, verdicts.

    >>> from pathlib import Path
    >>> from softpinch.reproduce import reproduce
    >>> result = reproduce(Path("results"))  # doctest: +SKIP
    >>> result.show()  # doctest: +SKIP

Figures need the extra `plot`, `show` needs `cli`.
"""

from ..support.files import FORMATS
from .experiment import Progress, Runs, simulate_all
from .report import Reproduction, reproduce
from .verdict import find

__all__ = ["FORMATS", "Progress", "Reproduction", "Runs", "find", "reproduce", "simulate_all"]
