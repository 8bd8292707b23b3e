"""Fitting numbers of a scene to measured motions, with errors, and with what cannot be known.

`search` has the function `fit`, and `result` its return value, with the uncertainty of the numbers.
`experiment` names what can be measured and simulates a motion at the measured instants, with
derivatives; `problem` scales the fitted numbers and makes weighted residuals of several experiments
for SciPy. `law` fits the law of a tip to a measured curve. `fit_file` reads the files of `softpinch
fit`.
"""

from .law import LawFit, fit_law
from .result import Fit
from .search import fit

__all__ = ["Fit", "LawFit", "fit", "fit_law"]
