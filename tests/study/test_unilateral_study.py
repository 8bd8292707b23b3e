"""Studies with unilateral contact: lanes as lone runs, what can be asked, and what it means."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import softpinch as sp
from ensembles import require_alone
from softpinch import paper, strategies
from softpinch.scene.fields import label
from unilateral_scenes import regripped

FORCE = "disturbances.0.force"
VARY: dict[Any, Any] = {
    FORCE: sp.Uniform((-300.0, -300.0), (300.0, 300.0)),
    "friction.left": sp.Uniform(0.1, 1.2),
}
# A push that some grasps survive, and faces so low that others lose the object.
PUSHED = replace(
    paper.disturbance("ii", duration=1.06),
    contact="unilateral",
    friction=(0.5, 0.8),
    grasped=replace(paper.disturbance("ii").grasped, height=0.049),
)
SUMMARIES = ("final_state", "slip_distance", "free_time", "peak_friction_ratio", "pulling_time")


def study(runs: int = 120, scene: sp.Scene = PUSHED, **how: Any) -> Any:
    given = {"dt": 5e-4, "seed": 5, "vary": VARY, "progress": False, **how}
    return sp.monte_carlo(scene, runs, summaries=SUMMARIES, **given)


@cache
def some() -> sp.Ensemble:
    found: sp.Ensemble = study()
    return found


HOW: list[dict[str, Any]] = [
    {"dt": 1e-3},
    {"dt": 1e-3, "formulation": "projected"},
    {"dt": 1e-3, "method": "dop853"},
    {"dt": 1e-3, "method": "rosenbrock"},
    {"tolerance": 1e-6, "method": "dop853", "formulation": "projected"},
    {"tolerance": 1e-5, "method": "rosenbrock"},
]


@pytest.mark.parametrize("how", HOW, ids=str)
@settings(max_examples=8)
@given(scene=strategies.scenes(duration=0.03, force=30.0, contact="unilateral"), data=st.data())
def test_a_row_is_what_the_run_alone_says_and_its_place_does_not_matter(
    how: dict[str, Any], scene: sp.Scene, data: st.DataObject
) -> None:
    """Runs in the same lanes slip, open and end at other instants, and must not notice it."""
    runs = 6
    order = np.array(data.draw(st.permutations(range(runs))))
    mass = np.linspace(0.7, 1.3, runs) * scene.grasped.mass
    friction = np.linspace(0.1, 1.3, runs)

    def together(scene: sp.Scene, order: Any) -> sp.Ensemble:
        vary = {"grasped.mass": mass[order], "friction.right": friction[order]}
        found: sp.Ensemble = sp.monte_carlo(
            scene, vary=vary, summaries=SUMMARIES, progress=False, **how
        )
        return found

    # A run's number keys its noise.
    pushes = [one for one in scene.disturbances if not isinstance(one, sp.Noise)]
    quiet = replace(scene, disturbances=pushes)
    here, permuted = together(quiet, slice(None)), together(quiet, order)
    # A run replayed has the energy ledger, whose squares overflow earlier than the motion.
    assume("not_finite" not in here.status)
    for name in ("status", "message", "end_time", "steps", "holds", *SUMMARIES):
        np.testing.assert_array_equal(here[name][order], permuted[name], err_msg=name)
    for name, times in here.violations.items():
        np.testing.assert_array_equal(times[order], permuted.violations[name], err_msg=name)
    noisy = together(scene, order)
    for run in (0, runs - 1):
        require_alone(noisy, run)


@pytest.mark.usefixtures("simd_level")
def test_runs_that_slip_open_and_end_are_what_they_are_alone() -> None:
    ensemble = study(24, dt=1e-3)
    seen = ensemble.violations
    assert 0 < np.isfinite(seen["opened"]).sum() < np.isfinite(seen["slipping"]).sum()
    for run in range(24):
        require_alone(ensemble, run)


def free_time(run: sp.Run, after: float) -> float:
    """The time during which a tip is free, from the changes of the modes."""
    total, last = 0.0, after
    modes = dict(zip(("right", "left"), run.contact[0].tolist(), strict=True))
    changes = [(c.time, c.finger, int(c.after)) for c in run.contact_changes]
    for time, finger, mode in [*changes, (float(run.t[-1]), "right", 0)]:
        if time > last:
            total += (time - last) * (0 in modes.values())
            last = time
        modes[finger] = mode
    return total


@pytest.mark.parametrize("after", [None, 1.005])
def test_the_summaries_are_those_of_the_recorded_modes(after: float | None) -> None:
    """A step in which a slip begins or ends counts by half, or not at all."""
    ensemble = study(12, dt=2e-5, summaries_after=after)
    begin = 0.0 if after is None else after
    assert np.nansum(ensemble["free_time"] > 0.0) > 2 and ensemble.holds.any()
    for run in range(12):
        alone = ensemble.replay(run)
        if alone.t[-1] < begin:
            assert np.isnan(ensemble["free_time"][run]) and np.isnan(ensemble["slip_distance"][run])
            continue
        assert ensemble["free_time"][run] == pytest.approx(free_time(alone, begin), abs=1e-12)
        slips = (alone.contact == sp.ContactMode.SLIP) * np.abs(alone.residuals[:, 2:])
        rows = alone.t >= begin
        distance = np.trapezoid(slips.sum(axis=1)[rows], alone.t[rows])
        step = 2e-5 * np.abs(alone.residuals[:, 2:]).sum(axis=1).max()
        assert ensemble["slip_distance"][run] == pytest.approx(distance, rel=0.01, abs=step)
        # Whatever happened before, and from whichever instant on summaries count.
        assert ensemble.holds[run] == alone.holds == (alone.success and alone.contact[-1].all())


def distance(scene: sp.Scene) -> float:
    """The integral of the slips' speeds, by Gauss' rule between the events of a fine run."""
    fine: dict[str, Any] = {"dt": 1e-5, "method": "dop853"}
    run = sp.simulate(scene, **fine)
    ends = [0.0, 0.02, *(change.time for change in run.contact_changes), scene.duration]
    edges = np.unique(np.concatenate([np.linspace(0.0, scene.duration, 81), ends]))
    x, weights = np.polynomial.legendre.leggauss(6)
    half = 0.5 * np.diff(edges)[:, None]
    times, shares = (edges[:-1, None] + half * (1.0 + x)).ravel(), (half * weights).ravel()
    inside = sp.simulate(scene, times=times, record=("residuals", "contact"), **fine)
    rows = np.isin(inside.t, times)
    moves = np.isin(inside.contact[rows], [sp.ContactMode.SLIP, sp.ContactMode.GRAZE])
    speeds = (moves * np.abs(inside.residuals[rows, 2:])).sum(axis=1)
    return float(shares @ speeds)


@pytest.mark.parametrize(
    ("method", "formulation", "dt", "order"),
    [
        ("rk4", "csm", 2e-4, 4),
        ("dop853", "projected", 8e-4, 8),
        ("implicit_midpoint", "csm", 1e-4, 2),
    ],
)
def test_a_distance_of_slips_has_the_order_of_the_method(
    method: Any, formulation: Any, dt: float, order: int
) -> None:
    """Slips begin and end inside steps, and one begins with an impact."""
    scene = regripped()
    exact = distance(scene)
    errors = []
    for step in (dt, dt / 2):
        how: dict[str, Any] = {"method": method, "formulation": formulation, "dt": step}
        found = sp.monte_carlo(scene, 1, summaries="slip_distance", progress=False, **how)
        errors.append(abs(found["slip_distance"][0] - exact))
    assert 2.0 ** (order - 0.7) < errors[0] / errors[1] < 2.0 ** (order + 1.5)
    assert errors[1] < 1e-3 * exact


def test_model_names_contact_and_friction() -> None:
    fixed = PUSHED.friction
    models = {
        "unilateral contact, friction 0.5 right and 0.8 left": (fixed, {}),
        "unilateral contact, friction 0.3": (0.3, {}),
        "unilateral contact, varied friction": (0.3, {"friction": [0.5]}),
    }
    for model, (friction, vary) in models.items():
        scene = replace(PUSHED, friction=friction, duration=1e-3)
        assert study(1, scene, vary=vary).model == model
    assert some().model == "unilateral contact, varied friction"
    both = replace(PUSHED, contact="bilateral", duration=1e-3)
    assert study(1, both, vary={}).model == "bilateral contact, friction 0.5 right and 0.8 left"


def test_every_event_of_unilateral_contact_can_be_asked_for() -> None:
    ensemble = some()
    assert set(ensemble.counts()) == {"completed", "lost"}
    lost = ensemble.status == "lost"
    assert ensemble.probability("lost").happened == lost.sum() > 0
    for name in ("slipping", "opened"):
        happened = ~np.isnan(ensemble.violations[name])
        assert ensemble.probability(name).happened == happened.sum()
        assert 0 < happened.sum() <= 120
        assert ensemble.happened(name).tolist() == happened.tolist()
    # Tips neither pull nor separate.
    assert not ensemble.probability("pulling").happened
    assert not ensemble.probability("separated").happened
    assert 0 < ensemble.holds.sum() <= (ensemble.status == "completed").sum()
    # While the push goes on, some tips are free that will close again.
    halfway = study(scene=replace(PUSHED, duration=1.005))
    assert 0 < halfway.holds.sum() < (halfway.status == "completed").sum()
    for name in ("holds", "opened", "slipping", "lost"):
        found = sp.sensitivity(ensemble, name)
        assert set(found) == {f"{FORCE}.0", f"{FORCE}.1", "friction.left"}
        assert sp.plot.success_map(ensemble, f"{FORCE}.0", "friction.left", name).axes
    assert label("friction.left", "1") == "friction (left) [1]"
    with pytest.raises(ValueError, match=r"'opened' is an event, which has no number"):
        ensemble.mean("opened")
    assert float(ensemble.mean("free_time")) > 0.0
    assert ensemble.to_pandas().attrs["units"]["slip_distance"] == "m"


def test_events_that_bilateral_contact_does_not_have_are_no_probability_of_zero() -> None:
    ensemble = study(2, replace(PUSHED, contact="bilateral", duration=1e-3))
    for name, instead in (("opened", "pulling"), ("lost", "off_face")):
        said = rf'what = "{name}": needs Scene\.contact = "unilateral"; .* ask for "{instead}"'
        with pytest.raises(ValueError, match=said):
            ensemble.probability(name)
        with pytest.raises(ValueError, match=rf'stop_when = "{name}": needs'):
            study(2, replace(PUSHED, contact="bilateral"), stop_when={name: 0.1})
    # A coefficient of one contact is a coefficient too.
    one = study(2, replace(PUSHED, contact="bilateral", friction=None, duration=1e-3))
    assert one.probability("slipping").runs == 2


def test_an_event_ends_a_run_or_a_study() -> None:
    stopped = study(stop_on=("opened", "slipping"))
    first = {name: some().violations[name] for name in ("opened", "slipping")}
    expected = np.where(np.isnan(first["slipping"]), "completed", "slipping")
    expected[np.fmin(first["opened"], np.inf) < np.fmin(first["slipping"], np.inf)] = "opened"
    assert stopped.status.tolist() == expected.tolist()
    earliest = np.fmin(first["opened"], first["slipping"])
    ended = ~np.isnan(earliest)
    # The run ends with the step in which the tip opened or slipped.
    assert (stopped.failure_time[ended] >= earliest[ended]).all()
    assert (stopped.failure_time[ended] <= earliest[ended] + 5e-4).all()
    require_alone(stopped, int(np.argmax(ended)))
    quick = replace(PUSHED, schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]]), duration=0.004,
                    disturbances=[sp.Step(time=1e-3)])  # fmt: skip
    enough = study(4000, quick, dt=1e-3, stop_when={"opened": 0.05, "holds": 0.05})
    assert enough.runs == 1024


def test_a_start_with_modes_is_shared_and_each_run_has_its_own_velocities() -> None:
    push = sp.Pulse(time=1.0, duration=0.01, force=(200.0, -250.0))
    begun = sp.simulate(replace(PUSHED, disturbances=[push], duration=1.003), dt=5e-4)
    state = begun.state()
    assert state.contact is not None and set(state.contact[:2].tolist()) != {1.0}
    started = replace(PUSHED, initial=state, duration=0.01)
    vary = {"initial.p.1": state.p[1] + np.linspace(0.0, 0.01, 5)}
    ensemble = study(5, started, vary=vary)
    assert len(np.unique(ensemble["slip_distance"])) > 1
    for run in range(5):
        require_alone(ensemble, run)
    with pytest.raises(ValueError, match=r"State\.contact, are shared by all runs"):
        study(2, started, vary={"initial.contact": np.zeros((2, 4))})
