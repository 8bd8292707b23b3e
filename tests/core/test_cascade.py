"""Cascades of discrete controllers: beside SciPy, with given draws, resumed, and in lanes."""

import warnings
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from ensembles import require_alone
from oracle.parts import PartsModel, parts_reference
from other_hands import SCENES
from sampled_blocks import PUSH, SAME, TURN, WEAK, Block, drawn, under_held_torques
from softpinch.run import Options, Request
from transforms import Units

EYE, ZERO = np.eye(2), np.zeros((2, 2))
# It moves the targets of the servo against the object's rotation, by proportion and integral.
SWAY = np.array([[1.0], [-1.0]])
CAMERA = sp.SampledController(
    1 / 137,
    [[1.0]],
    [[1 / 137, 0.0, 0.0, 0.0, 0.0]],
    2.0 * SWAY,
    np.hstack([0.4 * SWAY, 0.002 * SWAY, -0.002 * SWAY, EYE]),
    measures=("rotation", "velocity", "target"),
    first_sample=1.1e-3,
    measure_delay=9.4e-3,
    delay=0.7e-3,
    initial_torque=(0.1, 0.11),
)
SERVO = sp.SampledController.pid(
    1e-3,
    4.0,
    0.05,
    20.0,
    first_sample=0.2e-3,
    delay=1.45e-3,
    limits=(-3.0, 3.0),
    initial_torque=(0.42, 0.4),
)


def cascade(camera: dict[str, Any] | None = None, servo: dict[str, Any] | None = None) -> Any:
    blocks = replace(CAMERA, **(camera or {})), replace(SERVO, **(servo or {}))
    return sp.SampledController.cascade(blocks)


def scene_of(control: sp.SampledController, **changes: Any) -> sp.Scene:
    return sp.Scene(
        **{"schedule": TURN, "disturbances": [PUSH], "duration": 0.04} | changes, control=control
    )


def until(end: float, start: float) -> float | None:
    """The duration from `start` that ends at exactly `end`, if there is one."""
    near = end - start
    return next((x for x in (near, *np.nextafter(near, [0.0, 1.0])) if start + x == end), None)


def by_scipy(scene: sp.Scene, held: Any = under_held_torques) -> tuple[np.ndarray, np.ndarray]:
    """The last q and p, by SciPy between the instants at which a block does something."""
    parts = [block for _, block in scene.control.blocks()]  # type: ignore[union-attr]
    blocks = [Block(one, k, scene.duration) for k, one in enumerate(parts)][::-1]
    whole = np.sort(np.hstack([[0.0], *[np.hstack([b.taken, b.used, b.acting]) for b in blocks]]))
    whole = whole[np.diff(whole, prepend=-1.0) > SAME]
    instants = [*whole[whole < scene.duration], scene.duration]
    state = scene.start()
    for begin, end in pairwise(instants):
        schedule = target = scene.schedule.target(begin)
        for block in blocks:
            block.at(begin, state.q, state.p, target, schedule)
            target = block.force
        state = held(scene, state, begin, end, target)
    return state.q, state.p


