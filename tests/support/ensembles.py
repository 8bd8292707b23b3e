"""Small ensembles that several tests share, and when two are the same to the bit."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import softpinch as sp
from softpinch import _core, paper
from softpinch.montecarlo import compute
from softpinch.study.compute import Computation
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


def same(a: object, b: object) -> bool:
    a, b = np.asarray(a), np.asarray(b)
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def require_same(first: sp.Ensemble, second: sp.Ensemble, rows: object = slice(None)) -> None:
    """Every column equal, to the bit; `rows` of the first."""
    columns = second.to_dict()
    for name, values in first.to_dict().items():
        if values.dtype.kind in "UO":  # as wide as the longest status; texts
            assert list(values[rows]) == list(columns[name])
        else:
            assert same(values[rows], columns[name]), name


def require_alone(ensemble: sp.Ensemble, run: int) -> sp.Run:
    """The row of a run in the ensemble equals the result of `simulate` for its scene."""
    alone = ensemble.replay(run)
    row = int(np.flatnonzero(ensemble.run == run)[0])
    last = np.concatenate([alone.q[-1], alone.p[-1]])
    assert ensemble.status[row] == alone.status
    assert ensemble.message[row] == alone.message
    assert ensemble.steps[row] == alone.stats["steps"]
    assert ensemble["final_state"][row].tobytes() == last.tobytes()
    seen = {k: t[row] for k, t in ensemble.violations.items() if not np.isnan(t[row])}
    assert seen == alone.violations
    assert ensemble.holds[row] == alone.holds
    assert ensemble.end_time[row] == alone.t[-1]
    if not alone.success:
        assert ensemble.failure_time[row] == alone.t[-1]
    return alone


def computed(spec: StudySpec, store: Path | None = None, **how: Any) -> Any:
    """A study computed, in memory or in a folder."""
    return compute(Computation(spec, progress=False, **how), store)
