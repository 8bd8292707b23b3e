"""A study in a folder
===================

A study that is stopped in the middle, read, and continued by two processes::

    python examples/04_a_study_that_is_kept.py [kept.png]

The script stores rows as they are computed and reads the rows of a study that was stopped. It
continues the study on other workers with the same bits, computes statistics part by part, repeats a
failed run from its capsule, and reads the rows in pandas.
"""

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd

import softpinch as sp

RUNS = 8000


def begin(folder: Path) -> sp.Study:
    """Computes the first third of the study, until a simulated Ctrl-C."""

    def ctrl_c(done: int, runs: int) -> None:
        if done > runs // 3:
            raise KeyboardInterrupt

    return sp.monte_carlo(
        sp.paper.disturbance("ii", duration=1.5),
        runs=RUNS,
        seed=7,
        dt=2e-4,
        vary={
            "grasped.mass": sp.Normal(0.1, 0.01),
            "disturbances.0.force": sp.Uniform((-300.0, -300.0), (300.0, 300.0)),
        },
        summaries="peak_rotation",
        summaries_after=1.0,
        store=folder,
        progress=ctrl_c,
    )


# Spawned processes import this file, and must not begin a study of their own.
if __name__ == "__main__":
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "kept.png")
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "study"
        study = begin(folder)
        print(study.interruption)
        print(f"{study}; so far, by {study.model}, it holds with {study.probability('holds')}")

        # A pool that a function makes is shut down at the end; a cluster's executor works, too.
        study.resume(executor=lambda: ProcessPoolExecutor(2, mp_context=get_context("spawn")))
        study = sp.Study.open(folder)  # any process can; it warns where runs are missing
        print(f"{study}; by {study.model}, it holds with {study.probability('holds')}")

        turned = study.mean("peak_rotation")
        most = np.rad2deg(study.quantile("peak_rotation", 0.95))
        print(f"peak rotation, rad: {turned} in the mean; 95 % stay below {most:.3g} degrees")

        lost = study.failures()[0]
        print(f"run {lost.run} again ends alike: {lost.agrees(lost.replay(record='state'))}")

        rows = pd.read_parquet(folder / "parts")
        print(rows.groupby("status")["grasped.mass"].agg(["count", "mean"]))
        figure = sp.plot.success_map(study, "disturbances.0.force.0", "disturbances.0.force.1")
        print("saved", sp.plot.save(figure, out))
