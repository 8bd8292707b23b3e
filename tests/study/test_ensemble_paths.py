"""Varied paths give the scenes of `scene_of`: several fields together, classes of users."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest

import softpinch as sp
from scenes import uneven
from softpinch.scene.disturbance import Compiled, Disturbance

SCENE = sp.Scene(
    schedule=sp.Schedule.minimum_jerk([0.0, 0.005, 0.015], np.full((3, 2), 0.1), move_time=0.01),
    duration=0.03,
)


def require_alone(scene: sp.Scene, vary: Mapping[str, object], **how: object) -> sp.Ensemble:
    """Every run is the run of `scene_of`, to the bit, and they differ."""
    ensemble = sp.monte_carlo(scene, vary=vary, dt=1e-3, progress=False, **how)
    for row, run in enumerate(ensemble.run):
        alone = sp.simulate(ensemble.scene_of(run), dt=1e-3)
        last = np.concatenate([alone.q[-1], alone.p[-1]])
        assert ensemble["final_state"][row].tobytes() == last.tobytes(), run
        assert (ensemble.status[row], ensemble.message[row]) == (alone.status, alone.message)
    assert len({row.tobytes() for row in ensemble["final_state"]}) == ensemble.runs
    return ensemble


def test_fields_that_keep_a_rule_only_together_are_replaced_together() -> None:
    # Moves of 10 ms would overlap at these times, and so would moves of 25 ms at the scene's own.
    vary = {
        "schedule.times": np.array([[0.0, 0.001, 0.006], [0.0, 0.002, 0.029]]),
        "schedule.move_time": np.array([0.004, 0.025]),
        "schedule.angles.2": np.array([[0.12, 0.1], [0.1, 0.13]]),
    }
    for names in (list(vary), list(vary)[::-1]):
        ensemble = require_alone(SCENE, {name: vary[name] for name in names})
        assert ensemble.scene_of(1).schedule.move_time == 0.025
    steps = replace(SCENE, schedule=sp.Schedule.steps([0.0, 0.002], [[0.1, 0.1], [0.11, 0.1]]))
    later = {"schedule.times.0": [0.004, 0.006], "schedule.times.1": [0.0083, 0.0071]}
    assert require_alone(steps, later).scene_of(0).schedule.times.tolist() == [0.004, 0.0083]


def test_a_side_and_a_field_of_both_vary_together() -> None:
    vary = {
        "hand.tip.youngs_modulus": np.array([2e5, 3e5, 4e5]),
        "hand.tip.left.radius": np.array([0.02, 0.021, 0.022]),
        "hand.tip.right.normal_mass": np.array([0.1, 0.2, 0.05]),
        "grasped.mass": np.array([0.08, 0.1, 0.12]),
        "control.left.kp": np.array([90.0, 100.0, 110.0]),
        "control.ki": np.array([900.0, 1000.0, 1100.0]),
        "friction": np.array([0.1, 0.2, 0.3]),
        "hand.left.inertia": np.array([5e-4, 6e-4, 7e-4]),
    }
    scene = replace(SCENE, initial="touching")
    ensemble = require_alone(scene, vary)
    right, left = ensemble.scene_of(2).hand.tip
    assert (right.youngs_modulus, left.youngs_modulus) == (4e5, 4e5)
    assert (right.radius, left.radius) == (0.02, 0.022)
    # What is not given is the object's mass, which varies too.
    assert (right.normal_mass, left.normal_mass, right.tangential_mass) == (0.05, None, None)
    pids = ensemble.scene_of(2).control
    assert [(pid.kp, pid.ki) for pid in pids] == [(100.0, 1100.0), (110.0, 1100.0)]
    pairs = {path: values for path, values in vary.items() if "left" in path or "right" in path}
    require_alone(uneven(), pairs)


def test_a_start_varies() -> None:
    scene = replace(SCENE, disturbances=[sp.Impulse(time=0.0112, impulse=(0.01, 0.0))])
    begun = sp.simulate(scene, dt=1e-3)
    for row in (4, 9, 13):
        start = replace(scene, initial=begun.state(row), duration=0.012)
        require_alone(start, {"initial.time": [start.initial.time, 0.005, 0.0112]})
        q = np.tile(start.initial.q, (3, 1)) + 1e-6 * np.arange(3)[:, None]
        vary = {"initial.q": q, "initial.integral": [[0, 0], [0, 1e-4], [1e-4, 0]]}
        require_alone(start, vary)
        require_alone(start, {"initial.p.2": [0.0, 0.1, 0.2]})


@pytest.mark.parametrize("runs", [1, 1023, 1024, 1025, 2 * 32 * 1024 + 3])
def test_batches_and_blocks_have_no_seams(runs: int) -> None:
    scene = sp.Scene(
        disturbances=[sp.Noise(force_std=2.0, moment_std=0.0, rate_hz=1e3)], duration=2e-3
    )
    masses = np.geomspace(0.05, 0.2, runs)
    ensemble = sp.monte_carlo(
        scene, vary={"grasped.mass": masses}, dt=1e-3, threads=64, progress=False
    )
    assert ensemble.runs == runs
    np.testing.assert_array_equal(ensemble.run, np.arange(runs))
    seams = np.array([k for k in (0, 1023, 1024, 32767, 32768, 65536, runs - 1) if k < runs])
    require_alone(scene, {"grasped.mass": masses}, only=np.unique(seams))
    some = sp.monte_carlo(
        scene, vary={"grasped.mass": masses}, dt=1e-3, only=np.unique(seams), progress=False
    )
    np.testing.assert_array_equal(some["final_state"], ensemble["final_state"][np.unique(seams)])


def own(cls: type) -> type:
    return dataclass(frozen=True, kw_only=True, eq=False, repr=False)(cls)


@own
class Gust(Disturbance):
    """Noise by another name, and a step: it keeps its own stream."""

    std: float = 2.0

    def compile(self) -> Compiled:
        noise = sp.Noise(force_std=self.std, moment_std=0.0, rate_hz=400.0, seed=5).compile()
        return noise._replace(forces=sp.Step(time=0.001, force=(1.0, 0.0)).compile().forces)


@own
class Push(sp.Step):
    """A step whose force follows from another field."""

    angle: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("force", (3 * float(np.cos(self.angle)), 3 * float(np.sin(self.angle))))


def test_disturbances_of_users_own_are_what_they_are_alone() -> None:
    for one, path, values in (
        (Gust(), "disturbances.1.std", [0.5, 1.0, 2.0]),
        (Gust(), "grasped.mass", [0.09, 0.1, 0.11]),
        (Push(time=0.001), "disturbances.1.angle", [0.0, 1.0, 2.0]),
    ):
        scene = replace(SCENE, disturbances=[sp.Step(time=0.0), one])
        require_alone(scene, {path: values})
