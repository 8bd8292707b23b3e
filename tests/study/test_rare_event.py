"""`rare_event`, beside closed forms, plain runs and its own arguments."""

import contextlib
import io
import math
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
import pytest

import softpinch as sp

pytest.importorskip("scipy")

BELOW = NormalDist().cdf
# A short push on a grasp at rest, in which the object turns by milliradians.
SCENE = sp.Scene(duration=0.1, disturbances=[sp.Pulse(time=0.02, duration=0.01)])
VARY: dict[Any, Any] = {
    "grasped.mass": sp.Normal(0.1, 0.01),
    "hand.tip.youngs_modulus": sp.LogNormal(0.3e6, 0.2),
    "disturbances.0.force": sp.Normal((0.0, 0.0), (20.0, 10.0)),
}
TURNS = ("peak_rotation", ">", 0.018)
HOW: dict[str, Any] = {"dt": 1e-3, "progress": False}
# The shortest scene, for events that are about the drawn numbers only.
SHORT = sp.Scene(duration=1e-3)


def light(limit: float) -> Callable[[sp.Ensemble], Any]:
    """A mass below a limit: with Normal(0.1, 0.01), BELOW((limit - 0.1) / 0.01)."""
    return lambda some: some["grasped.mass"] - limit


def plain(runs: int, seed: int) -> sp.Estimate:
    study = sp.monte_carlo(SCENE, runs, seed, VARY, summaries="peak_rotation", **HOW)
    return study.probability(lambda some: some["peak_rotation"] > TURNS[2])


@pytest.mark.parametrize("method", ["subset", "importance"])
def test_plain_runs_agree(method: Any) -> None:
    wanted = plain(40_000, 1)
    found = sp.rare_event(SCENE, VARY, TURNS, 10_000, seed=2, method=method, **HOW)
    assert 1e-3 < found.probability < 1e-2
    # Both intervals have the probability with 95 %, so that they hardly miss each other.
    assert found.interval[0] <= wanted.high and wanted.low <= found.interval[1]
    assert found.warnings == ()
    assert found.method == method and found.runs <= 10_000


@pytest.mark.slow
def test_many_plain_runs_agree() -> None:
    wanted = plain(10_000_000, 11)
    found = sp.rare_event(SCENE, VARY, TURNS, seed=2, **HOW)
    assert found.interval[0] <= wanted.high and wanted.low <= found.interval[1]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["subset", "importance"])
def test_intervals_of_a_scene_cover(method: Any) -> None:
    wanted = float(plain(10_000_000, 11))
    found = [sp.rare_event(SCENE, VARY, TURNS, 5000, k, method, **HOW) for k in range(200)]
    right = [one.interval[0] <= wanted <= one.interval[1] or bool(one.warnings) for one in found]
    assert np.mean(right) > 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / 200)


def test_a_known_probability_with_its_derivatives() -> None:
    vary = {"grasped.mass": sp.Normal(0.1, 0.01), "hand.tip.youngs_modulus": sp.LogNormal(3e5, 0.1)}
    found = sp.rare_event(SHORT, vary, light(0.053), **HOW)
    beta = 4.7
    wanted = BELOW(-beta)
    assert found.cov < 0.05
    assert abs(math.log(found.probability / wanted)) < 4.0 * found.cov
    assert found.interval[0] < found.probability < found.interval[1]
    assert found.plain_runs == pytest.approx(1.0 / (found.probability * found.cov**2), rel=1e-3)
    # d ln Phi((0.053 - m) / s) / dm = -phi(beta) / (s Phi(-beta)), and beta times this for s.
    hazard = NormalDist().pdf(beta) / wanted
    assert found.sensitivity["grasped.mass.mean"] == pytest.approx(-hazard / 0.01, rel=0.02)
    assert found.sensitivity["grasped.mass.std"] == pytest.approx(beta * hazard / 0.01, rel=0.02)
    assert abs(found.sensitivity["hand.tip.youngs_modulus.median"] * 3e5 * 0.1) < 0.3
    assert found.importance["grasped.mass"] > 0.98
    assert sum(found.importance.values()) == pytest.approx(1.0)
    # The nearest point has the limit's mass, and the median modulus.
    assert found.design_point["grasped.mass"] == pytest.approx(0.053, abs=5e-4)
    assert found.design_point["hand.tip.youngs_modulus"] == pytest.approx(3e5, rel=0.15)


