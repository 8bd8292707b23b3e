"""The paper's scenes with tips that only push: words and tables follow from the runs."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch import paper
from softpinch.reproduce import experiment, simulate_all
from softpinch.reproduce import verdict as v
from softpinch.reproduce.experiment import FRICTIONS, Runs
from softpinch.reproduce.report import contact_table
from softpinch.support.table import Table


@pytest.fixture(scope="module")
def runs() -> Runs:
    return simulate_all(1e-4)


@pytest.fixture(scope="module")
def table(runs: Runs) -> Table:
    return contact_table(runs)


def columns(table: Table, name: str) -> np.ndarray:
    """The columns of a quantity (12, models)."""
    chosen = [k for k, header in enumerate(table.columns) if header.startswith(f"{name},")]
    return np.array([[row[k] for k in chosen] for row in table.rows])


def test_operations_end_in_the_table_where_they_end_in_the_runs(table: Table, runs: Runs) -> None:
    theta, y = columns(table, "theta [deg]")[:8], columns(table, "y [mm]")[:8]
    for k, run in enumerate((runs.operations, *runs.real.values())):
        ends = np.searchsorted(run.t, np.arange(1.0, 9.0) - 1e-9)
        np.testing.assert_allclose(theta[:, k], np.rad2deg(run.q[ends, 2]), rtol=0, atol=1e-9)
        np.testing.assert_allclose(y[:, k], 1e3 * run.q[ends, 1], rtol=0, atol=1e-9)
    assert (columns(table, "survived")[:8] == "yes").all()
    opens = columns(table, "opens for [ms]")[:8]
    assert (opens[[0, 4]] == 0.0).all()
    assert opens[[1, 2, 3, 5, 6, 7]].min() > 0.15 and opens.max() < 4.0


def test_the_table_says_which_disturbances_are_survived(table: Table) -> None:
    assert columns(table, "survived")[8:].tolist() == [
        ["no", "no", "yes", "yes"],
        *[["yes"] * 4] * 3,
    ]
    assert np.isnan(columns(table, "theta [deg]")[8, 1:3]).all()
    slips = columns(table, "slips for [ms]")[8:]
    assert (slips[1] == 0.0).all() and (slips[2:, 1:] == 0.0).all() and (slips[2:, 0] > 1.0).all()


def simulated(scene: sp.Scene, mu: float = 0.5, **changes: Any) -> sp.Run:
    return sp.simulate(replace(experiment._real(scene, mu), **changes))


def test_an_operation_is_survived_only_if_both_tips_touch_and_the_object_rests() -> None:
    steps = paper.manipulation(duration=1.2)
    assert v.survived(simulated(steps)) == [True, False]  # 0.2 s are too short to rest
    # The tips open at the switch at 1 s: the run ends while one is free.
    cut = simulated(paper.manipulation(duration=1.001))
    assert v.survived(cut) == [True, False] and not cut.holds
    apart = sp.Schedule.steps([0.0, 1.0], np.deg2rad([[6, 6], [-10, -10]]))
    lost = simulated(sp.Scene(schedule=apart, duration=2.0, gravity=0.0), mu=0.0)
    assert v.survived(lost) == [True, False]


def words(real: Mapping[float, sp.Run], cases: Mapping[str, Mapping[float, sp.Run]]) -> str:
    return v._which_survive(real, cases).evidence


def test_words_change_with_the_runs(runs: Runs) -> None:
    lost = runs.real_cases["i"][0.3]
    cases = {"i": {0.3: lost, 0.5: lost}, "ii": {0.3: lost, 0.5: runs.real_cases["ii"][0.5]}}
    operations = {mu: runs.real[mu] for mu in (0.3, 0.5)}
    text = words(operations, cases)
    assert "survived with no mu of 0.3, 0.5: (i)" in text
    assert "survived with mu = 0.5 only, of 0.3, 0.5: (ii)" in text
    short = simulated(paper.manipulation(duration=1.2))
    assert "survived with no mu of 0.5: operation 2" in words({0.5: short}, {})
    dropped = v._falls_in_operations(runs.operations, {0.3: lost})
    assert np.isnan(dropped.value) and "lost at 1.0063 s (mu = 0.3)" in dropped.evidence


def test_spells_are_cut_to_the_interval(runs: Runs) -> None:
    run = runs.real[0.5]
    every = v.spells(run, sp.ContactMode.FREE, 0.0, 8.0)
    pieces = [v.spells(run, sp.ContactMode.FREE, k, k + 1.0) for k in range(8)]
    assert [time for piece in pieces for time in piece] == every
    assert [len(piece) for piece in pieces] == [0, 1, 1, 1, 0, 1, 1, 1]
    assert v.spells(run, sp.ContactMode.FREE, 1.0005, 1.001) == [pytest.approx(5e-4)]
    assert len(FRICTIONS) == len(runs.real)
