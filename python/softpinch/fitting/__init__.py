"""Fitting numbers of a scene to measured motions, with errors, and with what cannot be known.

A `problem` of several `experiment`s is solved by `search`, which makes a `result`.
"""

from .law import LawFit, fit_law
from .result import Fit
from .search import fit

__all__ = ["Fit", "LawFit", "fit", "fit_law"]
