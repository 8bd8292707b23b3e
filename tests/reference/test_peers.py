"""The peers' hands of the reference problems: what is said to be the problem's, is."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
sys.path += [str(ROOT / "reference"), str(ROOT / "benchmarks")]

import score  # noqa: E402

pytest.importorskip("mujoco")
import reference  # noqa: E402
from peers_contact import grips, tips  # noqa: E402
from peers_contact.grips import Held  # noqa: E402

FIRM = {"integrator": "discrete", "cone": "elliptic", "impratio": "100", "noslip_iterations": "3"}


def energy(dn: complex, dt: complex, tilt: complex) -> complex:
    """(4), with kappa = 1."""
    by_stretch = dn**3 / (3 * np.cos(tilt) ** 2)
    return complex(np.pi * 3e5 * (by_stretch + dn**2 * dt * np.tan(tilt) + dn * dt**2))


def test_the_callback_has_the_forces_of_the_papers_energy() -> None:
    at, small = np.array([2e-3, 3e-4, 0.2]), 1e-30
    exact = [energy(*(at + small * 1j * np.eye(3)[k])).imag / small for k in range(3)]
    np.testing.assert_allclose(tips.forces(*at.tolist()), exact, rtol=1e-12)


def test_mujocos_hand_with_the_papers_tips_rests_as_the_problem_does() -> None:
    grip = grips.Grip(0.5, grips._resting, 0.0, 1.0, (0.0, 1.0))
    hand = tips.PaperTips(FIRM, 0.004, 0.002)
    held = grips.hold(hand, grip)
    assert held.lost is None
    assert held.creep < 1e-6
    first = score.solution("02-rest-half")[1].rows[0]
    exact = dict(zip(score.COLUMNS, first.tolist(), strict=True))
    dn, dt = [exact["dn_right"], exact["dn_left"]], [exact["dt_right"], exact["dt_left"]]
    np.testing.assert_allclose([n for n, _ in hand.forces()], exact["normal_right"], rtol=1e-3)
    np.testing.assert_allclose(hand.compressions(), dn, rtol=1e-3)
    np.testing.assert_allclose(hand.shears(), dt, rtol=1e-3)
    # The cube hangs as low as the tips are sheared.
    assert hand.height() == pytest.approx(exact["y"], rel=5e-3)


def test_the_couple_turns_the_cube_as_the_problem_has_it() -> None:
    hand = tips.PaperTips(FIRM, 0.004, 0.002)
    data = hand._data
    q = np.zeros(hand._model.nq)
    theta, pressed, sheared = 0.1, [2e-3, 1e-3], [4e-4, -1e-4]
    q[2] = -theta
    for (_, normal, shear), dn, dt in zip(hand._tips, pressed, sheared, strict=True):
        q[[normal, shear]] = dn, dt
    data.qpos[:] = q
    data.qfrc_passive[:] = 0.0
    hand._passive(None, data)
    turned = theta + 1e-30j
    # (6) of upright jaws: the right tip's tilt is -theta, the left one's theta.
    total = energy(pressed[0], sheared[0], -turned) + energy(pressed[1], sheared[1], turned)
    # The hinge turns clockwise, so that its force is the derivative by theta with this sign.
    assert data.qfrc_passive[2] == pytest.approx(total.imag / 1e-30, rel=1e-12)


def points() -> tuple[list[reference.Rungs], list[reference.GripRow]]:
    """Made up."""
    rungs = [
        reference.Rungs(solver, problem, [1e-2, 1e-9], [1e-3, 1e-2])
        for problem in reference.equations.PROBLEMS
        for solver in ("softpinch, rk4, csm", "Siconos, theta 1")
    ]
    names = ("softpinch, rk4", "MuJoCo discrete, defaults", "Drake, sap")
    held = {name: Held(2e-5, None, 0.3) for name in reference.CHARTED}
    lost = {name: Held(math.nan, 0.0, 0.1) for name in ("03-held", "04-lost")}
    return rungs, [*(reference.GripRow(n, 0, held) for n in names),
                   reference.GripRow("MuJoCo discrete", 1, lost)]  # fmt: skip


def test_the_chart_can_be_drawn_again_from_the_points_that_were_stored(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    reference.store(path, *points())
    assert repr(reference.stored(path)) == repr(points())


def test_no_legend_covers_a_curve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plt = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setattr(plt, "close", lambda figure: None)
    reference.chart(tmp_path / "chart.png", *points())
    figure = plt.gcf()
    monkeypatch.undo()
    try:
        assert len(figure.legends) == 2
        legends = [each.get_window_extent() for each in figure.legends]
        for axis in figure.axes:
            assert axis.get_legend() is None
            assert not any(axis.get_window_extent().overlaps(each) for each in legends)
    finally:
        plt.close(figure)


def test_who_could_not_be_measured_has_a_row_that_says_so() -> None:
    rungs, rows = points()
    missing = {"Drake": "not installed", "Siconos": "not installed"}
    table = reference.grips_table(rows[:1], list(reference.CHARTED), missing).splitlines()
    assert [line.split(":")[0] for line in table[-2:]] == ["| Siconos", "| Drake"]
    assert {line.count("|") for line in table} == {7}
    table = reference.equations_table(rungs, missing).splitlines()
    assert table[-1].startswith("| Siconos: could not be installed")
    assert {line.count("|") for line in table} == {8}
