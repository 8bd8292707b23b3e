"""The equations of motion again, derived by SymPy from geometry and energies, to compare with."""

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
