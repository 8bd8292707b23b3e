"""One run: its options, the run itself, and whether it can be believed.

`simulate` checks, calls the core and returns a `Run`. Beside it are the forces and energies of one
state, the invariants that a run keeps, its error estimate, and what a scene compiles to.
"""

from typing import TYPE_CHECKING

from ..support.lazy import lazily
from .error_estimate import ErrorEstimate
from .evaluate import Energies, Evaluation, Forces, evaluate
from .run import EnergyLedger, Run
from .simulate import simulate

if TYPE_CHECKING:
    from .explanation import Explanation, Term, explain
else:
    __getattr__ = lazily(
        __name__,
        {"explanation": ("Explanation", "Term", "explain")},
    )

__all__ = [
    "Energies",
    "EnergyLedger",
    "ErrorEstimate",
    "Evaluation",
    "Explanation",
    "Forces",
    "Run",
    "Term",
    "evaluate",
    "explain",
    "simulate",
]
