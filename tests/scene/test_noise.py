"""Held noise, against NumPy's own Philox, theory, and samples that are held by other means."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import softpinch as sp
from ensembles import require_alone
from noises import AWKWARD, held, noise
from softpinch import _core

SCENE = sp.Scene(
    schedule=sp.Schedule.minimum_jerk([0.0, 0.01], np.deg2rad([[5, 5], [8, 4]]), move_time=0.03),
    duration=0.08,
)
SUMMARIES = ("final_state", *_core.SUMMARIES)


def by_numpy(count: int, seed: int, run: int, place: int, block: int = 0) -> np.ndarray:
    """Standard normal samples (count, 3), from words that NumPy's generator makes."""
    words = np.empty((count, 4), np.uint64)
    for number in range(count):
        # NumPy counts up before it draws, with a carry.
        before = (number + (place << 64) + (block << 128) - 1) % 2**256
        counter = [before >> 64 * k & 2**64 - 1 for k in range(4)]
        key = np.array([seed, run], np.uint64)
        philox = np.random.Philox(key=key, counter=np.array(counter, np.uint64))
        words[number] = philox.random_raw(4)
    a, b, c, d = ((words >> np.uint64(11)) * 2.0**-53).T
    first, second = np.sqrt(-2 * np.log1p(-a)), np.sqrt(-2 * np.log1p(-c))
    x, y = first * np.cos(2 * np.pi * b), first * np.sin(2 * np.pi * b)
    return np.column_stack([x, y, second * np.cos(2 * np.pi * d)])


@pytest.mark.parametrize(
    ("seed", "run", "place"), [(0, 0, 0), (12, 7, 3), (2**64 - 1, 2**64 - 1, 1), (5, 99_999, 0)]
)
def test_samples_are_those_of_numpys_philox(seed: int, run: int, place: int) -> None:
    ours = noise(seed=seed, run=run).samples(200, place)
    expected = by_numpy(200, seed, run, place) * [2.0, 0.5, 0.01]
    np.testing.assert_allclose(ours, expected, rtol=1e-14, atol=1e-14 * 2.0)


def test_moments_and_independence_are_those_of_theory() -> None:
    n = 20_000
    one = sp.Noise(force_std=1.0, moment_std=1.0, rate_hz=1.0, seed=3)
    streams = [
        one.samples(n),
        one.samples(n, place=1),
        replace(one, run=1).samples(n),
        replace(one, seed=4).samples(n),
    ]
    columns = np.concatenate(streams, axis=1)
    # Means of n have 1/sqrt(n), squares sqrt(2/n), products and shifted products 1/sqrt(n).
    sigma = 1 / np.sqrt(n)
    assert np.abs(columns.mean(axis=0)).max() < 4.5 * sigma
    assert np.abs((columns**2).mean(axis=0) - 1).max() < 4.5 * np.sqrt(2) * sigma
    assert np.abs((columns**4).mean(axis=0) - 3).max() < 4.5 * np.sqrt(96) * sigma
    products = columns.T @ columns / n - np.diag((columns**2).mean(axis=0))
    assert np.abs(products).max() < 4.5 * sigma
    # Squares too: the pair of Box and Muller's shares its radius before the angle is drawn.
    squares = (columns**2 - 1) / np.sqrt(2)
    off = squares.T @ squares / n
    assert np.abs(off - np.diag(np.diag(off))).max() < 4.5 * sigma
    for lag in (1, 2, 4):
        shifted = columns[lag:].T @ columns[:-lag] / (n - lag)
        assert np.abs(shifted).max() < 4.5 * sigma
    for column in columns.T:
        assert stats.kstest(column, "norm").pvalue > 1e-4


@pytest.mark.parametrize("one", AWKWARD, ids=range(len(AWKWARD)))
@pytest.mark.parametrize("how", [{"dt": 1e-3}, {"tolerance": 1e-8, "method": "dop853"}], ids=str)
def test_noise_acts_as_the_same_samples_held(one: sp.Noise, how: dict[str, object]) -> None:
    still = sp.Step(time=0.0)
    noisy = replace(SCENE, disturbances=[still, one])
    sampled = replace(SCENE, disturbances=[still, held(one, 1, SCENE.duration)])
    ours, theirs = sp.simulate(noisy, **how), sp.simulate(sampled, **how)
    assert ours.success and len(ours) == len(theirs)
    np.testing.assert_allclose(ours.t, theirs.t, rtol=1e-14, atol=1e-17)
    for a, b in ((ours.q, theirs.q), (ours.p, theirs.p)):
        assert (np.abs(a - b).max(axis=0) <= 1e-10 * np.abs(b).max(axis=0)).all()


