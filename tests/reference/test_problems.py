"""The data of the reference problems: whole, small, read without softpinch, and right."""

import math
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch.scene.fields import PARAMETERS
from softpinch.support import toml

ROOT = Path(__file__).parents[2] / "reference"
sys.path.append(str(ROOT))

import score  # noqa: E402
from definitions import PROBLEMS  # noqa: E402
from oracle import unilateral  # noqa: E402

NAMES = sorted(path.name for path in score.FOLDER.iterdir())
RARES = (score.RARE, score.RARER)
WITH_ROWS = [name for name in NAMES if name not in RARES]


def facts(name: str) -> dict[str, Any]:
    return tomllib.loads((score.FOLDER / name / "problem.toml").read_text("utf-8"))


def scene(name: str) -> sp.Scene:
    return sp.Scene.from_toml(toml.dumps(facts(name)["scene"], "scene"))


def keys(values: Any, path: str = "") -> set[str]:
    """The paths of a scene's keys, without indices, and with "right" for "left"."""
    if isinstance(values, dict):
        inner = {"right" if k == "left" else k: v for k, v in values.items()}
        return {found for k, v in inner.items() for found in keys(v, f"{path}.{k}".strip("."))}
    if isinstance(values, list) and values and isinstance(values[0], dict):
        return {found for each in values for found in keys(each, path)}
    return set() if values == [] else {path}


def test_every_key_of_a_scene_has_a_line_with_its_symbol_and_unit() -> None:
    lines = {}
    for line in (ROOT / "README.md").read_text("utf-8").split("| key |")[1].splitlines():
        if line.startswith("| `"):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            lines |= {name.strip("`"): cells for name in cells[0].split(", ")}
    for name in NAMES:
        assert keys(facts(name)["scene"]) <= set(lines)
    known = {each.path: each for each in PARAMETERS}
    greek = {"kappa": "κ", "mu": "μ"}
    for key in set(lines) & set(known):
        unit, symbol = known[key].unit, known[key].symbol
        if isinstance(unit, str) and key != "schedule.angles":
            assert lines[key][2] == unit
        if symbol:
            assert lines[key][1] == greek.get(symbol, symbol)