LOOPS = {
    "two rates": cascade(),
    "commensurate": cascade(
        {"period": 5e-3, "first_sample": 0.0, "measure_delay": 6e-3, "delay": 1e-3},
        {"first_sample": 0.0, "delay": 1e-3},
    ),
    "lost samples": cascade({"loss": 0.4}, {"loss": 0.3, "seed": 11, "run": 3}),
    "uniform jitter": cascade({"jitter": 5e-3}, {"jitter": 0.8e-3, "seed": 5}),
    "normal jitter": cascade(
        {"jitter": 4e-3, "jitter_kind": "normal", "loss": 0.2},
        {"jitter": 0.7e-3, "jitter_kind": "normal", "measure_delay": 1.7e-3, "seed": 6},
    ),
    "limits of rate and dead zones": cascade(
        {"dead_zone": {"rotation": 2e-4}, "rate_limit": 0.05},
        {"dead_zone": {"angle_error": 1e-3, "angle_rate": 0.01}, "rate_limit": 8.0},
    ),
    "a motor": cascade({}, {"limits": (-0.9, 0.9), "no_load_rate": 1.2, "rate_limit": 300.0}),
    # The servo from 0.018 s on, and the camera while the object is turned.
    "two sets of gains": cascade(
        {"switch": sp.GainSwitch(C=3.0 * SWAY, measure="rotation", above=1e-3, latched=False)},
        {"switch": sp.GainSwitch(A=0.99 * EYE, C=-5.0 * EYE, D=1.5 * SERVO.D, at=0.018)},
    ),
    "gains that stay": cascade(
        {"measure_delay": 0.0, "delay": 0.0},
        {
            "dead_zone": {"angle_error": 1e-3},
            "switch": sp.GainSwitch(D=0.4 * SERVO.D, measure="angle_rate", above=0.6, below=-0.6),
        },
    ),
    "three blocks": sp.SampledController.cascade(
        [
            replace(CAMERA, measure_delay=0.0),
            sp.SampledController(
                2.3e-3,
                D=np.hstack([0.7 * EYE, 0.3 * EYE, ZERO]),
                measures=("target", "schedule", "target_rate"),
                delay=0.3e-3,
                initial_torque=(0.1, 0.1),
            ),
            SERVO,
        ]
    ),
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_cascade_is_that_of_scipy(name: str) -> None:
    scene = scene_of(LOOPS[name])
    q, p = by_scipy(scene)
    exact = sp.simulate(scene, method="dop853", formulation="projected", tolerance=1e-12)
    assert exact.success
    for found, expected in ((exact.q[-1], q), (exact.p[-1], p)):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    # The camera matters, and so does what the loop is named after.
    alone = sp.simulate(replace(scene, control=SERVO), 1e-4)
    assert np.abs(alone.q[-1] - q).max() > 1e-5
    plain = sp.simulate(scene_of(LOOPS["two rates"]), 1e-4)
    assert name == "two rates" or np.abs(plain.q[-1] - q).max() > 1e-5
    # Equal steps keep the order four. Segments may be shorter than dt, so each step is halved.
    request = Request(scene, Options.checked(dt=2e-4, formulation="projected"))
    errors = []
    for refine in (1, 2, 4):
        final = request.run_to_end(refine)["final"]
        errors.append(np.hstack([(final["q"] - q) / 0.1, final["p"] - p]))
    sizes = np.abs(errors).max(axis=1)
    orders = np.log2(sizes[:-1] / sizes[1:])
    assert ((orders > 3.5) & (orders < 4.5)).all(), (sizes, orders)


def by_parts(scene: sp.Scene) -> tuple[np.ndarray, np.ndarray]:
    """The last q and p by SciPy with SymPy's equations of other parts, derived once."""
    weak = replace(scene, control=sp.Pid(kp=WEAK, kd=0.0, ki=0.0))
    model = PartsModel(weak)

    def held(_: sp.Scene, state: sp.State, begin: float, end: float, force: Any) -> sp.State:
        schedule = sp.Schedule.steps([0.0], [force / WEAK])
        start = replace(state, time=begin, check=False)
        one = replace(weak, schedule=schedule, initial=start, duration=end - begin)
        last = parts_reference(one, [begin + one.duration], model=model)
        return sp.State(last.q[-1], last.p[-1])

    return by_scipy(scene, held)


# In N, N/m, N s/m and N/(m s); of the link in N m.
GRIPPER = sp.SampledController.pid(
    1e-3, 2e3, 30.0, 2e4, delay=1.45e-3, limits=(-40.0, 40.0), initial_torque=(14.0, 12.0)
)
BOTH = np.array([[4.0, 2e3], [0.05, 30.0]])  # K_P and K_D of a link and of a jaw


@pytest.mark.parametrize("name", ["jaws and a box", "a link and a jaw"])
def test_jaws_have_the_forces_of_a_sampled_law(name: str) -> None:
    """Beside SymPy's equations with forces held between the instants; a jaw in a cascade too."""
    control = GRIPPER
    if name == "a link and a jaw":
        gains = np.hstack([-np.diag(row) for row in BOTH])
        move = np.array([[0.4], [-0.02]])  # rad and m for a rad
        camera = replace(CAMERA, D=np.hstack([move, 0.002 * move, -0.002 * move, EYE]), C=5 * move)
        servo = sp.SampledController(1.3e-3, D=gains, delay=0.4e-3, initial_torque=(0.4, 12.0))
        camera = replace(camera, initial_torque=(0.08, 6e-3))
        control = sp.SampledController.cascade([camera, servo])
    scene = replace(
        SCENES[name], control=control, disturbances=[replace(PUSH, moment=0.02)], duration=0.03
    )
    q, p = by_parts(scene)
    exact = sp.simulate(scene, method="dop853", formulation="projected", tolerance=1e-12)
    assert exact.success
    for found, expected in ((exact.q[-1], q), (exact.p[-1], p)):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    held = replace(scene, control=sp.Torque(), schedule=sp.Schedule.steps([0], [[14.0, 12.0]]))
    assert np.abs(sp.simulate(held).q[-1] - q).max() > 1e-4


def test_instants_that_differ_by_round_off_are_one() -> None:
    """A camera at 30 Hz and a servo at 1 kHz meet each 0.1 s, and the camera acts first there."""
    camera = replace(CAMERA, period=1 / 30, first_sample=0.0, measure_delay=0.03, delay=1 / 30)
    for servo in (SERVO, replace(SERVO, period=0.7e-3)):
        control = sp.SampledController.cascade([camera, replace(servo, first_sample=0.0, delay=0)])
        run = sp.simulate(scene_of(control, duration=0.45), 1e-3)
        assert run.success
        assert np.diff(run.t).min() > 1e-6


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize("how", [{"dt": 1e-4}, {"tolerance": 1e-5, "method": "dop853"}])
def test_a_run_goes_on_from_any_row(name: str, how: dict[str, Any]) -> None:
    contact: Any = {"contact": "unilateral", "friction": 0.3} if "jitter" in name else {}
    noisy = {"measure_noise": 1e-3, "resolution": 1e-4}
    blocks = [block for _, block in LOOPS[name].blocks()][::-1]
    control = sp.SampledController.cascade(
        [replace(b, outer=None, **(noisy if "target" not in b.measures else {})) for b in blocks]
    )
    scene = scene_of(control, **contact)
    run = sp.simulate(scene, **how)
    assert run.success
    resumed = 0
    for row in range(0, len(run) - 1, 7):
        state = run.state(row)
        duration = until(scene.duration, state.time)
        if duration is None:
            continue
        resumed += 1
        again = sp.simulate(replace(scene, initial=state, duration=duration), **how)
        if "dt" in how:  # adaptive steps depend on all earlier ones
            assert np.array_equal(again.q[-1], run.q[-1]), row
            assert np.array_equal(again.p[-1], run.p[-1]), row
            assert again.state() == run.state(), row
        else:
            np.testing.assert_allclose(again.q[-1], run.q[-1], atol=1e-5)
    assert resumed > 9


VARY = {
    "control.delay": sp.Uniform(0.0, 3e-3),
    "control.switch.at": sp.Uniform(0.0, 0.03),
    "control.switch.D.0.0": sp.Uniform(-2.0, -1.0),
    "control.outer.switch.above": sp.Uniform(0.0, 2e-3),
    "control.jitter": sp.Uniform(0.0, 0.4e-3),
    "control.D.0.0": sp.Uniform(-5.0, -3.0),
    "control.outer.period": sp.Uniform(4e-3, 9e-3),
    "control.outer.measure_delay": sp.Uniform(0.0, 12e-3),
    "control.outer.loss": sp.Uniform(0.1, 0.5),
    "control.outer.D.0.0": sp.Uniform(0.1, 0.4),
    "grasped.mass": sp.Uniform(0.08, 0.12),
}


@pytest.mark.parametrize("method", ["rk4", "radau5", "rosenbrock"])
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize("adaptive", [False, True])
def test_runs_in_lanes_have_the_bits_that_they_have_alone(
    method: str, contact: str, adaptive: bool
) -> None:
    noisy = {"measure_noise": {"angle_error": 1e-3, "angle_rate": 0.1}}
    turned = sp.GainSwitch(D=0.5 * CAMERA.D, measure="rotation", above=1e-3, latched=adaptive)
    control = cascade(
        {"measure_noise": {"rotation": 1e-3}, "switch": turned},
        noisy | {"switch": sp.GainSwitch(D=0.3 * SERVO.D, at=0.01)},
    )
    scene = scene_of(control, contact=contact, friction=0.3, duration=0.025)
    method = "dop853" if adaptive and method == "rk4" else method
    how: dict[str, Any] = {"tolerance": 1e-4} if adaptive else {"dt": 1e-4}
    found = sp.monte_carlo(
        scene, 21, seed=5, vary=VARY, method=method, progress=False, threads=2, **how
    )
    for run in range(21):
        one = require_alone(found, run).scene.control
        assert isinstance(one, sp.SampledController) and one.outer is not None
        assert {(b.seed, b.run) for _, b in one.blocks()} == {(5, run)}


def test_a_cascade_of_one_block_is_that_block() -> None:
    assert sp.SampledController.cascade([SERVO]) == SERVO
    # A block before it that passes its targets on without delay changes no bit.
    through = sp.SampledController(1e-3, D=EYE, measures=("target",), first_sample=0.2e-3)
    scenes = [
        scene_of(one, schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]]))
        for one in (SERVO, sp.SampledController.cascade([through, SERVO]))
    ]
    one, two = (sp.simulate(scene) for scene in scenes)
    assert np.array_equal(one.t, two.t)
    assert np.array_equal(one.q, two.q)


