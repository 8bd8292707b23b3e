"""Many runs of one scene: distributions, draws, computation, results and statistics.

The draws of a run depend only on the seed and the run's number, so any process can compute any run
again. Threads or the workers of an executor return rows in blocks. Nothing here writes to a folder.
"""

from typing import TYPE_CHECKING

from ..support.lazy import lazily

if TYPE_CHECKING:
    from .capsule import Capsule
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
    from .estimates import Discretisation, Estimate, Mean
    from .gradients import Gradients
    from .outcome import Lost
    from .results import Ensemble, Results
else:
    __getattr__ = lazily(
        __name__,
        {
            "capsule": ("Capsule",),
            "distributions": (
                "Choice",
                "Distribution",
                "LogNormal",
                "LogUniform",
                "Normal",
                "TruncatedNormal",
                "Uniform",
            ),
            "effects": ("Effect", "sensitivity"),
            "estimates": ("Discretisation", "Estimate", "Mean"),
            "gradients": ("Gradients",),
            "outcome": ("Lost",),
            "results": ("Ensemble", "Results"),
        },
    )

__all__ = [
    "Capsule",
    "Choice",
    "Discretisation",
    "Distribution",
    "Effect",
    "Ensemble",
    "Estimate",
    "Gradients",
    "LogNormal",
    "LogUniform",
    "Lost",
    "Mean",
    "Normal",
    "Results",
    "TruncatedNormal",
    "Uniform",
    "sensitivity",
]
