"""The model again, from SymPy and SciPy: what tests compare with. It shares nothing with the core."""

from .evaluate import Oracle, Quantity, evaluate
from .lagrangian import PARAMETERS, SIDES, compiled, magnitude, model, vanishes
from .trajectory import Reference, error, parameters, reference

__all__ = [
    "PARAMETERS",
    "SIDES",
    "Oracle",
    "Quantity",
    "Reference",
    "compiled",
    "error",
    "evaluate",
    "magnitude",
    "model",
    "parameters",
    "reference",
    "vanishes",
]