def test_two_sets_of_gains_are_those_of_two_controllers() -> None:
    """Until the switch the bits are those of the first one, and from the start on of the second."""
    second = replace(SERVO, C=2.0 * SERVO.C, D=0.5 * SERVO.D)
    for at, alone in ((1.0, SERVO), (-1.0, second)):
        switched = replace(SERVO, switch=sp.GainSwitch(C=second.C, D=second.D, at=at))
        one, two = (sp.simulate(scene_of(control)) for control in (alone, switched))
        assert np.array_equal(one.q, two.q)
        flag = two.state().controller[-1]
        assert np.array_equal(one.state().controller, two.state().controller[:-1])
        assert flag == (at < 0.0)


@pytest.mark.parametrize("number", [3, 5, 7, 9])
def test_the_sample_at_the_instant_of_a_switch_has_the_second_gains(number: int) -> None:
    """Also where the sample's own instant, number * 1.7e-3, is less but for round-off."""
    at = float(Fraction("1.7e-3") * number)
    assert number == 9 or 1.7e-3 * number < at
    block = sp.SampledController(
        1.7e-3, D=EYE, measures=("target",), switch=sp.GainSwitch(D=2.0 * EYE, at=at)
    )
    run = sp.simulate(scene_of(block, duration=0.04), record=("state", "torque"))
    single = [TURN.target(t)[0] for t in (0.0, 0.0125)]
    after = run.torque[:, 0] > 1.2 * max(single)
    assert run.t[np.argmax(after)] == pytest.approx(at, abs=1e-9)
    assert after[np.argmax(after) :].all()


