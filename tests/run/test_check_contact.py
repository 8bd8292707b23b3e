"""`Run.check` of unilateral contact: sound runs pass, and each invariant is seen to fail."""

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch import _core
from unilateral_parts import grasp
from unilateral_scenes import RECORD, gripped, pushes, regripped, thrown

FREE, STICK, SLIP, GRAZE = sp.ContactMode


@given(
    pushes(),
    st.sampled_from(["csm", "projected"]),
    st.sampled_from(_core.METHODS),
    st.sets(st.sampled_from(RECORD)),
    st.integers(1, 40),
    st.sets(st.sampled_from(_core.VIOLATIONS)),
)
def test_sound_runs_pass_whatever_is_recorded(
    scene: sp.Scene, formulation: str, method: str, record: set[str], every: int, stops: set[str]
) -> None:
    how: dict[str, Any] = {"method": method, "formulation": formulation, "stop_on": stops}
    run = sp.simulate(scene, dt=1e-4, every=every, record=sorted(record), **how)
    # Strong pushes leave drift behind, and a long step leaves errors in the ledger.
    assert run.check(residual=1e-2, closure=0.1) is run


@pytest.mark.parametrize("make", [thrown, regripped])
@pytest.mark.parametrize("formulation", ["csm", "projected"])
def test_sound_runs_pass_with_the_usual_limits(
    make: Callable[[], sp.Scene], formulation: str
) -> None:
    run = sp.simulate(make(), formulation=formulation, record=RECORD)
    assert run.check() is run
    adaptive = sp.simulate(
        make(), tolerance=1e-8, method="radau5", formulation=formulation, record=RECORD
    )
    assert adaptive.check() is adaptive


def struck(**changes: Any) -> sp.Scene:
    """The object moves sideways at the start: one tip opens, the impact stops the other's slip."""
    scene = gripped(disturbances=[sp.Step(time=0.01, force=(0.0, -200.0))], **changes)
    start = sp.State.consistent(scene, fingers=np.deg2rad([3.0, 3.0]))
    rates = np.array([0.1, 0.02, *[0.0] * 7])
    return replace(scene, initial=replace(start, p=rates))


def test_a_slip_that_an_impact_stops_at_the_start_has_not_lasted() -> None:
    run = sp.simulate(struck(), record=RECORD)
    first = run.contact_changes[0]
    assert (first.time, first.before, first.after) == (0.0, SLIP, STICK)
    assert run.violations == {"opened": 0.0, "slipping": 0.01}
    assert run.violation_intervals["slipping"][0, 0] == 0.01
    run.check()


@pytest.mark.parametrize(
    ("kind", "seed", "method"),
    [("jaw", 10, "dop853"), ("power law", 115, "radau5"), ("mixed", 64, "rosenbrock")],
)
def test_a_multiplier_that_starts_from_zero_has_the_error_of_its_event(
    kind: str, seed: int, method: str
) -> None:
    """After a graze lambda^H begins with some -1e-8 N."""
    scene = grasp(kind, seed, duration=0.03)
    run = sp.simulate(scene, method=method, tolerance=1e-6, record=("multipliers", "contact"))
    assert run.check() is run


def test_a_run_that_ends_as_it_starts_closes_its_ledger_to_round_off() -> None:
    scene = gripped(grasped=sp.GraspedObject(height=0.01))
    height = sp.State.consistent(scene).q[1]
    beyond = sp.State.consistent(
        scene,
        y=height + 0.01,  # the tips are below the face
        rotation=0.1,
        fingers=np.deg2rad([3.0, 3.0]),
        velocity=(0.1, -0.3, 1.0),
    )
    run = sp.simulate(replace(scene, initial=beyond), record=RECORD)
    assert run.status == "lost" and run.t[-1] < 1e-12
    run.check()


@pytest.fixture(scope="module")
def run() -> sp.Run:
    run = sp.simulate(thrown(), record=RECORD)
    assert {*run.contact.ravel()} == {FREE, STICK, SLIP, GRAZE}
    assert run.status == "lost"
    return run


def altered(run: sp.Run, change: Callable[[dict[str, Any]], object], **options: Any) -> sp.Run:
    """The run with another result."""
    result = {
        name: np.array(value) if isinstance(value, np.ndarray) else copy.copy(value)
        for name, value in run._result.items()
    }
    change(result)
    return sp.Run(run.scene, replace(run._options, **options), result)