def test_derivatives_by_parameters_that_components_share() -> None:
    """Both components have one mean and their own deviations."""
    scene = replace(SHORT, disturbances=[sp.Pulse(time=0.0, duration=1e-3)])
    vary = {"disturbances.0.force": sp.Normal(1.0, (1.0, 2.0))}

    def event(some: sp.Ensemble) -> Any:
        return 8.0 - some["disturbances.0.force"].sum(axis=1)

    found = sp.rare_event(scene, vary, event, seed=1, **HOW)
    # The sum is Normal(2, sqrt(5)).
    beta, std = 6.0 / math.sqrt(5.0), math.sqrt(5.0)
    hazard = NormalDist().pdf(beta) / BELOW(-beta)
    assert found.sensitivity["disturbances.0.force.mean"] == pytest.approx(
        2.0 * hazard / std, rel=0.03
    )
    wanted = beta * hazard / 5.0 * np.array([1.0, 2.0])
    np.testing.assert_allclose(found.sensitivity["disturbances.0.force.std"], wanted, rtol=0.06)


def test_the_same_seed_gives_the_same_bits_for_any_threads() -> None:
    one, two, other = (
        sp.rare_event(SCENE, VARY, TURNS, 2000, seed, threads=threads, **HOW)
        for seed, threads in ((4, 1), (4, 3), (5, 1))
    )
    assert (one.probability, one.interval, one.levels) == (
        two.probability,
        two.interval,
        two.levels,
    )
    assert one.sensitivity.keys() == two.sensitivity.keys()
    np.testing.assert_array_equal(one.events["peak_rotation"], two.events["peak_rotation"])
    assert one.probability != other.probability


def test_runs_with_the_event_replay_alone() -> None:
    found = sp.rare_event(SCENE, VARY, TURNS, 2000, seed=4, **HOW)
    failures = found.failures()
    assert len(failures) == found.events.runs > 100
    assert (found.events["peak_rotation"] >= TURNS[2]).all()
    for k in (0, 50, -1):
        run = failures[k].replay()
        assert failures[k].agrees(run)
        assert np.abs(run.q[:, 2]).max() == found.events["peak_rotation"][k]
    # The design point is one of them.
    run = sp.simulate(SCENE.with_(found.design_point), 1e-3)
    assert np.abs(run.q[:, 2]).max() >= TURNS[2]
    assert sp.Capsule.from_toml(failures[0].to_toml()) == failures[0]


NOISE = sp.Noise(force_std=(3.0, 1.0), moment_std=0.01, rate_hz=500.0, time=0.01, duration=0.05)


def test_noise_has_the_distribution_that_it_has_in_plain_runs() -> None:
    scene = replace(SCENE, disturbances=[NOISE])
    study = sp.monte_carlo(scene, 20_000, 3, {}, summaries="peak_rotation", **HOW)
    limit = float(np.quantile(study["peak_rotation"], 0.99))
    wanted = study.probability(lambda some: some["peak_rotation"] > limit)
    for method in ("subset", "splitting"):
        found = sp.rare_event(
            scene, {}, ("peak_rotation", ">", limit), 10_000, method=method, **HOW
        )
        assert found.method == method
        assert found.interval[0] <= wanted.high and wanted.low <= found.interval[1]
        # The samples of the force are in the capsule, with the force after the end, which is 0.
        run = found.failures()[0]
        assert run.parameters["disturbances.0.force"].shape == (26, 2)
        assert (run.parameters["disturbances.0.force"][-1] == 0.0).all()
        assert run.agrees(run.replay())


@pytest.mark.parametrize("method", ["subset", "splitting"])
def test_a_known_probability_of_noise(method: Any) -> None:
    """The sum of 20 samples, and a mass: Normal(0, sqrt(21)) in their standard deviations."""
    scene = sp.Scene(duration=0.02, disturbances=[sp.Noise(force_std=2.0, rate_hz=1000.0)])

    def event(some: sp.Ensemble) -> Any:
        noise = some["disturbances.0.force"][:, :, 0].sum(axis=1) / 2.0
        return 3.09 * math.sqrt(21.0) - noise - (some["grasped.mass"] - 0.1) / 0.01

    vary = {"grasped.mass": sp.Normal(0.1, 0.01)}
    found = sp.rare_event(scene, vary, event, 20_000, seed=1, method=method, **HOW)
    assert abs(math.log(found.probability / BELOW(-3.09))) < 4.0 * found.cov
    assert found.cov < 0.25
    assert found.sensitivity.keys() == {"grasped.mass.mean", "grasped.mass.std"}