def test_the_mirror_image() -> None:
    """With the fingers exchanged and x, the rotation and the moments turned round."""
    push = sp.Pulse(time=0.0105, duration=0.01, force=(3.0, -1.0), moment=0.01)
    turn = sp.Schedule.steps([0.0], [[0.1, 0.12]])
    turned = sp.GainSwitch(C=9.0 * SWAY, measure="rotation", below=-1e-3)
    control = cascade({"loss": 0.3, "jitter": 2e-3, "switch": turned}, {"jitter": 0.3e-3})
    mirrored_camera = replace(
        CAMERA,
        loss=0.3,
        jitter=2e-3,
        D=np.hstack([0.4 * SWAY, 0.002 * SWAY, 0.002 * SWAY, EYE]),
        initial_torque=CAMERA.initial_torque[::-1],
        switch=sp.GainSwitch(C=9.0 * SWAY, measure="rotation", above=1e-3),
    )
    mirrored = sp.SampledController.cascade(
        [mirrored_camera, replace(SERVO, jitter=0.3e-3, initial_torque=(0.4, 0.42))]
    )
    one = sp.simulate(scene_of(control, schedule=turn, disturbances=[push]))
    other = sp.simulate(
        scene_of(
            mirrored,
            schedule=sp.Schedule.steps([0.0], [[0.12, 0.1]]),
            disturbances=[replace(push, force=(-3.0, -1.0), moment=-0.01)],
        )
    )
    image = other.q[:, [0, 1, 2, 4, 3, 6, 5, 8, 7]] * [-1, 1, -1, 1, 1, 1, 1, 1, 1]
    assert np.abs(one.q[:, 2]).max() > 1e-3
    np.testing.assert_allclose(image, one.q, atol=1e-10)