def first(run: sp.Run, mode: sp.ContactMode) -> tuple[int, int]:
    """Row and side of a tip in a mode, not at the very instant of a change."""
    times = [change.time for change in run.contact_changes]
    rows = np.argwhere((run.contact == mode) & ~np.isin(run.t, times)[:, None])
    row, side = map(int, rows[len(rows) // 2])
    return row, side


def put(name: str, mode: sp.ContactMode, column: int, factor: float, extra: float = 0.0) -> Any:
    """A change of one number of a row: of the right column for the side that has the mode."""

    def change(run: sp.Run) -> Callable[[dict[str, Any]], object]:
        row, side = first(run, mode)
        at = row, column + side

        def work(result: dict[str, Any]) -> None:
            result[name][at] = factor * result[name][at] + extra

        return work

    return change


def fall(column: int) -> Any:
    """A change of the ledger: a loss that falls in the last row, and a change that balances it."""

    def work(result: dict[str, Any]) -> None:
        result["energy"][-1, column] = 0.5 * result["energy"][-2, column]

    return lambda _: work


def entry(name: str, value: Any) -> Any:
    return lambda _: lambda result: result.__setitem__(name, value)


BROKEN: dict[str, Any] = {
    r"^lambda\^H >= 0: the (right|left) tip is in STICK with .* N at t = .* \(row": put(
        "multipliers", STICK, 0, -1.0
    ),
    r"^no force without contact: the left tip is in FREE": put("multipliers", FREE, 0, 1.0, 1e-9),
    r"^no force without contact: the left tip is in GRAZE": put("multipliers", GRAZE, 2, 1.0, -1.0),
    r"^\|lambda\^N\| <= mu lambda\^H: the (right|left) tip is in STICK": put(
        "multipliers", STICK, 2, 0.0, 1e3
    ),
    r"^\|lambda\^N\| = mu lambda\^H in slip: the (right|left) tip is in SLIP": put(
        "multipliers", SLIP, 2, 0.999
    ),
    r"^constraint C_[12]\^H: 1\.0.*e-04 m": put("residuals", SLIP, 0, 1.0, 1e-4),
    r"^constraint C_2\^H: 1\.0.*e-04 m": put("residuals", GRAZE, 0, 1.0, 1e-4),
    r"^constraint C_[12]\^N: ": put("residuals", STICK, 2, 1.0, 0.1),
    r"^gap >= 0 \(C_2\^H\): the free tip is at -.* m at t": put("residuals", FREE, 0, -1.0, -1e-4),
    r"^friction_loss never falls: it falls by .* J": fall(7),
    r"^contact modes: the left tip is STICK, its changes lead to FREE": put(
        "contact", FREE, 0, 0.0, 1
    ),
    r"^contact changes: the left tip leaves SLIP at 0.0448.* s in GRAZE": lambda _: (
        lambda result: result["contact_changes"].__setitem__(4, (0.0448, "left", 2, 0, "share"))
    ),
    r"^violation slipping: the modes show it at 0.04 s first, the run reported 0.041": entry(
        "violations", {"slipping": 0.041, "opened": 0.044811033108933}
    ),
    r"^violation opened: the modes show it at 0.0448.* s first, the run reported None": entry(
        "violations", {"slipping": 0.04}
    ),
    r"^holds: it is True, the status and the last modes say False": entry("holds", True),
    r"^status opened: it began at .* s, before the last step": entry("status", "opened"),
    r"^status folded: the run did not report": entry("status", "folded"),
    r"^status completed: the run should have": entry("status", "completed"),
}


@pytest.mark.parametrize("message", BROKEN)
def test_check_names_the_broken_invariant(run: sp.Run, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        altered(run, BROKEN[message](run)).check(closure=np.inf)


def test_impacts_only_take_energy() -> None:
    run = sp.simulate(regripped(), record=RECORD)
    assert run.energy.impact_loss[-1] > 1e-3
    with pytest.raises(AssertionError, match=r"^impact_loss never falls: it falls by"):
        altered(run, fall(8)(run)).check(closure=np.inf)


def test_the_ledger_counts_friction_and_impacts() -> None:
    run = sp.simulate(regripped(), record=RECORD).check()
    for column in (7, 8, 9):

        def forget(result: dict[str, Any], column: int = column) -> None:
            result["energy"][:, column] = 0.0

        with pytest.raises(AssertionError, match=r"^energy ledger closes"):
            altered(run, forget).check(closure=1e-7)


@pytest.mark.parametrize("stop_on", ["slipping", "opened"])
def test_a_violation_that_should_have_ended_the_run_is_found(run: sp.Run, stop_on: str) -> None:
    with pytest.raises(AssertionError, match=f"status lost: {stop_on} at .* should have ended"):
        altered(run, lambda _: None, stop_on=(stop_on,)).check()


def test_a_lost_object_is_beyond_the_end_of_a_face(run: sp.Run) -> None:
    taller = replace(run.scene, grasped=replace(run.scene.grasped, height=0.06))
    with pytest.raises(AssertionError, match="status lost: both contacts are within the faces"):
        sp.Run(taller, run._options, run._result).check()


def test_modes_that_were_not_recorded_are_those_of_the_states() -> None:
    bare = sp.simulate(thrown(), record=("state", "multipliers"))
    row, side = first(sp.simulate(thrown(), record=("contact", "state")), SLIP)

    def stick(result: dict[str, Any]) -> None:
        result["contacts"][row, side] = 1.0

    bare.check()
    with pytest.raises(AssertionError, match=r"^contact modes: the .* tip is STICK, its changes"):
        altered(bare, stick).check()
    modes = sp.simulate(thrown(), record="multipliers")
    assert modes.check() is modes
