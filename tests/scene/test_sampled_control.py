"""`SampledController` as a record: its fields, files, and what it refuses."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp

PID = sp.SampledController.pid(1e-3, 4.0, 0.05, 20.0, delay=1.4e-3, limits=(-3.0, 3.0))
GAIN = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]
STATIC = sp.SampledController(2e-3, D=GAIN)


def test_a_file_keeps_every_field() -> None:
    noisy = replace(
        PID,
        measure_noise={"angle_rate": 0.1},
        resolution=1e-3,
        anti_windup=True,
        initial_torque=(0.3, 0.4),
        initial_state=(0.01, 0.02),
        seed=3,
        run=4,
    )
    for control in (PID, STATIC, noisy):
        scene = sp.Scene(control=control, duration=0.1)
        assert sp.Scene.from_toml(scene.to_toml()) == scene
        assert sp.SampledController.from_dict(control.to_dict()) == control
    assert np.array_equal(noisy.measure_noise, [0.0, 0.0, 0.1, 0.1])
    assert np.array_equal(noisy.resolution, [1e-3] * 4)


def test_a_pid_has_the_gains_that_it_says() -> None:
    assert PID.B is not None and PID.C is not None and PID.D is not None
    error, rate = np.array([0.1, -0.2]), np.array([3.0, 1.0])
    y = np.hstack([error, rate])
    np.testing.assert_allclose(PID.D @ y, -4.0 * error - 0.05 * rate)
    np.testing.assert_allclose(PID.B @ y, 1e-3 * error)
    np.testing.assert_allclose(PID.C @ [1.0, 2.0], [-20.0, -40.0])


# The message names the first of these fields.
BAD: list[dict[str, Any]] = [
    {"period": 0.0},
    {"delay": -1e-3},
    {"measures": ()},
    {"D": [[np.nan] * 4] * 2},
    {"C": [[1.0, 0.0]]},
    {"limits": (1.0, -1.0)},
    {"limits": (1.0,)},
    {"limits": (np.inf, np.inf)},
    {"measure_noise": -1.0},
    {"measure_noise": {"rotation": 1.0}},
    {"resolution": [0.1]},
    {"initial_state": [1.0]},
    {"seed": -1},
]
SAID: dict[str, dict[str, Any]] = {
    r"measures\[0\] = 'angel'.*did you mean \"angle\"": {"measures": ("angel",)},
    "more than once": {"measures": ("angle", "angle")},
    r"B = None|B has shape": {"A": [[1.0]]},
    r"A has shape": {"A": [[1.0, 0.0]]},
    r"B has shape \(1, 4\): must have shape \(2, 4\)": {"B": [[1.0] * 4]},
    r"A = None": {"A": None},
    r"initial_torque = \(0\.0, 0\.0\): must be within the limits": {"limits": (0.5, 3.0)},
    r"measure_noise\['target'\] = 1\.0: must be 0": {
        "measures": ("angle", "target"),
        "measure_noise": {"target": 1.0},
    },
    "no gains": {"A": None, "B": None, "C": None, "D": None},
}


@pytest.mark.parametrize(
    ("message", "changed"),
    [*((rf"SampledController\.{next(iter(bad))}", bad) for bad in BAD), *SAID.items()],
)
def test_bad_fields_are_refused(message: str, changed: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=message):
        replace(PID, **changed)


def test_scenes_refuse_what_does_not_fit() -> None:
    with pytest.raises(ValueError, match=r"control=SampledController\(\.\.\.\): with fingers"):
        sp.Scene(control=PID, fingers="driven")
    with pytest.raises(ValueError, match="the controller's samples"):
        sp.simulate(sp.Scene(control=replace(PID, period=1e-9, delay=0.0), duration=1.0))
    late = replace(PID, delay=1e3, measure_delay=1.0)
    for named, one in (
        (r"control\.delay: measure_delay \+ delay are 1001000 periods of 0\.001 s; must", late),
        (
            r"control\.outer\.measure_delay: .* 20000",
            sp.SampledController.cascade(
                [replace(STATIC, measure_delay=20000 * STATIC.period), PID]
            ),
        ),
    ):
        with pytest.raises(ValueError, match=named):
            sp.simulate(sp.Scene(control=one, duration=0.01))
    scene = sp.Scene(control=PID, duration=0.01)
    for call in (
        lambda: sp.evaluate(scene, 0.0, scene.start().q, np.zeros(9)),
        lambda: sp.modes(scene, [0.0], [scene.start().q], [[0.0] * 9], [[0.0, 0.0]]),
        lambda: sp.max_stable_dt(scene),
        lambda: sp.reference.solve(scene),
    ):
        with pytest.raises(ValueError, match=r"control=SampledController|'sampled'"):
            call()


def test_states_of_another_controller_are_refused() -> None:
    scene = sp.Scene(control=PID, duration=0.01)
    state = sp.simulate(scene).state()
    for other, named in (
        (replace(scene, control=sp.Pid()), r"Scene\.initial\.controller"),
        (
            replace(scene, control=replace(PID, delay=9e-3)),
            r"State\.controller: 13 numbers instead of 27; must be a state of this controller",
        ),
        (replace(scene, control=STATIC), r"State\.controller: 13 numbers instead of 7"),
        (
            replace(scene, control=sp.SampledController.cascade([STATIC, PID])),
            r"State\.controller: 13 numbers instead of 20",
        ),
    ):
        with pytest.raises(ValueError, match=named):
            sp.simulate(replace(other, initial=state))
    assert state.controller is not None
    strong = replace(state, controller=np.where(np.arange(len(state.controller)) == 3, 9.0, 0.0))
    with pytest.raises(
        ValueError, match=r"State\.controller = 9\.0.*within the controller's limits"
    ):
        sp.simulate(replace(scene, initial=strong))
    begun = replace(state, controller=np.hstack([[0.3], np.zeros(12)]))
    for other in (replace(state, time=0.5), begun):  # after the next sample; before the origin
        with pytest.raises(ValueError, match="last sample"):
            sp.simulate(replace(scene, initial=other))


def test_studies_refuse_fields_that_cannot_vary() -> None:
    scene = sp.Scene(control=PID, duration=0.01)
    for path in ("control.seed", "control.kp", "control.measures", "control.left.delay"):
        with pytest.raises(ValueError, match=path.rsplit(".", maxsplit=1)[-1]):
            sp.monte_carlo(scene, 2, vary={path: sp.Uniform(0.0, 1.0)}, progress=False)
    with pytest.raises(ValueError, match=r"run \d+: .*delay"):
        sp.monte_carlo(scene, vary={"control.delay": [1e-3, -1e-3]}, progress=False)


def test_a_schedule_has_the_quantity_of_the_first_block() -> None:
    """A camera passes target angles on to a servo; a loop of forces makes angles of forces."""
    eye, none = np.eye(2), np.zeros((2, 2))
    servo = sp.SampledController.pid(1e-3, 20.0, 0.2, 0.0)
    camera = sp.SampledController(
        0.03, D=np.hstack([[[1], [-1]], eye]), measures=("rotation", "target")
    )
    force = sp.SampledController(
        0.01, D=np.hstack([-0.01 * eye, none, 0.01 * eye]), measures=("multipliers", "target")
    )
    passing = sp.SampledController(0.01, D=eye, measures=("target",))
    newtons = sp.Schedule.steps([0.0], [[2.0, 2.0]])
    for blocks, angles in (
        ([servo], True),
        ([camera, servo], True),
        ([passing, camera, servo], True),
        ([force, servo], False),
        ([passing, force, servo], False),
        ([passing], False),
    ):
        scene = sp.Scene(control=sp.SampledController.cascade(blocks), schedule=newtons)
        assert scene.schedules_angles == angles
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            sp.simulate(replace(scene, duration=1e-3, contact="unilateral", friction=0.5))
        assert any("schedule.angles" in str(one.message) for one in caught) == angles
        units = scene.vary_paths()
        assert units["schedule.angles.0.0"][1] == ("rad" if angles else "unknown")
        assert units["control.D"][1] == "N m"
        for name in ("C", "D", "limits", "initial_torque", "rate_limit"):
            path = f"control.outer.{name}"
            assert path not in units or units[path][1] == "unknown", path
