"""The equations of motion again, derived by SymPy from geometry and energies, to compare with."""

from .contact import unilateral
from .contact_walk import Change, UnilateralReference
from .evaluate import Oracle, Quantity, evaluate, parameters
from .lagrangian import PARAMETERS, SIDES, compiled, magnitude, model, vanishes
from .trajectory import Reference, error, reference

__all__ = [
    "PARAMETERS",
    "SIDES",
    "Change",
    "Oracle",
    "Quantity",
    "Reference",
    "UnilateralReference",
    "compiled",
    "error",
    "evaluate",
    "magnitude",
    "model",
    "parameters",
    "reference",
    "unilateral",
    "vanishes",
]
