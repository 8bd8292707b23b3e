"""Reference trajectories from SciPy and the null-space form, independent of the core's mechanics.

    >>> from softpinch import reference
    >>> exact = reference.confirmed(scene, times)  # needs SciPy, of the extra `study`
    >>> exact.own_error
    {'q': 3.1e-12, 'p': 8.6e-12, 'multipliers': 2.9e-12}

`right_hand_side` implements (5), (7)-(12), (16), (25), (39), (44) and (45) a second time, in
Python; tests/accuracy/test_reference.py compares it with SymPy's derivation. Violations are not
monitored: the integration continues where the model no longer holds.
"""

from .accuracy.null_space import PARAMETERS, Equations, parameters, right_hand_side
from .accuracy.reference import Reference, confirmed, solve
from .accuracy.segments import METHODS

__all__ = ["METHODS", "PARAMETERS", "Equations", "Reference", "confirmed", "parameters"]
__all__ += ["right_hand_side", "solve"]
