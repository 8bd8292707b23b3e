"""Many runs of one scene: distributions, draws, computation, results and statistics.

The draws of a run depend only on the seed and the run's number, so any process can compute any run
again. Threads or the workers of an executor return rows in blocks. Nothing here writes to a folder.
"""

from .capsule import Capsule
from .comparison import Comparison, compare
from .distributions import (
    Choice,
    Distribution,
    LogNormal,
    LogUniform,
    Normal,
    TruncatedNormal,
    Uniform,
)
from .effects import Effect, sensitivity
from .engine import Lost
from .estimates import Discretisation, Estimate, Mean
from .gradients import Gradients
from .results import Ensemble, Results
from .subset import Level

__all__ = ["Capsule", "Choice", "Comparison", "Discretisation", "Distribution", "Effect"]
__all__ += ["Ensemble", "Estimate", "Gradients", "Level", "LogNormal", "LogUniform", "Lost", "Mean"]
__all__ += ["Normal", "Results", "TruncatedNormal", "Uniform", "compare", "sensitivity"]