def test_each_run_has_a_stream_of_its_own() -> None:
    scene = replace(SCENE, disturbances=[sp.Step(time=0.0), noise()])
    how = {"dt": 1e-3, "summaries": SUMMARIES, "progress": False}
    ensemble = sp.monte_carlo(scene, 12, seed=9, threads=1, **how)
    assert len(np.unique(ensemble["final_state"][:, 0])) == 12
    for run in range(12):
        # Held samples of exactly that stream give the run, by other code.
        own = replace(noise(), seed=9, run=run)
        sampled = replace(scene, disturbances=[sp.Step(time=0.0), held(own, 1, SCENE.duration)])
        alone = sp.simulate(sampled, dt=1e-3)
        last = np.concatenate([alone.q[-1], alone.p[-1]])
        scale = np.concatenate([np.abs(alone.q).max(axis=0), np.abs(alone.p).max(axis=0)])
        assert (np.abs(ensemble["final_state"][run] - last) <= 1e-10 * scale).all()
        assert ensemble.scene_of(run).disturbances[1] == own
    some = sp.monte_carlo(scene, 12, seed=9, threads=2, only=[2, 5, 11], **how)
    np.testing.assert_array_equal(some["final_state"], ensemble["final_state"][[2, 5, 11]])
    other = sp.monte_carlo(scene, 12, seed=10, **how)
    assert (other["final_state"][:, 0] != ensemble["final_state"][:, 0]).all()


