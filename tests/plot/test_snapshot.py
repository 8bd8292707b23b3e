"""Snapshots: the motion, forces, modes and texts at an instant are those of the run."""

import re

import numpy as np
import pytest

import softpinch as sp
from films import operation, pushed_run, texts
from softpinch import plot
from softpinch.plot.drawing import instants
from softpinch.plot.style import PURPLE
from softpinch.plot.timeline import COLORS
from softpinch.scene import outline

pytest.importorskip("matplotlib")
from matplotlib.colors import to_hex
from matplotlib.patches import Polygon


@pytest.fixture(scope="module")
def run() -> sp.Run:
    return operation()


@pytest.fixture(scope="module")
def slipping() -> sp.Run:
    return pushed_run()


def test_forces_and_their_points_are_those_of_the_equations(run: sp.Run) -> None:
    times = run.t[[300, 1000, 1010, 1200]]
    for row, shown in zip((300, 1000, 1010, 1200), instants(run, times, True), strict=True):
        terms = sp.evaluate(run.scene, run.t[row], run.q[row], run.p[row], run.integral[row])
        # Phi^T lambda of (24): force and moment of both tips on the object.
        load = terms.constraint_matrix[:, :3].T @ terms.multipliers
        np.testing.assert_allclose(shown.contact.sum(axis=0), load[:2], rtol=1e-9, atol=1e-9)
        arms = [outline.contact_point(run.scene, shown.q, side) - shown.q[:2] for side in (0, 1)]
        moments = [r[0] * f[1] - r[1] * f[0] for r, f in zip(arms, shown.contact, strict=True)]
        # The point is on the drawn tip, which fulfils (9) up to the drift of "csm".
        assert sum(moments) == pytest.approx(load[2], abs=1e-6)


def test_jaws_that_drift_away_are_drawn() -> None:
    """Unequal forces of jaws carry the grasp off, 3.3 m in 1 s."""
    jaw = sp.Jaw()
    hand, forces = sp.Hand(right=jaw, left=jaw), sp.Schedule.steps([0.0], [[8.0, 6.0]])
    scene = sp.Scene(hand=hand, control=sp.Torque(), schedule=forces, initial="touching")
    drifted = sp.simulate(scene, 1e-3)
    figure = plot.snapshot(drifted, 1.0)
    left, right = figure.axes[0].get_xlim()
    assert left < 1e3 * drifted.q[-1, 0] < right
    assert right - left < 1000.0
    assert "svg" in drifted._repr_html_()


def test_modes_and_violations_of_each_instant(slipping: sp.Run) -> None:
    changes = slipping.contact_changes
    assert changes
    times = np.array([0.5 * (changes[0].time), changes[0].time + 1e-5])
    before, after = instants(slipping, times, False)
    assert before.modes is not None and after.modes is not None
    side = ("right", "left").index(changes[0].finger)
    assert before.modes[side] is changes[0].before
    assert after.modes[side] is not changes[0].before
    assert before.status == () and "slipping" in after.status
    # A violation shorter than the time between two frames is said in the later one.
    first, last = slipping.violation_intervals["slipping"][0]
    sparse = instants(slipping, np.array([first - 1e-3, last + 1e-3]), False)
    assert "slipping" in sparse[1].status
    assert instants(slipping, slipping.t[-1:], False)[0].status == ("completed",)


def test_a_snapshot_says_time_status_and_load(slipping: sp.Run) -> None:
    words = texts(plot.snapshot(slipping, 0.025))
    assert words[:2] == ["t = 0.0250 s", "slipping"]
    assert "disturbance, +0.1 N m" in words
    assert any(re.fullmatch(r"\d+ N", word) for word in words)
    assert texts(plot.snapshot(slipping))[:2] == ["t = 0.1000 s", "completed"]
    bare = texts(plot.snapshot(slipping, 0.025, forces=False))
    assert not any(re.fullmatch(r"\d+ N", word) or "disturbance" in word for word in bare)