def test_lost_samples_and_jitter_have_their_odds() -> None:
    """A controller that puts out what it measures shows which samples it has, and when."""
    pick = np.hstack([EYE, np.zeros((2, 2)), [[1e-3], [0.0]]])
    measures = ("target", "target_rate", "rotation")
    one = sp.SampledController(1e-3, D=pick, measures=measures, loss=0.25, jitter=0.9e-3, run=7)
    load = sp.Schedule.steps([0.0], [[0.42, 0.42]])
    run = sp.simulate(scene_of(one, schedule=load, duration=0.4), record=("state", "torque"))
    draws = np.array([drawn(one, 0, k) for k in range(399)])
    rows = np.searchsorted(run.t, 1e-3 * np.arange(399) + 0.9e-3 * draws[:, 1] - 1e-12)
    kept = np.isclose(run.torque[rows, 0], 0.42 + 1e-3 * run.q[rows, 2], rtol=0.0, atol=1e-15)
    lost = draws[:, 0] < 0.25
    lost[0] = False
    # Before the push the object does not turn.
    assert np.array_equal(~kept[30:], lost[30:])
    assert not lost[~kept].any() or lost[~kept].all()
    assert 0.17 < lost.mean() < 0.33


def test_simulators_set_the_targets_of_the_first_block() -> None:
    calm = sp.GainSwitch(D=0.5 * SERVO.D, measure="angle_rate", above=0.1)
    control = cascade({"loss": 0.2}, {"jitter": 0.4e-3, "switch": calm})
    scene = scene_of(control, contact="unilateral", friction=0.6)
    sim = sp.Simulator(scene, 1.7e-3, 1e-4)
    middle = None
    for k in range(24):
        seen = sim.step((0.105 + 1e-4 * k, 0.11))
        if k == 9:
            middle = sim.state()
    assert seen.status == "completed"
    run = sim.run()
    assert np.array_equal(run.q[-1], seen.q)
    assert run.state().controller.tolist() == sim.state().controller.tolist()
    assert middle is not None
    sim.set_state(middle)
    for k in range(10, 24):
        again = sim.step((0.105 + 1e-4 * k, 0.11))
    assert np.array_equal(again.q, seen.q)
    first = sim.reset()
    assert first.t == 0.0
    many = sp.VectorSimulator(scene, 3, 1.7e-3, 1e-4, vary={"control.outer.delay": [0, 1e-3, 2e-3]})
    alone = sp.Simulator(many.scene(2), 1.7e-3, 1e-4)
    for _ in range(12):
        rows = many.step(np.full((3, 2), 0.11))
        assert np.array_equal(rows.q[2], alone.step((0.11, 0.11)).q)


