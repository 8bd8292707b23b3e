"""Stability maps: every cell is a run of `simulate`, every line a prediction of `max_stable_dt`."""

import csv
import json
import os
import signal
import threading
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from softpinch.accuracy import stability_axes
from softpinch.accuracy.stability_maps import StabilityMap

SCENE = sp.Scene(schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 4.8]])), duration=0.03)
PAIRS = (("csm", "rk4"), ("nullspace", "radau5"), ("projected", "rosenbrock"), ("csm", "dop853"))
STEPS = np.geomspace(2e-4, 1e-2, 5)


def small(
    axis: object, values: object = None, scene: sp.Scene = SCENE, **how: object
) -> StabilityMap:
    given = {"dt": STEPS, "pairs": PAIRS, "progress": False, "threads": 2, **how}
    return sp.stability_map(scene, axis, values, **given)


@pytest.fixture(scope="module")
def stiffness() -> StabilityMap:
    return small("youngs_modulus", [1e4, 3e6, 1e9])


def scaled(value: np.ndarray, exact: sp.Run, name: str) -> float:
    """The error of docs/error-against-run-time.md, "The problem", written again."""
    rows = getattr(exact, name)
    sizes = np.abs(rows).max(axis=0)
    metres, radians = [0, 1, 5, 6, 7, 8], [2, 3, 4]
    for unit in (metres, radians):
        small_ones = sizes[unit] < 1e-9 * sizes[unit].max()
        sizes[unit] = np.where(small_ones, sizes[unit].max() or 1.0, sizes[unit])
    return float((np.abs(value - rows[-1]) / sizes).max())


def assert_cells_are_runs(
    found: StabilityMap,
    at: Callable[[float], sp.Scene],
    gains: Callable[[float], sp.Stabilization] = lambda _: sp.Stabilization(),
) -> None:
    """Against runs made one by one, and a motion by another method than the map's two."""
    for v, value in enumerate(found.values.tolist()):
        scene = at(value)
        exact = sp.simulate(scene, tolerance=1e-12, method="dop853", formulation="nullspace")
        assert found.expected[v] == exact.status
        for k, (formulation, method) in enumerate(found.pairs):
            for d, dt in enumerate(found.dt.tolist()):
                run = quiet(scene, dt, method, formulation, gains(value))
                assert found.status[k, v, d] == run.status, (value, dt, method)
                assert found.agrees[k, v, d] == (run.status == exact.status)
                error = found.error[k, v, d]
                if run.status == exact.status == "completed":
                    by_hand = max(scaled(getattr(run, n)[-1], exact, n) for n in ("q", "p"))
                    # The largest sizes are those of the rows, which differ between motions.
                    assert error == pytest.approx(by_hand, rel=0.02, abs=1e-9)
                else:
                    assert error == np.inf


def quiet(
    scene: sp.Scene, dt: float, method: str, formulation: str, gains: sp.Stabilization
) -> sp.Run:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sp.StabilityWarning)
        return sp.simulate(scene, dt=dt, method=method, formulation=formulation,
                           stabilization=gains)  # fmt: skip


def with_stiffness(value: float) -> sp.Scene:
    return replace(SCENE, hand=sp.Hand(tip=sp.Fingertip(youngs_modulus=value)))


def test_every_cell_is_the_run_that_simulate_gives(stiffness: StabilityMap) -> None:
    assert_cells_are_runs(stiffness, with_stiffness)
    # The map has something to show: cells of all kinds.
    assert (stiffness.error < 1e-6).any() and stiffness.misleading().any()
    assert not stiffness.agrees.all() and stiffness.agrees.any()


def test_predictions_are_those_of_max_stable_dt(stiffness: StabilityMap) -> None:
    for k, (formulation, method) in enumerate(stiffness.pairs):
        for v, value in enumerate(stiffness.values.tolist()):
            step = sp.max_stable_dt(with_stiffness(value), method, formulation, measure=False)
            assert stiffness.predicted[k, v] == pytest.approx(step.predicted, rel=0.01)
    assert np.isinf(stiffness.predicted[1:3]).all() and np.isfinite(stiffness.predicted[0]).all()
    assert (stiffness.floor < 1e-8).all()


def test_measured_is_the_longest_step_up_to_which_runs_are_right(
    stiffness: StabilityMap,
) -> None:
    measured = stiffness.measured()
    for k, v in np.ndindex(measured.shape):
        good = stiffness.agrees[k, v] & (stiffness.error[k, v] < 0.5)
        first_bad = int(np.argmin(good)) if not good.all() else len(good)
        assert measured[k, v] == (STEPS[first_bad - 1] if first_bad else 0.0)
    # RK4 fails within a step of the grid of where it is predicted to.
    ratio = STEPS[1] / STEPS[0]
    assert (measured[0] < ratio * stiffness.predicted[0]).all()
    assert (measured[0] > stiffness.predicted[0] / ratio**1.5).all()


