"""Runs: what was recorded and what not, how to go on, how to store them, and `check`."""

import csv
import json
import pickle
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import softpinch as sp
from softpinch import _core, paper
from softpinch.run.ledger import LEDGER
from softpinch.scene.fields import QUANTITIES

ALL = ("state", "multipliers", "residuals", "energy", "torque", "contact")
SHORT = sp.Scene(duration=0.05, schedule=sp.Schedule.steps([0.0], [[0.10, 0.07]]))


def tampered(run: sp.Run, **changes: Any) -> sp.Run:
    """The run with some of its results replaced."""
    return sp.Run(run.scene, run._options, {**run._result, **changes})


def spoiled(values: np.ndarray, row: int, column: int, value: float) -> np.ndarray:
    result = values.copy()
    result[row, column] = value
    return result


@pytest.fixture(scope="module")
def run() -> sp.Run:
    return sp.simulate(SHORT, record=ALL, every=10)


def test_everything_recorded_has_its_shape_and_cannot_be_written(run: sp.Run) -> None:
    n = len(run)
    assert n == 51
    for name, columns in {"q": 9, "p": 9, "integral": 2, "multipliers": 4, "residuals": 4,
                          "torque": 2}.items():  # fmt: skip
        values = getattr(run, name)
        assert values.shape == (n, columns)
        with pytest.raises(ValueError, match="read-only"):
            values[0, 0] = 1.0
    for name in (*LEDGER, "closure", "total"):
        assert getattr(run.energy, name).shape == (n,)
    assert (run.t[0], run.t[-1]) == (0.0, 0.05)
    assert (run.status, run.success) == ("completed", True)
    assert (run.dt, run.method, run.formulation) == (1e-4, "rk4", "csm")
    assert (run.scene, run.stabilization) == (SHORT, sp.Stabilization())
    assert (run.record, run.every) == (ALL, 10)
    assert run.stop_on == ("separated", "crushed", "folded")
    assert run.stats["steps"] == 500
    recorded = set(QUANTITIES)
    # Losses of its own, and the work of a motion of the hand, are columns of other scenes.
    columns = (*LEDGER[:-4], "closure")
    assert set(run.arrays()) == recorded | {f"energy_{name}" for name in columns}


@given(st.sets(st.sampled_from(ALL)))
def test_missing_quantities_are_an_error_with_the_remedy(asked: set[str]) -> None:
    run = sp.simulate(SHORT, dt=1e-3, record=sorted(asked))
    assert run.record == tuple(name for name in ALL if name in asked)
    quantities = {"q": "state", "p": "state", "integral": "state"}
    for name in ("q", "p", "integral", "multipliers", "residuals", "energy"):
        quantity = quantities.get(name, name)
        if quantity in asked:
            getattr(run, name)
            continue
        assert not hasattr(run, name)
        with pytest.raises(sp.NotRecordedError) as caught:
            getattr(run, name)
        message = str(caught.value)
        assert message.startswith(f"{name} w")
        remedy = eval(message.split("pass record=")[1])
        assert set(remedy) == {*asked, quantity}
        getattr(sp.simulate(SHORT, dt=1e-3, record=remedy), name)


def test_the_ledger_closes_by_its_definition(run: sp.Run) -> None:
    e = run.energy
    total = e.kinetic + e.elastic + e.gravity
    works = e.controller_work + e.external_work + e.constraint_work - e.viscous_loss
    np.testing.assert_array_equal(e.total, total)
    np.testing.assert_allclose(e.closure, total - total[0] - works, rtol=0, atol=1e-15)
    assert np.abs(e.closure).max() <= 1e-6 * e.exchanged
    largest = max(np.abs(e.controller_work).max(), np.abs(e.elastic - e.elastic[0]).max())
    assert largest <= e.exchanged <= 1.001 * largest


def test_states_are_those_of_their_rows(run: sp.Run) -> None:
    state = run.state(7)
    assert state.time == run.t[7]
    np.testing.assert_array_equal(state.q, run.q[7])
    assert state.check is False
    assert run.state(-1) == run.state(len(run) - 1)
    bare = sp.simulate(SHORT, record=())
    assert bare.state(-1) == run.state(-1)
    assert bare.state() == bare.state(len(bare) - 1) == run.state()
    with pytest.raises(sp.NotRecordedError, match="state"):
        bare.state(0)
    for row in (len(run), -len(run) - 1):
        with pytest.raises(IndexError, match=f"k = {row}: the run has only {len(run)}"):
            run.state(row)


