"""Small ensembles that several tests share."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import softpinch as sp
from softpinch import _core, paper
from softpinch.montecarlo import compute
from softpinch.study.job import Job
from softpinch.study.spec import StudySpec

SUMMARIES = ("final_state", *_core.SUMMARIES)


@cache
def pushed(runs: int = 300) -> sp.Ensemble:
    """Disturbance (ii), pushed so hard that some grasps are lost."""
    return sp.monte_carlo(
        paper.disturbance("ii", duration=1.1),
        runs,
        seed=7,
        dt=5e-4,
        vary={
            "grasped.mass": sp.Normal(0.1, 0.01),
            "disturbances.0.force": sp.Uniform((-400.0, -400.0), (400.0, 400.0)),
            "schedule.angles": sp.Uniform(0.1, 0.11),
        },
        summaries=SUMMARIES,
        summaries_after=1.0,
        progress=False,
    )


@cache
def calm() -> sp.Ensemble:
    """A few short grasps that all hold, one number a run of their own."""
    return sp.monte_carlo(
        sp.Scene(duration=0.05),
        vary={"grasped.mass": np.linspace(0.09, 0.11, 20)},
        dt=1e-3,
        summaries=("peak_rotation", "settling_time"),
        progress=False,
    )


def computed(spec: StudySpec, store: Path | None = None, **how: Any) -> Any:
    """A study computed, in memory or in a folder."""
    return compute(Job.checked(spec, progress=False, **how), store)
