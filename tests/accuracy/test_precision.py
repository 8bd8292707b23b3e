"""`work_precision` and `stabilization_sweep`: errors against an independent reference."""

import csv
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from oracle.trajectory import reference as oracle
from softpinch import plot, reference, stress
from softpinch.cli import accuracy
from softpinch.run import scaled_error
from softpinch.run.request import Request

SCENE = replace(
    stress.CASES["hammer"].scene,
    schedule=sp.Schedule.steps([0.0, 0.03], np.deg2rad([[6.0, 4.8], [7.0, 3.0]])),
    duration=0.08,
)
STEPS = [2e-4, 1e-4, 5e-5]


def by_scipy(scene: sp.Scene) -> Any:
    """A peer: SciPy's DOP853 on the reference's equations."""
    end = [scene.duration]
    return lambda rtol: reference.solve(scene, end, rtol=rtol)


PEER = sp.Peer(
    name="SciPy",
    setting="rtol",
    values=[1e-4, 1e-8],
    prepare=by_scipy,
    ends=lambda found: (found.q[-1], found.p[-1]),
)


@cache
def measured() -> sp.WorkPrecision:
    return sp.work_precision(
        SCENE,
        formulations=("csm", "nullspace"),
        methods=("rk4", "dop853"),
        dt=[*STEPS, 0.02],
        tolerances=[1e-4, 1e-8],
        peers=[PEER],
        progress=False,
    )


def test_every_setting_of_every_solver_has_a_row() -> None:
    found = measured()
    assert len(found.rows) == 2 * (4 + 4 + 2) + 2
    assert not found.skipped
    assert {row.solver for row in found.rows} == {
        *("csm rk4", "csm dop853", "nullspace rk4", "nullspace dop853", "SciPy")
    }
    assert "DOP853" in found.reference and "confirmed by" in found.reference
    assert max(found.floor.values()) < 1e-9
    for row in found.rows:
        if row.status == "completed":
            low, high = row.quartiles
            assert 0.0 < low <= row.time <= high
        if row.method:
            assert row.steps > 0
            assert row.evaluations >= row.steps


def test_errors_are_those_of_another_reference() -> None:
    """SymPy's equations; at the end, at instants after a switch and away from all."""
    found = measured()
    # Rows of every run.
    times = np.linspace(0.0, SCENE.duration, 201)
    exact = oracle(SCENE, times)
    for row in found.rows:
        if row.setting != "dt" or row.status != "completed":
            continue
        run = sp.simulate(
            SCENE,
            dt=row.value,
            method=row.method,
            formulation=row.formulation,
            record=("state", "multipliers", "residuals", "energy"),
        )
        rows = np.searchsorted(run.t, times - 1e-9)
        np.testing.assert_allclose(run.t[rows], times, atol=1e-15)
        for name in ("q", "p", "multipliers"):
            scale = scaled_error.scales(name, getattr(exact, name))
            errors = scaled_error.by_row(getattr(run, name)[rows], getattr(exact, name), scale)
            # Scales are those of the whole run, which rows may miss a part of.
            assert row.end[name] == pytest.approx(errors[-1], rel=0.5, abs=1e-11)
            worst = max(row.smooth[name], row.at_switches[name])
            assert 0.6 * errors.max() <= worst * 1.001 + 1e-11
        assert row.holonomic == pytest.approx(np.abs(run.residuals[:, :2]).max(), rel=1e-9)
        assert row.nonholonomic == pytest.approx(np.abs(run.residuals[:, 2:]).max(), rel=1e-9)
        closure = np.abs(run.energy.closure).max() / run.energy.exchanged
        assert row.closure == pytest.approx(closure, rel=1e-9)
        assert row.evaluations == run.stats["evaluations"]


def test_orders_are_observed_and_failures_kept() -> None:
    rows = [row for row in measured().rows if row.setting == "dt"]
    for row in rows:
        if row.value in STEPS[1:] and row.method == "rk4":
            assert row.order == pytest.approx(row.expected_order, abs=0.4)
    failed = [row for row in rows if row.value == 0.02 and row.method == "rk4"]
    assert len(failed) == 2
    for row in failed:
        assert row.status != "completed"
        assert row.error == math.inf
        assert math.isnan(row.order)


@cache
def settling() -> sp.WorkPrecision:
    """A grasp that rests at the end, whatever the steps of the transient were."""
    return sp.work_precision(
        sp.Scene(duration=0.6),
        formulations="nullspace",
        methods=("rk4", "dop853"),
        dt=[3.8e-3, 2.2e-3, 1.2e-3, 6e-4, 3e-4],
        tolerances=(),
        progress=False,
    )


def test_errors_along_the_run_are_ranked_by_default() -> None:
    found = settling()
    long = next(row for row in found.rows if row.method == "rk4" and row.value == 1.2e-3)
    assert long.error < 1e-6 < 1e-2 < long.along
    # Whatever is cheapest on this machine: errors at the end allow steps that miss the transient.
    cheapest = found.cheapest(1e-6, "end")
    assert all(row.error <= 1e-6 for row in cheapest)
    assert any(row.along > 1e-6 for row in cheapest)
    assert found.cheapest(1e-3) == found.cheapest(1e-3, "along")
    assert all(row.along <= 1e-3 for row in found.cheapest(1e-3))
    hidden = [row for row in found.rows if 10.0 * row.error < row.along < math.inf]
    assert f"the motion has settled: {len(hidden)} of " in found.settled()
    assert found.to_dict()["along"].tolist() == [row.along for row in found.rows]
    # The steps do not change where the grasp rests, so that orders at its end say nothing.
    rk4 = [row for row in found.rows if row.method == "rk4" and row.value < 1e-3]
    assert [row.order for row in rk4] == pytest.approx([4.0, 4.0], abs=1.0)
    still = replace(found, rows=tuple(replace(row, end=row.smooth) for row in found.rows))
    assert still.settled() == ""


