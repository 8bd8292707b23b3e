"""One run of a scene: computing it, and judging its accuracy.

Validated `options` and a scene make a `request`, which calls the core for all rooms above.
"""

from .contact import ContactChange, ContactMode
from .error_estimate import ErrorEstimate
from .evaluate import Energies, Evaluation, Forces, evaluate
from .explanation import Explanation, Term, explain
from .ledger import EnergyLedger
from .run import Run
from .sensitivity import Sensitivity, SensitivityState
from .simulate import simulate

__all__ = ["ContactChange", "ContactMode", "Energies", "EnergyLedger", "ErrorEstimate"]
__all__ += ["Evaluation", "Explanation", "Forces", "Run", "Sensitivity", "SensitivityState", "Term"]
__all__ += ["evaluate", "explain", "simulate"]
