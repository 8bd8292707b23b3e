"""A run in an ensemble is the run that it is alone, to the bit, whoever computes it beside it."""

import pickle
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import softpinch as sp
from ensembles import require_alone, require_same, same
from softpinch import _core, strategies
from softpinch.study.rows import Rows
from softpinch.study.spec import StudySpec

SUMMARIES = ("final_state", *_core.SUMMARIES)
# Methods that run in lanes, and those that run one by one.
LANES = [("rk4", 1e-3), ("dop853", 2e-3), ("rosenbrock", 4e-3)]
OTHERS = [("implicit_midpoint", 2e-3), ("radau5", 4e-3)]
# The same with steps of their own.
FREE_LANES = [("dop853", 1e-6), ("rosenbrock", 1e-4)]


def scattered(**changes: object) -> sp.Scene:
    """A grasp that is disturbed in every way there is."""
    scene = sp.Scene(
        schedule=sp.Schedule.minimum_jerk([0.0, 0.02], np.deg2rad([[5, 5], [8, 4]]), 0.03),
        disturbances=[
            sp.Step(time=0.011, force=(2.0, -1.0), moment=0.01),
            sp.Impulse(time=0.0237, impulse=(0.01, -0.02), angular_impulse=1e-5),
            sp.Sine(frequency_hz=40.0, force=(1.0, 2.0), time=0.005, duration=0.03),
            sp.Noise(force_std=2.0, moment_std=0.01, rate_hz=150.0, duration=0.04),
        ],
        friction=0.8,
        duration=0.06,
    )
    return replace(scene, **changes)


VARY = {
    "grasped.mass": sp.LogUniform(0.05, 0.2),
    "hand.tip.left.youngs_modulus": sp.Uniform(2e5, 4e5),
    "control.kp": sp.Normal(100.0, 5.0),
    "schedule.angles": lambda rng: np.deg2rad([[5, 5], [8, 4]]) + rng.normal(0, 0.01, (2, 2)),
    "disturbances.0.force": sp.Uniform((-5, -5), (5, 5)),
    "disturbances.0.time": sp.Uniform(0.001, 0.05),
    "disturbances.1.time": sp.Uniform(0.01, 0.05),
    "disturbances.2.frequency_hz": sp.Uniform(10.0, 80.0),
    "disturbances.3.rate_hz": sp.Uniform(100.0, 300.0),
    "duration": sp.Uniform(0.03, 0.06),
}


STEPS: list[tuple[str, dict[str, float]]] = [
    *((method, {"dt": dt}) for method, dt in LANES + OTHERS),
    *((method, {"tolerance": k}) for method in _core.ADAPTIVE_METHODS for k in (1e-3, 1e-7)),
]


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize(("method", "steps"), STEPS, ids=str)
def test_a_run_is_what_it_is_alone(formulation: str, method: str, steps: dict[str, float]) -> None:
    ensemble = sp.monte_carlo(
        scattered(),
        21,
        seed=5,
        vary=VARY,
        method=method,
        formulation=formulation,
        stabilization=sp.Stabilization(alpha=300.0, beta=300.0),
        summaries=SUMMARIES,
        progress=False,
        **steps,
    )
    assert ensemble.runs == 21
    for run in range(21):
        require_alone(ensemble, run)


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(
    scene=strategies.scenes(duration=0.02),
    formulation=st.sampled_from(_core.FORMULATIONS),
    scatter=st.lists(st.floats(0.2, 5.0), min_size=1, max_size=11),
)
def test_random_scenes_are_the_same_alone(
    scene: sp.Scene, formulation: str, scatter: list[float]
) -> None:
    vary = {"grasped.inertia": scene.grasped.inertia * np.array(scatter)}
    ensemble = sp.monte_carlo(
        scene, vary=vary, dt=5e-4, formulation=formulation, summaries=SUMMARIES, progress=False
    )
    for run in range(len(scatter)):
        require_alone(ensemble, run)


def study(**how: object) -> sp.Ensemble:
    how = {"dt": 1e-3, "summaries": SUMMARIES, "progress": False, **how}
    return sp.monte_carlo(scattered(), 50, seed=11, vary=VARY, **how)


