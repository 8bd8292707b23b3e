"""Objects show ten lines at most in a terminal, and well-formed tables in a notebook."""

import html
import inspect
import re
from dataclasses import replace
from enum import IntEnum
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import callables
import softpinch as sp
from softpinch import strategies
from softpinch.scene.outline import finger_outline
from softpinch.support.display import ShownTable, html_of, short
from softpinch.support.result import Result
from test_results import KINDS, results


class Cells(HTMLParser):
    """The texts of the cells of all tables; raises where tags are not closed in their order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.cells: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-1:] in (["td"], ["th"]):
            self.cells[-1] += data


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_takes_ten_lines_of_a_terminal_at_most(kind: str) -> None:
    lines = repr(results()[kind]).splitlines()
    assert 1 <= len(lines) <= 10
    assert lines[0].startswith(f"<{kind}")
    # Of a fit, sentences say what the data do not determine.
    assert kind == "Fit" or max(map(len, lines)) <= 101


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_has_tables_in_a_notebook(kind: str) -> None:
    result = results()[kind]
    shown = result._repr_html_()
    cells = Cells(shown).cells
    if type(result).__repr__ is not sp.Modes.__repr__:
        return
    for name, value in result._values().items():
        if isinstance(value, tuple) and value and isinstance(value[0], Result):
            assert f">{name}</caption>" in shown
        elif value is not None and not (isinstance(value, float) and np.isnan(value)):
            assert name in cells


def test_modes_are_listed_by_their_growth() -> None:
    modes = callables.modes()
    (table,) = modes._tables()
    growth = [row[1] for row in table.rows]
    assert growth == sorted(growth, reverse=True)
    small = np.abs(modes.rates[0]) < 1e-9 * np.abs(modes.rates[0]).max()
    turning = np.count_nonzero(modes.rates[0][~small].imag > 0.0)
    assert len(table.rows) == modes.rates.shape[1] - turning
    neutral = [row[1:] for row in table.rows if row[0] == "neutral"]
    assert neutral == [(0.0, 0.0, "")] * np.count_nonzero(small)
    # x'' + 2 D w x' + w^2 x = 0 has the eigenvalues -D w +- i w sqrt(1 - D^2).
    for _, real, hertz, damping in table.rows:
        size = np.hypot(real, 2.0 * np.pi * hertz)
        assert size == 0.0 or real == pytest.approx(-damping * size)


def test_the_ledger_shows_where_the_energy_went() -> None:
    ledger = sp.simulate(sp.Scene(duration=0.01), dt=1e-3, record="energy").energy
    (table,) = ledger._tables()
    rows = {name: numbers for name, *numbers in table.rows}
    assert rows["viscous loss"][1] == ledger.viscous_loss[-1] > 0.0
    assert rows["closure"][2] == np.abs(ledger.closure).max()


def test_an_ensemble_shows_shares_and_distributions() -> None:
    some = sp.monte_carlo(
        sp.Scene(disturbances=[sp.Step(time=0.0)], duration=0.02),
        vary={"disturbances.0.force": sp.Uniform((-300, -300), (300, 300)), "gravity": [9, 8] * 10},
        runs=20,
        dt=1e-3,
        seed=3,
        summaries=("peak_rotation", "final_state"),
        progress=False,
    )
    shares, numbers = some._tables()
    assert {row[0]: row[1] for row in shares.rows[:-1]} == some.counts()
    assert shares.rows[-1][:2] == ("holds", np.count_nonzero(some.holds))
    assert len(some.counts()) > 1
    for name, count, share, _ in shares.rows:
        assert float(share) == count / 20 == some.probability(name).value
    assert [row[0] for row in numbers.rows] == [
        "disturbances.0.force.0 [N]",
        "disturbances.0.force.1 [N]",
        "gravity [m/s^2]",
        "peak_rotation [rad]",
    ]
    found = some["peak_rotation"]
    known = found[np.isfinite(found)]
    expected = [known.mean(), known.std(ddof=1), known.min(), np.median(known), known.max()]
    np.testing.assert_allclose(numbers.rows[-1][1:6], expected, rtol=1e-14)
    assert numbers.rows[-1][6] == 20 - len(known)
    assert "peak_rotation [rad]" in Cells(some._repr_html_()).cells


def test_a_scene_that_cannot_start_has_no_drawing() -> None:
    apart = sp.Scene(grasped=sp.GraspedObject(width=0.03))
    with pytest.raises(ValueError, match="does not reach"):
        apart.start()
    shown = apart._repr_html_()
    assert "<svg" not in shown and "grasped.width" in Cells(shown).cells


def test_what_matters_is_a_table() -> None:
    found = sp.sensitivity(callables.many(), "peak_rotation")
    head, *rows = repr(found).splitlines()
    assert head.split() == ["varied", "share", "noise", "rank", "correlation", "runs"]
    assert [row.split()[0] for row in rows] == list(found)
    assert repr(found).count("4") >= 2 and "Effect(" not in repr(found)
    cells = Cells(found._repr_html_()).cells
    assert cells[:2] == ["varied", "share"] and set(found) <= set(cells)
    assert isinstance(found, dict) and found == dict(found)
    many = sp.study.effects.Effects({str(k): sp.Effect(0.1, 0.0, 0.5, 9) for k in range(30)})
    assert len(repr(many).splitlines()) == 10 and repr(many).endswith("and 22 more")


@pytest.mark.parametrize("t", [0.0, 0.4])
def test_a_scene_is_drawn_with_all_its_numbers(t: float) -> None:
    scene = sp.Scene(initial=sp.State(sp.Scene().start().q, time=t))
    shown = scene._repr_html_()
    assert f"start, t = {t:g} s" in shown
    # Object and its centre, two tips, links and joints.
    assert shown.count("<polygon") == 8
    assert set(scene.vary_paths()) <= set(Cells(shown).cells)


def test_a_run_is_drawn_at_three_instants() -> None:
    pushed = sp.Scene(disturbances=[sp.Step(time=0.01, force=(200.0, 0.0))], duration=0.1)
    run = sp.simulate(pushed, dt=1e-3)
    assert run.violations
    shown = run._repr_html_()
    cells = Cells(shown).cells
    assert {run.message, "holds", str(run.stats["steps"]), *run.violations} <= set(cells)
    for k in (0, len(run.t) // 2, -1):
        assert f"t = {run.t[k]:.6g} s<" in shown
    assert shown.count("<polygon") == 24
    # Without recorded states there is a drawing of the start.
    bare = sp.simulate(pushed, dt=1e-3, record=())._repr_html_()
    assert bare.count("<polygon") == 8


def test_a_rest_and_a_grip_are_drawn_where_they_rest() -> None:
    rest = sp.equilibrium(callables.SCENE)
    held = sp.grip(callables.SCENE, 5.0)
    for shown, scene, found in (
        (rest._repr_html_(), callables.SCENE, rest),
        (held._repr_html_(), held.scene, held.equilibrium),
    ):
        assert found.state is not None
        assert html.escape(found.message) in shown
        assert shown.count("<polygon") == 8
        # A scene that starts from the state at rest is drawn so.
        started = replace(scene, initial=found.state)._picture()
        outline = re.compile(r"<g .*</g>")
        assert outline.findall(shown) == outline.findall(started)
    away = sp.Schedule.in_degrees("steps", [0.0], [[-30, -30]])
    nowhere = sp.equilibrium(sp.Scene(schedule=away))
    assert nowhere.state is None and "<svg" not in nowhere._repr_html_()


def test_a_probability_is_a_table_with_its_interval() -> None:
    # Wilson's interval for 0 of n ends at z^2 / (n + z^2), with z = 1.96 for 95 %.
    shown = Cells(sp.Estimate.counted(0, 10)._repr_html_()).cells
    cells = dict(zip(shown[: len(shown) // 2], shown[len(shown) // 2 :], strict=True))
    assert float(cells["high"]) == pytest.approx(1.96**2 / (10.0 + 1.96**2), rel=1e-4)
    assert [cells[name] for name in ("value", "low", "happened", "runs")] == ["0", "0", "0", "10"]
    assert cells["confidence"] == "0.95"


@given(strategies.scenes(spread=2.0))
def test_a_drawing_shows_all_of_the_hand(scene: sp.Scene) -> None:
    root = ElementTree.fromstring(scene._picture())
    width, height = (float(root.get(name, "nan")) for name in ("width", "height"))
    outline = np.concatenate([finger_outline(scene, scene.start().q, side).tip for side in (0, 1)])
    (panel,) = root.iter("{http://www.w3.org/2000/svg}g")
    x, y, across, up = map(float, re.findall(r"[-\d.]+", panel.get("transform", "")))
    places = np.array([x, y]) + outline * 1e3 * [across, up]
    assert (places >= 0.0).all() and (places <= [width, height]).all()


def test_all_that_is_public_shows_itself_in_a_notebook() -> None:
    classes = {name: v for name in sp.__all__ if inspect.isclass(v := getattr(sp, name))}
    without = {
        name
        for name, cls in classes.items()
        if not hasattr(cls, "_repr_html_") and not issubclass(cls, BaseException | tuple | IntEnum)
    }
    # Only functions that measure take it.
    assert without == {"Peer"}


@pytest.mark.parametrize("n", [None, 200])
def test_what_a_simulator_sees_takes_ten_lines_at_most(n: int | None) -> None:
    scene = sp.Scene(control=sp.Torque())
    sim = sp.Simulator(scene) if n is None else sp.VectorSimulator(scene, n=n)
    assert len(repr(sim.reset()).splitlines()) <= 10
    assert Cells(sim._repr_html_())


@given(st.text(), st.booleans())
def test_a_notebook_reads_no_text_as_html(text: str, folded: bool) -> None:
    table = ShownTable((text, "b"), [([text] * 99, text)], caption=text, folded=folded)
    read = Cells(html_of("", [table])).cells
    assert len(read) == 4
    # A parser gives line ends and NUL as other characters.
    if text.isprintable():
        assert read[0] == short(text)


def test_a_record_in_a_table_has_six_digits() -> None:
    schedule = sp.Schedule.steps([0.0], [[np.pi / 30.0, np.e / 10.0]])
    assert "[[0.10472, 0.271828]]" in short(schedule)
    assert "0.3333" in repr(sp.Uniform(0.1, 1 / 3)) and "0.333333)" in short(sp.Uniform(0.1, 1 / 3))
