"""The model again, by SymPy and SciPy, to compare with: it shares nothing with the core."""

from .evaluate import Oracle, Quantity, evaluate, parameters
from .lagrangian import PARAMETERS, SIDES, compiled, magnitude, model, vanishes
from .trajectory import Reference, error, reference

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