def test_a_snapshot_draws_arrows_from_the_contacts_along_the_forces(run: sp.Run) -> None:
    figure = plot.snapshot(run, 1.1)
    (shown,) = instants(run, np.array([1.1]), True)
    outlines = [each.get_xy() for each in figure.axes[0].patches if isinstance(each, Polygon)]
    # Arrows have seven corners, and the first once more. Two tips, no disturbance, and the key.
    drawn = [each for each in outlines if len(each) == 8 and np.isfinite(each).all()]
    lengths = []
    for side, arrow in enumerate(drawn[:2]):
        tail, head = 0.5 * (arrow[0] + arrow[6]), arrow[3]
        at = 1e3 * outline.contact_point(run.scene, shown.q, side)
        np.testing.assert_allclose(tail, at, atol=1e-6)
        turned = (head - tail) / np.linalg.norm(head - tail)
        force = shown.contact[side]
        np.testing.assert_allclose(turned, force / np.linalg.norm(force), atol=1e-9)
        lengths.append(np.linalg.norm(head - tail) / np.linalg.norm(force))
    key = drawn[2]
    newtons = float(next(word for word in texts(figure) if word.endswith(" N"))[:-2])
    lengths.append(np.linalg.norm(key[3] - 0.5 * (key[0] + key[6])) / newtons)
    np.testing.assert_allclose(lengths, lengths[0])


HIT = sp.Scene(
    duration=0.1,
    disturbances=(
        sp.Impulse(time=0.02, impulse=(0.03, 0.0)),
        sp.Impulse(time=0.02, impulse=(0.0, 0.04), angular_impulse=-1e-4),
        sp.Impulse(time=0.06, impulse=(-0.1, 0.0)),
        sp.Impulse(time=0.1, impulse=(9.0, 0.0)),  # the run ends before it
    ),
)


def impulse_arrow(run: sp.Run, t: float) -> np.ndarray | None:
    """The arrow of an impulse, mm, from the centre of the object."""
    figure = plot.snapshot(run, t)
    white = [each.get_xy() for each in figure.axes[0].patches if isinstance(each, Polygon)
             and to_hex(each.get_edgecolor()) == PURPLE.lower()]  # fmt: skip
    (corners,) = white
    if np.isnan(corners).any():
        return None
    (shown,) = instants(run, np.array([t]), False)
    np.testing.assert_allclose(0.5 * (corners[0] + corners[6]), 1e3 * shown.q[:2], atol=1e-9)
    return np.asarray(corners[3] - 1e3 * shown.q[:2])


def test_impulses_are_shown_for_a_twentieth_of_the_run() -> None:
    run = sp.simulate(HIT, 1e-3)
    for time in (0.0, 0.0199, 0.0251, 0.0599, 0.0651, 0.1):
        assert impulse_arrow(run, time) is None, time
    first, last = impulse_arrow(run, 0.02), impulse_arrow(run, 0.0649)
    assert first is not None and last is not None
    # Impulses at one instant are one, and the largest of the run has the longest arrow.
    np.testing.assert_allclose(first / np.linalg.norm(last), [0.3, 0.4], atol=1e-9)
    np.testing.assert_allclose(last / np.linalg.norm(last), [-1.0, 0.0], atol=1e-9)
    assert "impulse 0.05 N s, \N{MINUS SIGN}0.0001 N m s" in texts(plot.snapshot(run, 0.022))
    assert not any("impulse" in word for word in texts(plot.snapshot(run, 0.022, forces=False)))


def test_a_film_shows_each_impulse_in_a_frame() -> None:
    run = sp.simulate(HIT, 1e-3)
    found = instants(run, np.array([0.0, 0.05, 0.1]), True)
    assert [each.impulse[0] for each in found] == [0.0, 0.03, -0.1]


def test_a_tip_has_the_colour_of_its_mode(slipping: sp.Run) -> None:
    figure = plot.snapshot(slipping, 0.025)
    (shown,) = instants(slipping, np.array([0.025]), False)
    assert shown.modes is not None
    tips = [figure.axes[0].patches[k] for k in (2, 10)]
    wanted = [to_hex(COLORS[mode]) for mode in shown.modes]
    assert [to_hex(tip.get_facecolor()) for tip in tips] == wanted
    named = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert "slips" in named
