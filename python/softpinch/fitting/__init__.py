"""Fitting numbers of a scene to measured motions, with errors, and with what cannot be known.

`search` has the function `fit`, and `result` what it returns. `observables` names what can be
measured, `parameters` scales the numbers that are fitted, `experiment` simulates a motion at the
measured instants, with derivatives, and `problem` makes weighted residuals of several of them for
SciPy. `uncertainty` says how far the data determine the parameters, and `profile` follows the
profile likelihood of one. `fit_file` reads the files of `softpinch fit`.
"""

from typing import TYPE_CHECKING

from ..support.lazy import lazily

if TYPE_CHECKING:
    from .result import Fit
    from .search import fit
else:
    __getattr__ = lazily(__name__, {"result": ("Fit",), "search": ("fit",)})

__all__ = ["Fit", "fit"]