def test_threads_and_company_change_no_bit() -> None:
    whole = study(threads=1)
    require_same(whole, study(threads=2))
    some = [3, 4, 17, 30, 49]
    require_same(whole, study(only=some), some)
    for run in (0, 8, 49):
        require_same(whole, study(only=[run]), [run])


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize(
    ("method", "steps"),
    [(method, {"dt": dt}) for method, dt in LANES + OTHERS]
    + [(method, {"dt": None, "tolerance": tolerance}) for method, tolerance in FREE_LANES],
    ids=str,
)
def test_every_simd_level_gives_the_same_bits(
    formulation: str, method: str, steps: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    lowest, *others = _core.SIMD_LEVELS
    monkeypatch.setenv("SOFTPINCH_SIMD", lowest)
    stabilization = sp.Stabilization(alpha=300.0, beta=300.0)
    how = {"formulation": formulation, "method": method, "stabilization": stabilization, **steps}
    first = study(**how)
    assert first.provenance()["simd"] == lowest
    for level in others:
        monkeypatch.setenv("SOFTPINCH_SIMD", level)
        try:
            _core.simd_level()
        except ValueError:
            continue
        other = study(**how)
        assert other.provenance()["simd"] == level
        require_same(first, other)


# Each ends a run in a way of its own.
ENDS = {
    "separated": {"disturbances.0.force": (400.0, 0.0)},
    "not_finite": {"grasped.inertia": 1e-300, "grasped.mass": 1e-300},
}


def test_a_run_that_fails_keeps_its_row_and_touches_no_other() -> None:
    base = {
        "disturbances.0.force": np.tile([2.0, -1.0], (17, 1)),
        "hand.tip.youngs_modulus": np.full(17, 3e5),
        "grasped.inertia": np.full(17, 4e-5),
        "grasped.mass": np.full(17, 0.1),
    }
    base["grasped.mass"] = np.linspace(0.08, 0.12, 17)
    calm = sp.monte_carlo(scattered(), vary=base, dt=1e-3, summaries=SUMMARIES, progress=False)
    assert (calm.status == "completed").all()
    rows = {2: "separated", 5: "not_finite", 9: "not_finite", 16: "separated"}
    wild = {path: values.copy() for path, values in base.items()}
    for run, end in rows.items():
        for path, value in ENDS[end].items():
            wild[path][run] = value
    stormy = sp.monte_carlo(scattered(), vary=wild, dt=1e-3, summaries=SUMMARIES, progress=False)
    for run, end in rows.items():
        assert stormy.status[run] == end
        assert 0 <= stormy.failure_time[run] <= 0.06
        require_alone(stormy, run)
    calmly = np.setdiff1d(np.arange(17), list(rows))
    assert same(stormy["final_state"][calmly], calm["final_state"][calmly])
    failures = stormy.failures()
    assert [failure.run for failure in failures] == sorted(rows)
    assert failures[0].message == stormy.replay(2).message
    assert stormy.counts()["completed"] == 13


def test_summaries_are_what_the_recorded_run_says() -> None:
    after, band = 0.02, 5e-3
    ensemble = sp.monte_carlo(
        scattered(),
        15,
        vary=VARY,
        dt=5e-4,
        summaries=SUMMARIES,
        summaries_after=after,
        settling_band=band,
        progress=False,
    )
    for run in range(15):
        alone = require_alone(ensemble, run)
        rows = alone.t >= after
        q, p, forces = alone.q[rows], alone.p[rows], alone.multipliers[rows]
        expected = {
            "peak_rotation": np.abs(q[:, 2]).max(),
            "min_compression": q[:, 5:7].min(),
            "peak_friction_angle": np.arctan2(np.abs(forces[:, 2:]), forces[:, :2]).max(),
            "max_residual": np.abs(alone.residuals[rows]).max(),
            "energy_closure": np.abs(alone.energy.closure[rows]).max(),
            "peak_torque": np.abs(alone.torque[rows]).max(),
        }
        for name, value in expected.items():
            assert ensemble[name][run] == pytest.approx(value, rel=1e-14, abs=1e-300), name
        swing = 0.5 * alone.scene.grasped.width * p[:, 2]
        fast = np.flatnonzero(np.sqrt(p[:, 0] ** 2 + p[:, 1] ** 2 + swing**2) > band)
        settled = 0.0 if len(fast) == 0 else alone.t[rows][fast[-1]] - after
        settled = np.inf if len(fast) and fast[-1] == len(p) - 1 else settled
        assert ensemble["settling_time"][run] == settled


@pytest.mark.parametrize("method", ["dop853", "rosenbrock"])
def test_free_steps_see_a_switch_as_it_is_just_after(method: str) -> None:
    """The friction that a push asks for is largest at its end, and gone just after."""
    growing = sp.Sampled(
        times=[0.1, 0.15], force=[[0.0, 0.0], [0.0, 20.0]], moment=None, hold="linear"
    )
    scene = sp.Scene(disturbances=[growing, sp.Step(time=0.15, force=(0.0, -20.0))], duration=0.2)
    how = {"method": method, "formulation": "nullspace", "tolerance": 1e-6}
    ensemble = sp.monte_carlo(
        scene, 3, vary={"grasped.mass": [0.1, 0.11, 0.12]}, summaries="peak_friction_angle", **how
    )
    for run in range(3):
        forces = ensemble.replay(run).multipliers
        peak = np.arctan2(np.abs(forces[:, 2:]), forces[:, :2]).max()
        assert ensemble["peak_friction_angle"][run] == pytest.approx(peak, rel=1e-12)


def test_a_grasp_settles_once_and_a_late_window_sees_nothing() -> None:
    scene = sp.Scene(duration=0.5)
    ensemble = sp.monte_carlo(scene, 3, dt=1e-3, summaries="settling_time", progress=False)
    assert (ensemble["settling_time"] > 0).all() and (ensemble["settling_time"] < 0.5).all()
    nothing = sp.monte_carlo(
        scene, 3, dt=1e-3, summaries=SUMMARIES[1:], summaries_after=9.0, progress=False
    )
    assert all(np.isnan(values).all() for values in nothing.summaries.values())


def test_ensembles_travel() -> None:
    ensemble = study(check_dt=True, trajectories=(1,))
    copy = pickle.loads(pickle.dumps(ensemble))
    require_same(ensemble, copy)
    assert copy.discretisation["peak_rotation"] == ensemble.discretisation["peak_rotation"]
    assert copy.provenance() == ensemble.provenance()
    assert same(copy.replay(3).q, ensemble.replay(3).q)
    with pytest.raises(ValueError, match="read-only"):
        copy["peak_rotation"][0] = 1.0


def test_other_threads_of_python_go_on() -> None:
    ticks = 0
    over = threading.Event()

    def count() -> None:
        nonlocal ticks
        while not over.is_set():
            ticks += 1
            time.sleep(1e-3)

    counter = threading.Thread(target=count)
    counter.start()
    try:
        begin = time.perf_counter()
        sp.monte_carlo(sp.Scene(duration=0.5), 2000, dt=2e-4, threads=1, progress=False)
        spent = time.perf_counter() - begin
    finally:
        over.set()
        counter.join()
    # Held throughout, the interpreter would let it tick a handful of times.
    assert ticks > 20 or spent < 0.05


def test_a_study_of_one_chunk_makes_its_batch_once(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    make = StudySpec.batch

    def counted(spec: StudySpec, block: Rows) -> _core.Batch:
        sizes.append(len(block))
        return make(spec, block)

    monkeypatch.setattr(StudySpec, "batch", counted)
    few = sp.Scene(duration=0.01)
    sp.monte_carlo(few, 30, dt=1e-3, vary={"grasped.mass": sp.Uniform(0.08, 0.12)})
    assert sizes == [30]
    sizes.clear()
    # Of two chunks only the last one is still there.
    monkeypatch.setattr("softpinch.study.compute.MOST_BLOCKS", 1)
    monkeypatch.setattr("softpinch.montecarlo.MOST_BLOCKS", 1)
    sp.monte_carlo(few, 1030, dt=1e-3, vary={"grasped.mass": sp.Uniform(0.08, 0.12)})
    assert sizes == [1024, 6, 1024]