def test_threads_change_nothing(stiffness: StabilityMap) -> None:
    again = small("youngs_modulus", [1e4, 3e6, 1e9], threads=1)
    for name, array in stiffness.to_dict().items():
        np.testing.assert_array_equal(again.to_dict()[name], array, err_msg=name)


def test_the_stabilisations_axis_sets_the_gains_and_only_csm_has_them() -> None:
    found = small("stabilization", [1e2, 1e4, 1e6])
    assert_cells_are_runs(found, lambda _: SCENE, lambda v: sp.Stabilization(alpha=v, beta=v))
    assert (found.error[1:3] == found.error[1:3, :1]).all()
    assert found.predicted[0, 2] == pytest.approx(2.785e-6, rel=0.02)


def test_blows_that_tear_the_object_out_are_right_to_end_early() -> None:
    found = small("impulse", [0.01, 8.0])
    blown = stability_axes.AXES["impulse"]
    assert_cells_are_runs(found, lambda v: blown.apply(SCENE, sp.Stabilization(), v)[0])
    assert found.expected.tolist() == ["completed", "separated"]
    short = found.status[:, 1, 0]
    assert (short == "separated").all() and found.agrees[:, 1, 0].all()
    assert (found.measured()[:, 1] > 0.0).all()


def test_a_function_may_change_anything_between_values() -> None:
    def at(value: float) -> sp.Scene:
        """Other numbers of switches, another duration, another push, and driven fingers at 1."""
        times = np.arange(int(value)) * 0.005
        angles = np.deg2rad(np.column_stack([6.0 + times * 100, 5.0 + 0 * times]))
        push = [sp.Step(time=0.01, force=(value, 0.0))] if value > 1 else []
        return replace(
            SCENE, schedule=sp.Schedule.steps(times, angles), disturbances=push,
            duration=0.01 * (1 + value), fingers="pid" if value > 1 else "driven",
        )  # fmt: skip

    found = small(at, [1.0, 2.0, 3.0])
    assert (found.axis, found.unit) == ("at", "1")
    assert_cells_are_runs(found, at)


def test_a_path_changes_that_number_and_leaves_noise_its_seed() -> None:
    noise = sp.Noise(force_std=(1.0, 1.0), moment_std=0.01, rate_hz=500.0, seed=7, run=3)
    noisy = replace(SCENE, disturbances=[noise])
    found = small("control.kd", [0.5, 2.0], noisy, pairs=PAIRS[:2])
    assert (found.axis, found.unit, found.scale) == ("control.kd", "N m s/rad", "linear")
    assert_cells_are_runs(found, lambda value: replace(noisy, control=sp.Pid(kd=value)))


def test_runs_of_too_many_steps_are_left_out_and_say_so() -> None:
    found = small("object_mass", [0.1, 0.2], max_steps=100)
    too_many = np.ceil(SCENE.duration / STEPS) > 100
    assert too_many.any() and not too_many.all()
    assert ((found.status == "not_run") == too_many).all()
    assert not found.agrees[..., too_many].any() and np.isinf(found.error[..., too_many]).all()


def test_without_a_reference_nothing_agrees() -> None:
    found = small("object_mass", [0.1], max_steps=20)
    assert found.expected.tolist() == ["no_reference"] and np.isinf(found.floor).all()
    assert not found.agrees.any() and np.isinf(found.error).all() and not found.misleading().any()
    assert "no reference 1" in found.summary()[0]
    assert " 0 of 0 runs end as they should" in found.summary()[1]


def test_the_summary_counts_the_cells(stiffness: StabilityMap) -> None:
    first, *lines = stiffness.summary()
    assert first.startswith("3 values of youngs_modulus: the motion completed 3; known to ")
    assert len(lines) == len(PAIRS)
    for k, line in enumerate(lines):
        assert line.startswith(" + ".join(PAIRS[k]) + ": ")
        assert f"{stiffness.agrees[k].sum()} of 15 runs end as they should" in line
        assert f"{(stiffness.error[k] < 1e-3).sum()} with an error below 0.001" in line
        wrong = (stiffness.status[k] == "completed") & (stiffness.error[k] > 0.1)
        assert f"{wrong.sum()} complete but are wrong by more than 0.1" in line
        failed = stiffness.status[k][stiffness.status[k] != "completed"]
        for status in np.unique(failed):
            assert f"{str(status).replace('_', ' ')} {(failed == status).sum()}" in line


