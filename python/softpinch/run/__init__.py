"""One run of a scene: computing it, and judging its accuracy.

Validated `options` and a scene make a `request`, which calls the core for all rooms above: these
take `Options`, `Request` and `computed` from here, beside the public names.
"""

from .contact import ContactChange, ContactMode
from .error_estimate import ErrorEstimate
from .evaluate import Energies, Evaluation, Forces, evaluate
from .explanation import Explanation, Term, explain
from .ledger import EnergyLedger
from .options import Options as Options
from .request import Request as Request
from .run import Run
from .run import computed as computed
from .sensitivity import Sensitivity, SensitivityState
from .simulate import simulate

__all__ = ["ContactChange", "ContactMode", "Energies", "EnergyLedger", "ErrorEstimate"]
__all__ += ["Evaluation", "Explanation", "Forces", "Run", "Sensitivity", "SensitivityState", "Term"]
__all__ += ["evaluate", "explain", "simulate"]