def test_two_ways_of_which_one_is_lost_are_reported() -> None:
    """A near way ends before the event, so that the levels go to it and leave the other."""

    def event(some: sp.Ensemble) -> Any:
        x = (some["grasped.mass"] - 0.1) / 0.01
        return np.minimum(np.maximum(3.0 - x, 0.7 + 0.0 * x), np.maximum(4.5 + x, 0.0))

    vary = {"grasped.mass": sp.Normal(0.1, 0.01), "hand.tip.youngs_modulus": sp.LogNormal(3e5, 0.1)}
    found = sp.rare_event(SHORT, vary, event, seed=1, **HOW)
    wrong = not found.interval[0] <= BELOW(-4.5) <= found.interval[1]
    assert bool(found.warnings) or not wrong
    assert found.warnings


def test_an_event_that_never_happens_has_an_upper_bound() -> None:
    found = sp.rare_event(SHORT, {"grasped.mass": sp.Uniform(0.1, 0.2)}, light(0.09), **HOW)
    assert (found.probability, found.interval[0], found.design_point) == (0.0, 0.0, {})
    assert 0.0 < found.interval[1] < 1e-6
    assert "not found" in found.warnings[-1]
    assert found.failures() == [] and found.plain_runs == math.inf
    # Where no run is nearer than others, only the rule of three is left.
    found = sp.rare_event(
        SHORT, {"grasped.mass": sp.Uniform(0.1, 0.2)}, lambda some: np.ones(len(some)), **HOW
    )
    assert found.interval == (0.0, 3.0 / found.levels[0].runs)


def test_a_probability_near_one() -> None:
    vary = {"grasped.mass": sp.Normal(0.1, 0.01)}
    found = sp.rare_event(SHORT, vary, light(0.11), 2000, **HOW)
    assert found.interval[0] < BELOW(1.0) < found.interval[1] <= 1.0
    assert len(found.levels) == 1


def test_runs_without_a_number_count_as_runs_with_the_event() -> None:
    def event(some: sp.Ensemble) -> Any:
        return np.where(some["grasped.mass"] > 0.12, np.nan, 1.0)

    found = sp.rare_event(SHORT, {"grasped.mass": sp.Normal(0.1, 0.01)}, event, 5000, **HOW)
    assert found.interval[0] < BELOW(-2.0) < found.interval[1]
    assert "give NaN" in " ".join(found.warnings)


def test_ctrl_c_keeps_finished_levels() -> None:
    calls = []

    def event(some: sp.Ensemble) -> Any:
        calls.append(len(some))
        if sum(calls) > 8000:
            os.kill(os.getpid(), signal.SIGINT)
        return light(0.06)(some)

    vary = {"grasped.mass": sp.Normal(0.1, 0.01)}
    found = sp.rare_event(SHORT, vary, event, method="subset", **HOW)
    assert found.interrupted
    # The first, smaller set of levels is complete.
    assert found.interval[0] < BELOW(-4.0) < found.interval[1]
    calls.append(8000)
    found = sp.rare_event(SHORT, vary, event, **HOW)
    assert found.interrupted and found.interval == (0.0, 1.0)


def test_progress_counts_runs() -> None:
    seen: list[tuple[int, int]] = []
    how = HOW | {"progress": lambda done, total: seen.append((done, total))}
    found = sp.rare_event(SHORT, {"grasped.mass": sp.Normal(0.1, 0.01)}, light(0.06), 1000, **how)
    assert seen == sorted(seen)
    assert seen[-1] == (found.runs, 1000)