def test_a_repr_is_one_line_with_what_matters() -> None:
    run = sp.simulate(paper.disturbance("i"), every=100)
    assert repr(run) == (
        "<Run completed: t = 0 to 2 s, 201 rows (state), 20000 steps of rk4, pulling at 1.0022 s>"
    )
    assert "time only" in repr(sp.simulate(SHORT, record=()))


def test_runs_pickle(run: sp.Run) -> None:
    again = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(again.q, run.q)
    assert not again.q.flags.writeable
    assert (again.scene, again.status, again.state(-1)) == (run.scene, run.status, run.state(-1))


@given(st.sets(st.sampled_from(ALL)))
def test_npz_holds_what_was_recorded_and_where_it_came_from(asked: set[str]) -> None:
    run = sp.simulate(paper.disturbance("ii", duration=0.02), dt=1e-3, record=sorted(asked))
    with (
        tempfile.TemporaryDirectory() as folder,
        np.load(run.save(Path(folder) / "run.npz")) as file,
    ):
        assert set(file) == {"t", "provenance", *run.arrays()}
        for name, values in run.arrays().items():
            np.testing.assert_array_equal(file[name], values)
        provenance = json.loads(str(file["provenance"]))
    assert sp.Scene.from_dict(provenance["scene"]) == run.scene
    assert provenance["results_version"] == _core.RESULTS_VERSION
    assert (provenance["dt"], provenance["record"]) == (1e-3, list(run.record))
    assert sp.Stabilization.from_dict(provenance["stabilization"]) == run.stabilization


def test_csv_has_a_column_with_its_unit_for_each_number(run: sp.Run, tmp_path: Path) -> None:
    with run.save(str(tmp_path / "run.csv")).open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    table = np.array(rows, dtype=float)
    assert table.shape == (len(run), len(header)) == (51, 41)
    assert all("[" in name for name in header)
    expected = {
        "t [s]": run.t,
        "theta_1 [rad]": run.q[:, 3],
        "rate of y [m/s]": run.p[:, 1],
        "rate of theta [rad/s]": run.p[:, 2],
        "integral_2 [rad s]": run.integral[:, 1],
        "lambda_1N [N]": run.multipliers[:, 2],
        "C_2N [m/s]": run.residuals[:, 3],
        "torque_1 [N m]": run.torque[:, 0],
        "contact_2 [1]": run.contact[:, 1],
        "energy_elastic [J]": run.energy.elastic,
        "energy_closure [J]": run.energy.closure,
    }
    for name, values in expected.items():
        np.testing.assert_array_equal(table[:, header.index(name)], values)


# The check, and each way in which it fails.


@pytest.mark.parametrize("case", [None, *paper.CASES])
@pytest.mark.parametrize("record", [ALL, ("state",), ("energy",), ("residuals",), ()])
def test_the_papers_scenes_pass(case: str | None, record: tuple[str, ...]) -> None:
    scene = paper.manipulation() if case is None else paper.disturbance(case)
    run = sp.simulate(scene, record=record)
    assert run.check() is run


def test_the_margins_are_real(run: sp.Run) -> None:
    with pytest.raises(AssertionError, match=r"^constraint C_.*\^[HN]: .* of the .* at t = .*row"):
        run.check(residual=1e-16)
    with pytest.raises(AssertionError, match=r"^energy ledger closes: .* J exchanged at t = "):
        run.check(closure=1e-12)
    assert run.check(residual=np.inf, closure=np.inf) is run
    for name in ("residual", "closure"):
        for value in (-1.0, float("nan")):
            with pytest.raises(ValueError, match=f"{name} = .*: must be >= 0"):
                run.check(**{name: value})


