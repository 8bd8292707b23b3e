"""Trajectories to compare with: SciPy on the null-space form, none of the Rust core's mechanics.

    >>> from softpinch import reference
    >>> exact = reference.confirmed(scene, times)  # needs SciPy, of the extra `study`
    >>> exact.own_error
    {'q': 3.1e-12, 'p': 8.6e-12, 'multipliers': 2.9e-12}

The equations are `right_hand_side`'s, typed in once more from (5), (7)-(12), (16), (25), (39), (44)
and (45); tests/accuracy/test_reference.py compares them with what SymPy derives. Nothing is
monitored: the motion goes on where the model has stopped holding.
"""

from __future__ import annotations

from .accuracy.integrate import METHODS
from .accuracy.null_space import PARAMETERS, Equations, parameters, right_hand_side
from .accuracy.reference import Reference, confirmed, solve

__all__ = [
    "METHODS",
    "PARAMETERS",
    "Equations",
    "Reference",
    "confirmed",
    "parameters",
    "right_hand_side",
    "solve",
]