def test_the_fields_of_a_noise_vary_between_runs() -> None:
    vary = {
        "disturbances.0.force_std": np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 0.5]]),
        "disturbances.0.rate_hz": np.array([100.0, 317.0, 55.0]),
        "disturbances.0.time": np.array([0.0, 0.013, -0.3]),
        "disturbances.0.duration": np.array([0.02, 0.031, 0.33]),
        "disturbances.0.moment_std": np.array([0.0, 0.01, 0.02]),
    }
    scene = replace(SCENE, disturbances=[noise()])
    ensemble = sp.monte_carlo(scene, vary=vary, dt=1e-3, progress=False)
    both = replace(SCENE, disturbances=[noise(force_std=1.0)])
    scattered = {"disturbances.0.force_std": [0.5, 2.0], "disturbances.0.rate_hz": [99.0, 250.0]}
    two = sp.monte_carlo(both, vary=scattered, dt=1e-3, progress=False)
    for many in (ensemble, two):
        for run in range(many.runs):
            require_alone(many, run)
    quiet = sp.simulate(SCENE, dt=1e-3)
    # The same but for the steps that end where the samples of no force would.
    np.testing.assert_allclose(ensemble["final_state"][0, :9], quiet.q[-1], rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize(
    ("bad", "error", "message"),
    [
        ({"force_std": -1.0}, ValueError, r"Noise.force_std = -1.0: must be finite and >= 0"),
        ({"force_std": (1.0, -2.0)}, ValueError, r"Noise.force_std\[1\] = -2.0: must be finite"),
        ({"force_std": (1.0, 2.0, 3.0)}, ValueError, r"Noise.force_std has shape \(3,\)"),
        ({"moment_std": -1e-9}, ValueError, "Noise.moment_std = -1e-09"),
        ({"rate_hz": np.inf}, ValueError, "Noise.rate_hz = inf"),
        ({"duration": 1e-9, "time": 1e9}, ValueError, "long enough to end later than time"),
        ({"seed": -1}, ValueError, "Noise.seed = -1: must be at least 0"),
        ({"run": 2**64}, ValueError, "Noise.run = 18446744073709551616: must be at most"),
        ({"seed": 1.5}, TypeError, "Noise.seed = 1.5: must be an integer"),
    ],
)
def test_bad_fields_are_refused(bad: dict[str, object], error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        noise(**bad)


def test_more_samples_than_a_run_can_have_are_refused() -> None:
    scene = replace(SCENE, disturbances=[noise(rate_hz=1e9)])
    with pytest.raises(ValueError, match=r"noise's samples .* would need 8.000e7, the limit is"):
        sp.simulate(scene, dt=1e-3)


def far(grid: tuple[float, int] | None, **changes: object) -> sp.Scene:
    """A run of a hundred samples 1000 s after its noise has begun: with 10^10 before it."""
    start = sp.Scene().start()
    state = sp.State(start.q, start.p, start.integral, time=1000.0, grid=grid)
    fields = {"rate_hz": 1e7, "time": 0.0, **changes}
    return sp.Scene(initial=state, duration=1e-5, disturbances=[noise(**fields)])


@pytest.mark.parametrize(
    ("grid", "duration", "how"),
    [
        ((0.0, 7), None, {"dt": 1e-7}),
        ((999.0, 10**6), 5e-8, {"tolerance": 1e-6, "method": "dop853"}),
        ((1000.0 - 5e-8, 1), 1000.0, {"dt": 1e-7}),
    ],
    ids=str,
)
def test_samples_before_the_segment_of_a_state_are_not_made(
    grid: tuple[float, int], duration: float | None, how: dict[str, object]
) -> None:
    # A noise lies between the segment's start and now, so the run begins a segment of its own: as
    # it does without a grid. Listing its samples would take 80 GB.
    run = sp.simulate(far(grid, duration=duration), **how)
    plain = sp.simulate(far(None, duration=duration), **how)
    assert run.stats == plain.stats
    np.testing.assert_array_equal(run.q, plain.q)
    rows = sp.monte_carlo(
        far(grid, duration=duration), 9, seed=12, summaries=("final_state",), progress=False, **how
    )
    one = rows.replay(3)
    np.testing.assert_array_equal(rows["final_state"][3], np.append(one.q[-1], one.p[-1]))


def test_a_run_goes_on_after_a_noise_that_is_over() -> None:
    scene = replace(SCENE, disturbances=[noise(rate_hz=1e4, duration=0.01)], duration=0.05)
    whole = sp.simulate(scene, dt=1e-4)
    k = 371
    assert whole.state(k).grid is not None
    rest = replace(scene, initial=whole.state(k), duration=scene.duration - whole.t[k])
    np.testing.assert_array_equal(sp.simulate(rest, dt=1e-4).q, whole.q[k:])


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_a_shaken_base_is_a_hand_with_the_samples_as_its_acceleration(contact: Any) -> None:
    shaking = sp.Noise(acceleration_std=(3.0, 1.0), rate_hz=400.0, time=0.01, duration=0.05, seed=8)
    scene = replace(SCENE, contact=contact, friction=0.9, motion=sp.HandMotion.constant(tilt=0.2))
    pushed = (sp.Step(time=0.0, force=(0.1, 0.0)),)
    shaken = replace(scene, disturbances=(*pushed, shaking))
    ours = sp.simulate(shaken, dt=1e-4, record=("state", "energy"))
    times = np.append(0.01 + np.arange(20) / 400.0, 0.06)
    samples = by_numpy(20, seed=8, run=0, place=1, block=1)[:, :2] * [3.0, 1.0]
    accelerations = np.vstack([samples, [0.0, 0.0]])
    motion = sp.HandMotion.sampled(times, None, accelerations, tilts=0.2, hold=True)
    theirs = sp.simulate(replace(scene, motion=motion, disturbances=pushed), dt=1e-4)
    np.testing.assert_allclose(ours.q[-1], theirs.q[-1], rtol=0, atol=1e-12)
    still = sp.simulate(replace(scene, disturbances=pushed), dt=1e-4)
    assert np.abs(ours.q[-1] - still.q[-1]).max() > 1e-6
    assert np.abs(ours.energy.closure).max() < 1e-6 * ours.energy.exchanged


def test_shaken_bases_are_the_same_in_lanes_and_need_a_motion() -> None:
    shaking = sp.Noise(acceleration_std=2.0, rate_hz=300.0)
    with pytest.raises(ValueError, match=r"disturbances\[0\]\.acceleration_std = 2\.0: needs a"):
        replace(SCENE, disturbances=(shaking,))
    move = sp.HandMotion.minimum_jerk([0.0, 0.05], [[0.0, 0.0], [0.02, 0.01]], [0.0, 0.1])
    scene = replace(SCENE, disturbances=(shaking,), motion=move)
    varied = {"disturbances.0.acceleration_std": sp.Uniform(1.0, 3.0)}
    ensemble = sp.monte_carlo(scene, 12, vary=varied, seed=4, dt=2e-4, summaries=SUMMARIES)
    for run in range(12):
        require_alone(ensemble, run)
