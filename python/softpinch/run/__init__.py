"""One run of a scene: computing it, and judging its accuracy.

`simulate` validates its arguments with `options`, calls the core and returns a `run.Run`. `check`
tests a run's invariants, `error_estimate` compares it with finer runs, and `scaled_error` defines
"error" for every report. `evaluate` has every term of the equations at one state, `measures` has
quantities derived from runs, and `sensitivity` the derivatives of runs. `explanation` says what a
scene compiles to. `request` calls the core.
"""

from .contact import ContactChange, ContactMode
from .error_estimate import ErrorEstimate
from .evaluate import Energies, Evaluation, Forces, evaluate
from .explanation import Explanation, Term, explain
from .ledger import EnergyLedger
from .run import Run
from .sensitivity import Sensitivity, SensitivityState
from .simulate import simulate

__all__ = [
    "ContactChange",
    "ContactMode",
    "Energies",
    "EnergyLedger",
    "ErrorEstimate",
    "Evaluation",
    "Explanation",
    "Forces",
    "Run",
    "Sensitivity",
    "SensitivityState",
    "Term",
    "evaluate",
    "explain",
    "simulate",
]
