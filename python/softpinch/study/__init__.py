"""Many runs of one scene: what varies, how it is drawn, who computes it, and what came of it.

Draws depend on seed and run alone, so that any run can be computed anywhere and again. Rows come
back in blocks from threads or from workers of an executor. Nothing here writes to a folder.
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