def test_csv_and_npz_have_all_cells(stiffness: StabilityMap, tmp_path: Path) -> None:
    with np.load(stiffness.save(tmp_path / "map.npz")) as saved:
        for name, array in stiffness.to_dict().items():
            np.testing.assert_array_equal(saved[name], array)
        how = json.loads(str(saved["provenance"]))
    assert how == stiffness.provenance() and how["axis"] == "youngs_modulus"
    assert sp.Scene.from_dict(how["scene"]) == SCENE
    with stiffness.save(tmp_path / "map.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = list(csv.reader(file))
    assert header[2:4] == ["youngs_modulus [Pa]", "dt [s]"]
    assert len(rows) == stiffness.status.size
    table = {name: [row[k] for row in rows] for k, name in enumerate(header)}
    assert table["status"] == stiffness.status.ravel().tolist()
    assert list(map(float, table["error [1]"])) == stiffness.error.ravel().tolist()
    assert table["agrees"] == [str(x) for x in stiffness.agrees.ravel().tolist()]
    assert list(map(float, table["dt [s]"]))[:5] == STEPS.tolist()
    assert list(map(float, table["predicted [s]"]))[::5] == stiffness.predicted.ravel().tolist()
    with pytest.raises(ValueError, match=r"must end in \.npz or \.csv"):
        stiffness.save(tmp_path / "map.txt")


def test_a_start_off_the_constraints_is_for_csm() -> None:
    q = np.array(sp.State.consistent(SCENE, fingers=(0.1, 0.1)).q)
    q[5] += 1e-4
    off = replace(SCENE, initial=sp.State(q, check=False))
    with pytest.raises(ValueError, match=r"object_mass = 0\.1: initial state is inconsistent"):
        small("object_mass", [0.1], off)
    found = small("object_mass", [0.1], off, pairs=[("csm", "rk4"), ("csm", "radau5")])
    assert found.expected.tolist() == ["completed"] and found.error[:, 0, 0].max() < 1e-3


def test_progress_counts_every_run() -> None:
    reported: list[tuple[int, int]] = []
    small("object_mass", [0.1, 0.2], progress=lambda done, total: reported.append((done, total)))
    total = 2 + 2 * len(STEPS) * len(PAIRS)
    assert {each for _, each in reported} == {total}
    done = [each for each, _ in reported]
    assert done == sorted(done) and done[-1] == total


def test_ctrl_c_stops_all_threads() -> None:
    """The runs would take half an hour."""
    long = replace(SCENE, duration=2000.0)
    before = threading.active_count()
    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        small("object_mass", [0.1], long, dt=[1e-6], max_steps=2**40)
    timer.join()
    assert threading.active_count() == before


def legend(figure: object) -> set[str]:
    return {text.get_text() for text in figure.legends[0].get_texts()}


def test_the_figure_has_a_panel_for_each_pair_and_says_what_it_shows(
    stiffness: StabilityMap, tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    figure = sp.plot.stability_map(stiffness)
    *panels, bar = figure.axes
    assert len(panels) == 12
    assert sum("not asked for" in [t.get_text() for t in p.texts] for p in panels) == 8
    assert [p.get_title() for p in panels[:4]] == ["rk4", "dop853", "radau5", "rosenbrock"]
    assert "[Pa]" in figure.get_supxlabel() and "[s]" in figure.get_supylabel()
    assert "[1]" in bar.get_ylabel()
    names = legend(figure)
    assert {"predicted longest step", "completes, error above 0.1"} <= names
    failed = {s.replace("_", " ") for s in stiffness.status.ravel().tolist()} - {"completed"}
    assert failed <= names
    # The line is the prediction.
    lines = [line for line in panels[0].get_lines() if len(line.get_xdata()) == 3]
    np.testing.assert_allclose(lines[-1].get_ydata(), stiffness.predicted[0])
    np.testing.assert_allclose(lines[-1].get_xdata(), stiffness.values)
    assert sp.plot.save(figure, tmp_path / "map.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("axis", "values", "how", "seen"),
    [
        ("viscosity", [0.0, 1.0, 1e3], {}, set()),
        ("viscosity", [0.0], {"pairs": PAIRS[:1], "dt": [1e-3]}, set()),
        ("grasp_depth", [1e-3, 0.5, 0.99], {}, set()),
        ("tilt", [0.0, 45.0, 89.0], {"max_steps": 100}, {"not run"}),
        ("impulse", [1e-2, 8.0], {}, {"ends early, as it should"}),
        ("object_mass", [0.1], {"max_steps": 20}, {"no reference", "not run"}),
    ],
)
def test_every_kind_of_axis_can_be_drawn(
    axis: str, values: list[float], how: dict[str, object], seen: set[str], tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    figure = sp.plot.stability_map(small(axis, values, **how))
    assert seen <= legend(figure)
    left, right = figure.axes[0].get_xlim()
    assert np.isfinite([left, right]).all() and left < right
    if values[0] == 0.0:
        assert 0.0 in figure.axes[-2].get_xticks()
    sp.plot.save(figure, tmp_path / "map.svg")