def test_files_and_bad_blocks() -> None:
    for name in ("two sets of gains", "normal jitter"):
        scene = scene_of(LOOPS[name])
        assert sp.Scene.from_toml(scene.to_toml()) == scene
    assert scene.vary_paths()["control.outer.period"] == (1 / 137, "s")
    changed = scene.with_({"control.outer.delay": 2e-3, "control.seed": 9})
    assert changed.control.outer.delay == 2e-3
    assert changed.control.outer.seed == 9
    of = sp.SampledController.cascade
    for blocks, kind, named in (
        ([], ValueError, r"their number = 0: must be at least 1"),
        ([SERVO] * 17, ValueError, "must be at most 16"),
        ([SERVO, sp.Pid()], TypeError, r"blocks\[1\] = Pid.*must be a SampledController"),
        (SERVO, TypeError, "must be several SampledControllers"),
        ([SERVO, of([CAMERA, SERVO])], ValueError, r"blocks\[1\]\.outer is given"),
    ):
        with pytest.raises(kind, match=named):
            of(blocks)
    for field, value, rule in (
        ("first_sample", -1.0, "must be finite and >= 0"),
        ("measure_delay", np.inf, "must be finite and >= 0"),
        ("loss", 1.0, "must be >= 0 and < 1"),
        ("jitter", 1e-3, "must be below the period"),
        ("jitter_kind", "poisson", 'must be one of "uniform", "normal"'),
        ("rate_limit", 0.0, "must be finite and > 0"),
        ("no_load_rate", 0.0, "must be finite and > 0"),
        ("dead_zone", -1.0, "must be finite and >= 0"),
    ):
        with pytest.raises(ValueError, match=rf"SampledController\.{field}.*{rule}"):
            replace(SERVO, **{field: value})
    motor = replace(SERVO, no_load_rate=2.0)
    for changes in (
        {"limits": None},
        {"limits": (-np.inf, 3.0)},
        {"measures": ("angle", "target")},
    ):
        with pytest.raises(
            ValueError, match=r"no_load_rate = 2\.0: needs finite limits, below and"
        ):
            replace(motor, **changes)
    with pytest.raises(ValueError, match=r"run 1: .*needs finite limits, below and"):
        sp.monte_carlo(scene_of(motor), vary={"control.limits.0.0": [-3.0, 1.0]}, progress=False)
    assert scene_of(motor).vary_paths()["control.no_load_rate"] == (2.0, "rad/s")
    second = SERVO.D
    for fields, rule in (
        ({"D": second}, "must have at, or measure with above or below"),
        ({"D": second, "measure": "angle_rate", "at": 1.0}, "must have at, or measure with"),
        ({"above": 1.0, "at": 1.0}, "must have at, or measure with"),
        ({"D": second, "at": np.nan}, r"GainSwitch\.at = NaN: must be finite"),
        ({"D": EYE, "at": 1.0}, r"GainSwitch\.D has shape \(2, 2\): must have shape \(2, 4\)"),
        ({"D": np.nan * second, "at": 1.0}, r"GainSwitch\.D\[0, 0\] = nan: must be finite"),
        ({"measure": "shear", "above": 1.0}, r"GainSwitch\.measure = 'shear': must be one of"),
    ):
        with pytest.raises(ValueError, match=rule):
            replace(SERVO, switch=sp.GainSwitch(**fields))
    switched = scene_of(LOOPS["two sets of gains"])
    with pytest.raises(ValueError, match=r"run 1: GainSwitch\.at = NaN"):
        sp.monte_carlo(switched, vary={"control.switch.at": [0.0, np.nan]}, progress=False)
    late = {"control.outer.measure_delay": [1e-3, -1e-3]}
    with pytest.raises(ValueError, match=r"run 1: .*measure_delay"):
        sp.monte_carlo(scene, vary=late, progress=False)
    with pytest.raises(ValueError, match=r"run 1: .*jitter"):
        sp.monte_carlo(scene, vary={"control.jitter": [1e-4, 1e-2]}, progress=False)
    state = sp.simulate(scene).state()
    with pytest.raises(ValueError, match=r"State\.controller"):
        sp.simulate(replace(scene, initial=state, control=SERVO))


def test_a_block_with_a_lag_is_an_actuator_of_first_order() -> None:
    """Its state follows the held output of the servo exactly, from sample to sample."""
    period, time, step = 1e-4, 5e-3, 4.0
    decay = np.exp(-period / time)
    lag = sp.SampledController(
        period, decay * EYE, (1 - decay) * EYE, EYE, measures=("target",), initial_torque=(0.0, 0.0)
    )
    command = sp.SampledController(1e-3, D=step * EYE, measures=("target",), delay=2e-3)
    scene = scene_of(sp.SampledController.cascade([command, lag]), disturbances=())
    run = sp.simulate(scene, record=("state", "torque"))
    rows = np.searchsorted(run.t, period * np.arange(390) - 1e-9)
    # Superposition of the steps of the command, which acts 2 ms after each sample.
    t, expected = run.t[rows], np.zeros((390, 2))
    wanted = np.vstack([[0.0, 0.0], step * TURN.target(1e-3 * np.arange(37))])
    for k, jump in enumerate(np.diff(wanted, axis=0)):
        after = np.maximum(t - 2e-3 - 1e-3 * k, 0.0)
        expected += jump * (1.0 - np.exp(-after / time))[:, None]
    np.testing.assert_allclose(run.torque[rows], expected, rtol=1e-9, atol=1e-12)
    assert np.ptp(run.torque[:, 0]) > 0.3