def test_an_order_above_the_methods_is_explained() -> None:
    found = settling()
    far = min(found.rows, key=lambda row: row.along)
    high = replace(found, rows=(replace(far, order=far.expected_order + 2.0),))
    said = [line for line in accuracy.lines(high) if f" {far.value:.2e} " in line]
    words = f"above the method's {far.expected_order} after a step too long for it"
    assert said and all(words in line for line in said)
    assert not any("above the method's" in line for line in accuracy.lines(high, "end"))


def test_the_figure_shows_every_curve_and_where_the_error_is() -> None:
    found = measured()
    figure, peers = plot.work_precision(found), plot.work_precision(found, peers=True)
    # Peers have states at the end only.
    assert "along the run" in figure.axes[0].get_ylabel()
    assert "at the end" in peers.axes[0].get_ylabel()
    for each, shown in ((figure, False), (peers, True)):
        labels = {text.get_text() for text in each.legends[0].get_texts()}
        assert {"rk4, equal steps", "dop853, free steps", "failed"} <= labels
        assert ("SciPy" in labels) == shown
    assert plot.work_precision(settling()).get_suptitle() == ""
    end = plot.work_precision(settling(), where="end")
    assert "at the end" in end.axes[0].get_ylabel()
    assert end.get_suptitle().replace("\n", " ") == settling().settled()
    with pytest.raises(ValueError, match="where"):
        plot.work_precision(found, where="middle")


def test_the_cheapest_meets_the_error_and_so_does_the_next_tighter() -> None:
    found = measured()
    best = found.cheapest(1e-6)
    assert [row.time for row in best] == sorted(row.time for row in best)
    curves = found.curves()
    for row in best:
        assert row.along <= 1e-6 and row.method
        rows = curves[row.solver, row.setting]
        after = rows[rows.index(row) + 1 :]
        assert not after or after[0].along <= 1e-6
    assert found.cheapest(1e-300) == ()
    end = found.cheapest(1e-6, "end")
    assert all(row.error <= 1e-6 for row in end) and not all(row.method for row in end)
    with pytest.raises(ValueError, match="where"):
        found.cheapest(1e-6, "middle")


def test_left_out_settings_and_peers_are_listed_with_the_reason() -> None:
    """A step is not measured twice, and one that would take too long not at all."""

    def refuses(scene: sp.Scene) -> Any:
        raise ValueError("equal fingers only")

    found = sp.work_precision(
        replace(SCENE, duration=0.01, disturbances=()),
        formulations="csm",
        methods="rk4",
        dt=[1e-4, 1e-4, 1e-7],
        tolerances=(),
        peers=[replace(PEER, name="other", prepare=refuses)],
        longest=0.005,
        progress=False,
    )
    assert [row.status for row in found.rows] == ["completed", "not_run"]
    left_out = "csm rk4, dt = 1e-07: would take too long"
    assert found.skipped == (left_out, "other: equal fingers only")


def test_csv_and_pandas_have_all_rows(tmp_path: Path) -> None:
    found = measured()
    columns = found.to_dict()
    assert {len(values) for values in columns.values()} == {len(found.rows)}
    with found.save(tmp_path / "x.csv").open(encoding="utf-8") as file:
        header, *lines = list(csv.reader(file))
    assert "time [s]" in header
    assert "end.q" in header
    assert len(lines) == len(found.rows)
    assert float(lines[0][header.index("end.q")]) == found.rows[0].end["q"]
    assert len(found.to_pandas()) == len(found.rows)
    with pytest.raises(ValueError, match=r"must end in \.csv"):
        found.save(tmp_path / "x.txt")


def test_gains_that_hide_drift_can_spoil_the_motion(tmp_path: Path) -> None:
    scene = replace(SCENE, duration=0.04, disturbances=())
    found = sp.stabilization_sweep(scene, dt=2e-4, products=[1e-4, 0.1, 1.0, 2.5, 4.0])
    assert found.product.tolist() == [1e-4, 0.1, 1.0, 2.5, 4.0]
    # No gain, no effect; some gain, less drift; beyond the method's stability it fails.
    assert found.error[0] == pytest.approx(found.without["q and p"], rel=0.3)
    assert found.holonomic[1] < 0.2 * found.holonomic[0]
    assert found.multipliers[3] > 3.0 * found.multipliers[1]
    assert found.status[-1] != "completed"
    assert math.isinf(found.holonomic[-1])
    figure = plot.stabilization_sweep([found, found])
    assert plot.save(figure, tmp_path / "gains.png").stat().st_size > 10_000


def test_a_run_that_a_violation_ends_is_a_failure() -> None:
    case = stress.CASES["crushed"]
    found = sp.work_precision(
        replace(case.scene, duration=0.02),
        formulations="nullspace",
        methods="rk4",
        dt=[1e-4],
        tolerances=(),
        progress=False,
    )
    assert found.rows[0].status == "crushed"
    assert found.rows[0].error == math.inf


def test_ctrl_c_is_no_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    class Interrupted:
        def __init__(self, simulation: Any) -> None:
            self.simulation = simulation

        def run(self) -> dict[str, Any]:
            return {**self.simulation.run(), "status": "interrupted"}

    simulation = Request.simulation
    monkeypatch.setattr(Request, "simulation", lambda *args: Interrupted(simulation(*args)))
    with pytest.raises(KeyboardInterrupt):
        sp.work_precision(SCENE, methods="rk4", dt=[1e-3], tolerances=(), progress=False)
    with pytest.raises(KeyboardInterrupt):
        sp.stabilization_sweep(SCENE, dt=1e-3, products=[0.1])