def test_there_are_twenty_problems_in_less_than_1_2_megabytes() -> None:
    assert len(NAMES) >= 20
    files = [path for path in ROOT.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    assert sum(path.stat().st_size for path in files) < 1_200_000


@pytest.mark.parametrize("name", NAMES)
def test_a_problem_has_a_scene_with_every_number(name: str) -> None:
    data = facts(name)
    assert data["name"] == name
    assert data["version"] == score.VERSION
    assert (ROOT.parent / data["equations"]).is_file()
    loaded = scene(name)
    assert loaded.initial is not None
    # What softpinch would take for granted is in the file: masses of the tips, and the start.
    tip = data["scene"]["hand"]["tip"]
    assert {"radius", "normal_viscosity", "tangential_viscosity", "tilt_coupling"} <= set(tip)
    assert {"q", "p", "integral"} <= set(data["scene"]["initial"])
    assert set(data["scene"]) >= {"gravity", "duration", "fingers", "contact", "schedule"}


@pytest.mark.parametrize("name", WITH_ROWS)
def test_a_solution_is_right_to_1e_9_as_far_as_three_others_say(name: str) -> None:
    agreement = facts(name)["agreement"]
    assert set(agreement) == {"formulation", "method", "independent"}
    for check in agreement.values():
        assert {"q", "p", "multipliers", "events"} <= set(check)
        assert max(check.values()) <= 1e-9


def test_tips_that_relax_are_not_those_that_do_not() -> None:
    _, exact = score.solution("26-relaxing")
    scene_of = scene("26-relaxing")
    plain = [replace(tip, relaxation=None) for tip in scene_of.hand.tips]
    bare = replace(scene_of, hand=replace(scene_of.hand, tip=tuple(plain)))
    times = exact.rows[:, 0]
    record = ("state", "multipliers", "energy")
    run = sp.simulate(bare, times=times, dt=1e-4, stop_on=(), record=record)
    rows = np.column_stack([run.t, run.q, run.p, run.multipliers, exact.rows[:, -1]])
    off = score.differences(exact.rows, rows, exact.rows)
    assert min(off["q"], off["multipliers"]) > 5e-3


def test_the_independent_simulation_holds_a_load_with_steps_that_grow() -> None:
    _, exact = score.solution("03-held")
    rows = exact.rows[exact.rows[:, 0] <= 2.0]
    found = unilateral(scene("03-held").with_({"duration": 2.0}), rows[:, 0], "Radau")
    mine = np.column_stack([found.t, found.q, found.p, found.multipliers, rows[:, -1]])
    assert len(rows) >= 6 and found.changes == []
    assert max(score.differences(rows, mine, exact.rows).values()) < 1e-9


def test_a_measured_law_is_given_with_the_fit() -> None:
    interpolate = pytest.importorskip("scipy.interpolate")
    data = facts("23-measured")
    given, reach = data["scene"]["hand"]["tip"]["law"], data["law"]["range"]
    assert reach == given["compression"][-1]
    weights = np.array(data["law"]["weights"])[:, None]
    force = interpolate.BPoly(weights, [0.0, reach]).antiderivative(2)
    law = scene("23-measured").hand.tips[0].law
    at = np.linspace(0.0, reach, 30)
    np.testing.assert_allclose(force(at), law.predicted(at), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(force(given["compression"]), given["force"], atol=0.5)


@pytest.mark.parametrize("name", WITH_ROWS)
def test_rows_and_events_are_in_order_and_apart(name: str) -> None:
    data, exact = score.solution(name)
    assert np.isfinite(exact.rows).all()
    assert len(exact.rows) == data["answer"]["rows"]
    t = exact.rows[:, 0]
    assert (np.diff(t) > 0).all()
    moments = [event[0] for event in exact.events or []]
    assert moments == sorted(moments)
    for moment in moments:
        assert np.abs(t[1:] - moment).min() >= 2e-6
    assert (exact.lost is not None) == (data["answer"]["status"] == "lost")


def columns(rows: np.ndarray, start: str) -> np.ndarray:
    return rows[:, [k for k, name in enumerate(score.COLUMNS) if name.startswith(start)]]


@pytest.mark.parametrize(
    "name", [n for n in WITH_ROWS if facts(n)["scene"].get("contact") != "bilateral"]
)
def test_forces_are_within_the_cone(name: str) -> None:
    friction = facts(name)["scene"]["friction"]
    if isinstance(friction, dict):
        friction = [friction["right"], friction["left"]]
    rows = score.solution(name)[1].rows
    normal, tangential = columns(rows, "normal"), columns(rows, "tangential")
    assert (normal >= 0.0).all()
    assert (np.abs(tangential) <= np.multiply(friction, normal) * (1 + 1e-9) + 1e-9).all()


# Other pairs than those that computed and checked the solutions, with the steps of users.
OTHERS = {
    "04-lost": {"method": "rosenbrock", "formulation": "projected", "tolerance": 1e-10},
    "10-slip": {"method": "rk4", "formulation": "csm", "dt": 2e-5},
    "14-impact": {"method": "rosenbrock", "formulation": "csm", "dt": 1e-5},
    "23-measured": {"method": "rk4", "formulation": "projected", "dt": 2e-5},
    "26-relaxing": {"method": "rosenbrock", "formulation": "csm", "dt": 1e-5},
}


@pytest.mark.parametrize("name", OTHERS)
def test_another_method_solves_a_problem(name: str) -> None:
    data, exact = score.solution(name)
    contact = ("contact",) if data["scene"]["contact"] == "unilateral" else ()
    run = sp.simulate(
        scene(name),
        times=exact.rows[:, 0],
        record=("state", "multipliers", "energy", *contact),
        stop_on=(),
        **OTHERS[name],
    )
    n = len(exact.rows)
    ledger = run.energy
    energy = ledger.kinetic + ledger.gravity + ledger.elastic.reshape(len(run.t), -1).sum(axis=1)
    rows = np.column_stack([run.t, run.q, run.p, run.multipliers, energy])[:n]
    changes = (
        [
            (c.time, c.finger, c.before.name.lower(), c.after.name.lower())
            for c in run.contact_changes
        ]
        if contact
        else []
    )
    if run.status == "lost":
        changes.append((run.t[-1], "object", "held", "lost"))
    found = score.score(name, score.Answer(rows, changes))
    assert found.failures == []
    assert max(v for k, v in found.errors.items() if k != "events") < 1e-7
    assert found.errors["events"] < 1e-9


def test_the_equilibria_are_those_of_the_balance_of_forces() -> None:
    for name, share in (("01-rest", 0.1), ("02-rest-half", 0.5)):
        rows = score.solution(name)[1].rows
        weight = 0.1 * 9.81
        np.testing.assert_allclose(columns(rows, "normal"), weight / share, rtol=1e-10)
        np.testing.assert_allclose(columns(rows, "tangential"), weight / 2, rtol=1e-9)
        # F = pi E d_n^2 of an upright tip.
        pressed = math.sqrt(weight / share / (math.pi * 3e5))
        np.testing.assert_allclose(columns(rows, "dn"), pressed, rtol=1e-2)
        np.testing.assert_array_less(np.abs(np.diff(rows[:, 1:10], axis=0)), 1e-15)


def test_the_problems_are_those_of_the_definitions() -> None:
    assert sorted([*(problem.name for problem in PROBLEMS), *RARES]) == NAMES
    for problem in PROBLEMS:
        assert facts(problem.name)["title"] == problem.title
        assert facts(problem.name)["statement"] == problem.statement


@pytest.mark.parametrize("name", RARES)
def test_the_probability_is_the_integral_over_what_is_just_held(name: str) -> None:
    stats = pytest.importorskip("scipy.stats")
    data = facts(name)
    friction, force = data["random"]["friction"], data["random"]["disturbances.0.force.1"]
    pairs = np.array([(each["friction"], each["force"]) for each in data["answer"]["just_held"]])
    held = np.polynomial.Polynomial.fit(*pairs.T, len(pairs) - 1)
    points = np.linspace(friction["from"], friction["to"], 20_001)
    above = stats.norm.sf(held(points), -force["mean"], force["standard_deviation"])
    exact = data["answer"]["probability"]
    assert np.trapezoid(above, points) / np.ptp(points) == pytest.approx(exact, rel=1e-5)
    answer = data["answer"]
    checked = answer["plain"] if name == score.RARE else answer["weighted"]
    low, high = checked["interval_99_percent"]
    if name == score.RARE:
        assert (low, high) == score.wilson(checked["failures"], checked["runs"])
    assert low < exact < high < score.WIDEST * low
    assert checked["draws_above_what_is_held"] == checked["failures"]


def test_the_rarer_one_happens_once_in_a_million_times() -> None:
    assert facts(score.RARER)["answer"]["probability"] == pytest.approx(1e-6, rel=0.05)


def test_a_little_more_than_what_is_just_held_loses_the_object() -> None:
    pair = facts(score.RARE)["answer"]["just_held"][5]
    for more, status in ((-1e-4, "completed"), (1e-4, "lost")):
        push = (0.0, -pair["force"] - more)
        changed = {"friction": pair["friction"], "disturbances.0.force": push}
        run = sp.simulate(
            scene(score.RARE).with_(changed), method="rosenbrock", dt=1e-4, record=("state",)
        )
        assert run.status == status