@pytest.mark.parametrize("powers", [(3, -2, 5), (-4, 6, -7)])
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_powers_of_two_scale_a_cascade_to_the_bit(
    powers: tuple[int, int, int], contact: str
) -> None:
    units = Units(*powers)
    time, torque = units.time, units.of(2, 1, -2)
    late = {"loss": 0.3, "jitter": 2e-3, "dead_zone": 0.0}
    second = sp.GainSwitch(D=0.5 * SERVO.D, at=0.017)
    control = cascade(
        late, {"jitter": 0.3e-3, "rate_limit": 500.0, "no_load_rate": 3.0, "switch": second}
    )
    scene = scene_of(sp.Pid(), contact=contact, friction=0.3)  # type: ignore[arg-type]
    times = ("period", "first_sample", "measure_delay", "delay", "jitter")

    def scaled(block: sp.SampledController, **changes: Any) -> sp.SampledController:
        return replace(block, outer=None, **{n: getattr(block, n) * time for n in times} | changes)

    (_, servo), (_, camera) = control.blocks()
    eyes = np.array([1.0, time / units.length, time / units.length, 1.0, 1.0])
    other = sp.SampledController.cascade(
        [
            scaled(camera, B=camera.B * time, C=camera.C / time, D=camera.D * eyes),
            scaled(
                servo,
                B=servo.B * time,
                C=servo.C * torque / time,
                D=servo.D * np.repeat([torque, torque * time], 2),
                limits=servo.limits * torque,
                initial_torque=np.array(servo.initial_torque) * torque,
                rate_limit=500.0 * torque / time,
                no_load_rate=3.0 / time,
                switch=sp.GainSwitch(
                    D=0.5 * servo.D * np.repeat([torque, torque * time], 2), at=0.017 * time
                ),
            ),
        ]
    )
    how: dict[str, Any] = {"record": ("state", "torque"), "formulation": "projected"}
    run = sp.simulate(replace(scene, control=control), 1e-4, **how)
    twin = sp.simulate(replace(units.scene(scene), control=other), 1e-4 * time, **how)
    assert run.success and np.abs(run.q[:, 2]).max() > 1e-3
    np.testing.assert_array_equal(twin.t, run.t * time)
    np.testing.assert_array_equal(twin.q, run.q * units.coordinates)
    np.testing.assert_array_equal(twin.p, run.p * units.coordinates / time)
    np.testing.assert_array_equal(twin.torque, run.torque * torque)


@pytest.mark.parametrize("runs", [2000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_random_loops_end_with_a_status_within_their_limits(runs: int) -> None:
    rng = np.random.default_rng(3)
    control = cascade(
        {"limits": (-2.0, 2.0), "measure_noise": {"rotation": 1e-3}},
        {
            "limits": (-3.0, 2.5),
            "anti_windup": True,
            "rate_limit": 1e3,
            "switch": sp.GainSwitch(D=-SERVO.D, measure="angle_rate", above=0.1),
        },
    )
    vary: dict[str, Any] = {
        "grasped.mass": sp.Uniform(0.05, 0.2),
        "control.switch.above": sp.Uniform(0.0, 2.0),
        "control.loss": sp.Uniform(0.0, 0.9),
        "control.jitter": sp.Uniform(0.0, 4e-4),
        "control.outer.jitter": sp.Uniform(0.0, 9e-4),
        "control.outer.loss": sp.Uniform(0.0, 0.9),
    }
    for path, low, high in (
        ("period", 5e-4, 5e-3),
        ("delay", 1e-5, 3e-2),
        ("measure_delay", 1e-5, 3e-2),
    ):
        for block in ("control", "control.outer"):
            vary[f"{block}.{path}"] = sp.LogUniform(max(low, 1e-3 * (path == "period")), high)
    for block, inner in (("control", cascade()), ("control.outer", CAMERA)):
        for name in "ABCD":
            for place in np.ndindex(np.shape(getattr(inner, name))):
                size = 10.0 ** rng.uniform(-3.0, 3.0, runs)
                entry = ".".join(map(str, place))
                vary[f"{block}.{name}.{entry}"] = size * rng.standard_normal(runs)
    for contact in ("bilateral", "unilateral"):
        scene = scene_of(control, contact=contact, friction=0.5, duration=0.01)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sp.StabilityWarning)
            found = sp.monte_carlo(
                scene, vary=vary, seed=2, dt=2e-4, progress=False, summaries=("peak_torque",)
            )
        assert set(found.status) <= set(sp._core.STATUSES)
        assert len(found.status) == runs
        peaks = found["peak_torque"]
        assert np.nanmax(peaks) == 3.0
        assert (found.status == "completed").mean() > 0.05