def test_the_bar_names_the_level(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal: each level with its distance and its probability so far."""
    bars = pytest.importorskip("rich.progress")
    drawn: list[str] = []
    update = bars.Progress.update

    def spy(bar: Any, task: Any, **given: Any) -> None:
        drawn.append(given["description"])
        update(bar, task, **given)

    monkeypatch.setattr(bars.Progress, "update", spy)
    monkeypatch.setattr("sys.stderr", terminal := io.StringIO())
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    found = sp.rare_event(SHORT, NORMAL, light(0.06), 3000, 1, "importance", dt=1e-3)
    assert drawn[0] == "rare event"
    total = 1.0
    for number, level in enumerate(found.levels[:-1], 1):
        total *= level.probability
        assert f"level {number}: {total:.2g} within {level.threshold:.3g} of the event" in drawn
    assert "weighted runs, after" in drawn[-1]


def test_correlated_and_chosen_numbers() -> None:
    """One random number may select several values, and a tuple of paths may share a source."""
    scene = replace(SHORT, disturbances=[sp.Pulse(time=0.0, duration=1e-3)])
    vary: dict[Any, Any] = {
        "disturbances.0.force": sp.Choice([[0.0, 0.0], [5.0, 5.0]], [0.9, 0.1]),
        ("grasped.mass", "grasped.com_offset"): sp.Uniform((0.1, 0.0), (0.2, 0.01)),
    }

    def event(some: sp.Ensemble) -> Any:
        pushed = some["disturbances.0.force"][:, 0] / 5.0
        return 1.0 - pushed + 50.0 * (some["grasped.mass"] - 0.102)

    found = sp.rare_event(scene, vary, event, 10_000, **HOW)
    assert found.interval[0] < 0.1 * 0.02 < found.interval[1]
    assert set(found.importance) == {
        "disturbances.0.force.0", "grasped.mass", "grasped.com_offset"
    }  # fmt: skip


def test_the_result_prints_what_it_found() -> None:
    vary = {"grasped.mass": sp.Normal(0.1, 0.01)}
    found = sp.rare_event(SHORT, vary, light(0.06), 2000, **HOW)
    assert f"{found.probability:.4g} (95 %: " in str(found)
    assert repr(found).startswith("<RareEvent")
    assert "threshold" in found._repr_html_()


NORMAL = {"grasped.mass": sp.Normal(0.1, 0.01)}


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"vary": {"grasped.mass": np.ones(9)}}, TypeError, "quantiles"),
        ({"vary": {"grasped.mass": lambda rng: 0.1}}, TypeError, "quantiles"),
        ({"vary": {}}, ValueError, "vary is empty"),
        ({"vary": {"grasped.weight": sp.Normal(1.0, 0.1)}}, ValueError, "grasped.weight"),
        ({"vary": {"grasped.mass": sp.Normal(0.1, 0.02)}}, ValueError,
         "7 standard deviations off, run 2: GraspedObject.mass = -0.0.*without such a tail"),
        ({"event": "dropped"}, TypeError, "event = 'dropped'"),
        ({"event": ("peak_rotation", ">=", 0.1)}, ValueError, r"event\[1\] = '>='"),
        ({"event": ("peak_rotation", ">", math.nan)}, ValueError, r"event\[2\] = nan"),
        ({"event": ("peak_turn", ">", 0.1)}, ValueError, r"event\[0\] = 'peak_turn' is unknown"),
        ({"event": ("final_state", ">", 0.1)}, ValueError, "several numbers"),
        ({"event": lambda some: [1.0, 2.0]}, ValueError, r"event: gave shape \(2,\)"),
        ({"event": lambda some: some.holds}, TypeError, "event = "),
        ({"runs": 999}, ValueError, "runs = 999"),
        ({"seed": -1}, ValueError, "seed = -1"),
        ({"method": "line"}, ValueError, "method = 'line'"),
        ({"method": "splitting"}, ValueError, "needs a Noise of forces"),
        ({"dt": -1.0}, ValueError, "dt = -1.0"),
        ({"integrator": "euler"}, ValueError, "^integrator = 'euler'"),
        ({"threads": 0}, ValueError, "threads = 0"),
        ({"step": 1.0}, TypeError, "^rare_event: step is unknown"),
        ({"record": "state"}, TypeError, "^rare_event: record is unknown"),
    ],
)  # fmt: skip
def test_bad_arguments_are_refused(
    change: dict[str, Any], error: type[Exception], text: str
) -> None:
    given = {"vary": NORMAL, "event": ("peak_rotation", ">", 0.1), **HOW} | change
    with pytest.raises(error, match=text):
        sp.rare_event(SHORT, **given)


def test_the_loss_of_a_grasp_is_a_margin_that_is_not_positive() -> None:
    scene = sp.Scene(
        contact="unilateral",
        friction=0.5,
        hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
        grasped=sp.GraspedObject(height=0.049),
        disturbances=[sp.Pulse(time=0.02, duration=0.01)],
        duration=0.1,
    )
    vary = {"disturbances.0.force": sp.Normal((0.0, 0.0), (40.0, 40.0))}
    how = HOW | {"dt": 2.5e-4}  # stable, other than steps of 1 ms
    wanted = sp.monte_carlo(scene, 10_000, 1, vary, summaries="margin", **how).probability("holds")
    found = sp.rare_event(scene, vary, runs=8000, seed=1, **how)
    assert 0.01 < found.probability < 0.5
    assert not found.events.holds.any()
    assert found.interval[0] <= 1.0 - wanted.low and 1.0 - wanted.high <= found.interval[1]


def test_equality_is_no_event_and_certainty_has_plain_runs() -> None:
    scene = sp.Scene(duration=0.01)
    vary = {"grasped.mass": sp.Normal(0.1, 1e-3)}
    never = sp.rare_event(scene, vary, ("pulling_time", ">", 0.0), runs=1000, dt=1e-3)
    assert never.probability == 0.0
    always = sp.rare_event(scene, vary, ("pulling_time", "<", 1.0), runs=1000, dt=1e-3)
    assert always.probability == 1.0 and always.plain_runs == always.runs


def test_runs_that_stay_random_have_no_weights() -> None:
    noisy = sp.SampledController.pid(1e-3, kp=20.0, kd=0.2, ki=0.0, jitter=5e-4)
    scene = sp.Scene(duration=0.01, control=noisy)
    vary = {"grasped.mass": sp.Normal(0.1, 1e-3)}
    event = ("peak_rotation", ">", -1.0)
    with pytest.raises(ValueError, match='method = "importance": needs runs without'):
        sp.rare_event(scene, vary, event, runs=1000, dt=1e-3, method="importance")
    assert sp.rare_event(scene, vary, event, runs=1000, dt=1e-3).method == "subset"


@pytest.mark.parametrize(("time", "duration", "rate"), [(0.1, 0.3, 10.0), (0.1, 0.2, 30.0)])
def test_the_end_of_a_noise_may_be_rounded(time: float, duration: float, rate: float) -> None:
    noise = sp.Noise(time=time, duration=duration, rate_hz=rate, force_std=1.0)
    scene = sp.Scene(duration=0.5, disturbances=[noise])
    found = sp.rare_event(scene, {}, ("peak_rotation", ">", -1.0), runs=1000, dt=5e-3)
    assert found.probability == 1.0


def test_few_runs_end_with_a_bound() -> None:
    vary = {"disturbances.0.force": sp.Normal((0.0, 0.0), (5.0, 5.0))}
    scene = sp.Scene(duration=0.1, disturbances=[sp.Pulse(time=0.02, duration=0.01)])
    found = sp.rare_event(scene, vary, ("peak_rotation", ">", 0.01), runs=1000, dt=1e-3)
    assert found.runs <= 1000 and found.interval[1] > 0.0


def test_numbers_that_do_not_vary_have_no_derivative() -> None:
    scene = replace(SHORT, disturbances=[sp.Pulse(time=0.0, duration=1e-3)])
    vary = {"disturbances.0.force": sp.Normal((0.0, 0.0), (1.0, 0.0))}
    found = sp.rare_event(
        scene, vary, lambda some: 3.0 - some["disturbances.0.force"][:, 0], 2000, **HOW
    )
    for name in ("mean", "std"):
        one, other = found.sensitivity[f"disturbances.0.force.{name}"]
        assert one > 1.0 and math.isnan(other)


@pytest.mark.parametrize("where", [0, 1, 2])
def test_a_choice_that_matters_is_important(where: int) -> None:
    """One of three friction coefficients, of which the middle one is neither high nor low."""
    vary: dict[Any, Any] = {
        "friction": sp.Choice([0.4, 0.5, 0.6]),
        "grasped.mass": sp.Normal(0.1, 0.01),
        "hand.tip.youngs_modulus": sp.LogNormal(3e5, 0.1),
    }

    def event(some: sp.Ensemble) -> Any:
        wrong = some["friction"] != [0.4, 0.5, 0.6][where]
        return 3.0 * wrong + 2.3 - (some["grasped.mass"] - 0.1) / 0.01

    scene = replace(SHORT, contact="unilateral", friction=0.5)
    scene = replace(scene, hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)))
    found = sp.rare_event(scene, vary, event, 5000, **HOW | {"dt": 2.5e-4})
    assert list(found.importance)[:2] == ["grasped.mass", "friction"]
    assert found.importance["friction"] > 0.05


@pytest.mark.parametrize("method", ["subset", "importance"])
def test_most_runs_may_be_infinitely_far(method: Any) -> None:
    """One run in 700 has a distance, from which the levels begin."""

    def event(some: sp.Ensemble) -> Any:
        return np.where(some["grasped.mass"] < 0.13, np.inf, 0.14 - some["grasped.mass"])

    vary = NORMAL | {"hand.tip.youngs_modulus": sp.LogNormal(3e5, 0.1)}
    found = sp.rare_event(SHORT, vary, event, 10_000, 1, method, **HOW)
    assert found.interval[0] < BELOW(-4.0) < found.interval[1]
    assert found.probability > 0.0 or method == "importance"
    # Without any distance, the rule of three is left, with a warning.
    never = sp.rare_event(SHORT, NORMAL, lambda some: np.full(len(some), np.inf), 2000, **HOW)
    assert never.interval[0] == 0.0 and never.interval[1] < 0.1
    assert "equally near" in never.warnings[0]


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers of runs that are computed, call by call."""
    from softpinch import rare

    calls: list[int] = []
    original = rare.on_threads

    def on_threads(*given: Any) -> bool:
        calls.append(given[2])
        return original(*given)

    monkeypatch.setattr(rare, "on_threads", on_threads)
    return calls


def test_a_store_keeps_runs_and_a_repeated_call_goes_on(tmp_path: Path, counted: list[int]) -> None:
    pytest.importorskip("pyarrow")
    stopped = [False]

    def event(some: sp.Ensemble) -> Any:
        if sum(counted) > 1500 and not stopped[0]:
            stopped[0] = True
            os.kill(os.getpid(), signal.SIGINT)
        return TURNS[2] - some["peak_rotation"]

    def call(**how: Any) -> sp.RareEvent:
        given = HOW | {"summaries": "peak_rotation", "store": tmp_path / "runs"} | how
        return sp.rare_event(SCENE, VARY, event, 3000, 4, **given)

    with contextlib.suppress(KeyboardInterrupt):
        assert call().interrupted
    before = sum(counted)
    assert stopped[0] and 1500 < before < 3000
    found = call()
    assert sum(counted) <= found.runs + 300  # at most one unfinished call again
    plain = call(store=None)
    counted.clear()
    again = call()
    assert counted == []
    assert again == found == plain
    np.testing.assert_array_equal(again.events["peak_rotation"], plain.events["peak_rotation"])
    # Any tool reads the parts.
    import pyarrow.parquet as parquet

    rows = sum(parquet.read_table(part).num_rows for part in (tmp_path / "runs/parts").iterdir())
    assert rows == found.runs
    with pytest.raises(sp.StoreError, match="another call"):
        sp.rare_event(
            SCENE, VARY, event, 6000, 4, summaries="peak_rotation", store=tmp_path / "runs", **HOW
        )
    with pytest.raises(sp.StoreError):
        call(dt=5e-4)
    with pytest.raises(sp.StoreError, match="not a study"):
        sp.Study.open(tmp_path / "runs")


def test_a_store_is_not_the_folder_of_a_study(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    sp.monte_carlo(SHORT, 10, vary=NORMAL, store=tmp_path / "plain", **HOW)
    with pytest.raises(sp.StoreError, match="holds a study"):
        sp.rare_event(SHORT, NORMAL, light(0.06), 1000, store=tmp_path / "plain", **HOW)