def broken(run: sp.Run) -> dict[str, dict[str, Any]]:
    """Message -> what was done to the results."""
    q, p, t = run.q, run.p, run.t
    late = t.copy()
    late[9] = late[8]
    violet = {"violations": {"pulling": 0.06}}
    fails = {"status": "separated", "violations": {"separated": 0.05}}
    ledger = run._result["energy"]
    return {
        r"^times increase: the row before is at 0\.008 s at t = 0\.008 s \(row 9\)": {"t": late},
        r"^finite: q\[3\] is nan at t = 0\.005 s \(row 5\)": {"q": spoiled(q, 5, 3, np.nan)},
        r"^constraint C_2\^H: 3\.000e-03 m, .*1e-06 of the fingertip's radius at t = 0\.006 s": {
            "residuals": spoiled(run.residuals, 6, 1, -3e-3)
        },
        r"^constraint C_1\^N: 2\.000e-03 m/s, more than .* of the largest speed .*row 6": {
            "residuals": spoiled(run.residuals, 6, 2, 2e-3)
        },
        r"^energy ledger closes: -?\d.* J, more than 0\.0001 of the .*row 50": {
            "energy": spoiled(ledger, -1, 3, 1.01 * ledger[-1, 3])
        },
        r"^violation pulling: first reported at 0\.06 s": violet,
        r"^status separated: the last state does not have this violation": fails,
        r"^violation separated: the state has it, but the run did not report it at .*row 5": {
            "q": spoiled(q, 5, 6, -1e-6)
        },
        r"^violation pulling: the state has it, but the run did not report it at .*row 5": {
            "multipliers": spoiled(run.multipliers, 5, 1, -1e-9)
        },
        r"^status completed: the state is crushed, which should have ended the run .*row 7": {
            "q": spoiled(q, 7, 5, 0.02),
            "violations": {"crushed": 0.007},
        },
        r"^status completed: the run should have reached 0\.05 s at t = 0\.049": {
            "t": t[:-1],
            "q": q[:-1],
            "p": p[:-1],
            "integral": run.integral[:-1],
            "multipliers": run.multipliers[:-1],
            "residuals": run.residuals[:-1],
            "energy": ledger[:-1],
        },
    }


@pytest.mark.parametrize("k", range(11))
def test_check_names_the_invariant_where_it_broke_and_by_how_much(run: sp.Run, k: int) -> None:
    cases = list(broken(run).items())
    assert len(cases) == 11
    message, changes = cases[k]
    with pytest.raises(AssertionError, match=message):
        tampered(run, **changes).check()


def test_check_computes_residuals_that_were_not_recorded() -> None:
    run = sp.simulate(SHORT)
    with pytest.raises(AssertionError, match=r"^constraint C_1\^H: 1\.0.*e-04 m"):
        tampered(run, q=spoiled(run.q, 100, 5, run.q[100, 5] + 1e-4)).check()
    with pytest.raises(AssertionError, match=r"^constraint C_2\^N: "):
        tampered(run, p=spoiled(run.p, 100, 8, run.p[100, 8] + 1e-2)).check()


@given(st.sets(st.floats(0.0, 1.2), min_size=1, max_size=5))
@example({1.1})
def test_a_sound_run_passes_whatever_instants_are_kept(kept: set[float]) -> None:
    scene = paper.manipulation(duration=1.2)
    how: dict[str, Any] = {"method": "dop853", "tolerance": 1e-8, "record": ALL}
    run = sp.simulate(scene, **how, times=sorted(kept))
    assert run.violations["pulling"] == pytest.approx(1.0)
    assert run.check(residual=1e-4, closure=np.inf) is run
    for time in (-1e-3, 1.3):
        wrong = tampered(run, violations={"pulling": time})
        with pytest.raises(AssertionError, match=r"violation pulling: .* outside the run"):
            wrong.check(residual=1e-4, closure=np.inf)


def test_options_that_compare_equal_are_not_taken_for_each_other() -> None:
    """The options of repeated runs are checked once; True and 1.0 are equal to 1, and refused."""
    scene = replace(sp.paper.manipulation(), duration=1e-3)
    assert sp.simulate(scene, every=1).every == 1
    for wrong in (True, 1.0):
        with pytest.raises(TypeError, match="every"):
            sp.simulate(scene, every=wrong)  # type: ignore[arg-type]
