"""Runs of a hand that moves: beside inertial coordinates, other gravities, and themselves."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import softpinch as sp
from core.test_moving_oracle import MOTIONS, TIMES, UNLIKE, require_close
from ensembles import require_alone
from oracle import parameters
from oracle.moving import Moving, moving, published
from softpinch import _core
from transforms import mirrored, mirrored_coordinates

G = UNLIKE.gravity
EVERYTHING = ("state", "multipliers", "energy", "torque")
CARRIED = replace(UNLIKE, motion=MOTIONS["turning"])
PUSH = sp.Pulse(time=0.02, duration=0.01, force=(60.0, 0.0))
# Tips slip and open.
SHOVED = sp.Scene(
    contact="unilateral",
    friction=0.4,
    hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
    schedule=sp.Schedule.in_degrees("steps", [0.0], [[6, 6]]),
    disturbances=[PUSH],
    duration=0.06,
)


def states(run: sp.Run) -> NDArray[np.float64]:
    return np.hstack([run.q, run.p])


@cache
def in_inertial_coordinates(name: str) -> Moving:
    return moving(UNLIKE, MOTIONS[name], TIMES)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize("name", MOTIONS)
def test_a_run_moves_as_in_inertial_coordinates(name: str, formulation: Any) -> None:
    """What is reached, 6e-13 of the rates, is what the tolerances of both allow."""
    scene = replace(UNLIKE, motion=MOTIONS[name])
    run = sp.simulate(
        scene,
        tolerance=1e-12,
        method="dop853",
        formulation=formulation,
        times=TIMES,
        record=("state", "multipliers"),
    )
    # The last row is that at the end.
    found = Moving(run.q[:3], run.p[:3], run.multipliers[:3])
    require_close(found, in_inertial_coordinates(name), 1e-11)


def test_the_terms_at_a_state_are_the_published_ones() -> None:
    rng = np.random.default_rng(1)
    for t in rng.uniform(0.0, 0.05, 10):
        q, p = CARRIED.start().q + rng.uniform(-1e-3, 1e-3, 9), rng.uniform(-1.0, 1.0, 9)
        at = CARRIED.motion.at(t)
        frame = np.column_stack(
            [
                (at.position, at.velocity, at.acceleration),
                (at.tilt, at.tilt_rate, at.tilt_acceleration),
            ]
        )
        found = sp.evaluate(CARRIED, t, q, p).forces.gravity
        expected = published(q, p, frame, parameters(CARRIED))
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


def test_the_forces_of_a_tilted_hand_sum_to_its_accelerations() -> None:
    load = sp.Step(time=0.0, force=(3.0, 1.0), moment=0.01)
    scene = replace(UNLIKE, motion=sp.HandMotion.constant((1.0, 2.0), 0.5), disturbances=(load,))
    start = scene.start()
    found = sp.evaluate(scene, 0.0, start.q, start.p)
    pushed = found.constraint_matrix.T @ found.multipliers
    balance = found.mass_matrix @ found.accelerations - found.forces.total - pushed
    assert np.abs(balance).max() < 1e-12
    np.testing.assert_allclose(
        found.forces.external[:2],
        [3 * np.cos(0.5) + np.sin(0.5), np.cos(0.5) - 3 * np.sin(0.5)],
    )


@pytest.mark.parametrize("scene", [UNLIKE, SHOVED], ids=["bilateral", "unilateral"])
@pytest.mark.parametrize("upwards", [4.0, -G])
def test_an_acceleration_upwards_is_another_gravity_to_the_bit(
    scene: sp.Scene, upwards: float
) -> None:
    carried = replace(scene, motion=sp.HandMotion.constant((0.0, upwards)))
    ours = sp.simulate(carried, dt=1e-4)
    theirs = sp.simulate(replace(scene, gravity=G + upwards), dt=1e-4)
    assert ours.status == theirs.status
    np.testing.assert_array_equal(states(ours), states(theirs))
    assert ours.violations == theirs.violations


@pytest.mark.parametrize("method", _core.METHODS)
def test_a_tilt_is_a_constant_acceleration(method: Any) -> None:
    scene = replace(UNLIKE, disturbances=())
    tilt = 0.3
    pushed = sp.HandMotion.constant((G * np.sin(tilt), G * np.cos(tilt) - G))
    ours, theirs = (
        sp.simulate(replace(scene, motion=motion), dt=2e-4, method=method)
        for motion in (sp.HandMotion.constant(tilt=tilt), pushed)
    )
    np.testing.assert_allclose(states(ours), states(theirs), atol=1e-11)


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_driven_fingers_feel_an_acceleration_as_a_force_on_the_object(contact: Any) -> None:
    """Q of the fingers goes into the torque that is needed, not into the motion."""
    scene = replace(
        SHOVED, contact=contact, fingers="driven", disturbances=(), duration=0.08, friction=0.02
    )
    move = sp.HandMotion.trapezoid([0.01, 0.07], [[0.0, 0.0], [0.027, 0.0]], 40.0)
    size = move.at(0.02).acceleration[0] * scene.grasped.mass
    edges = move.breakpoints(0.0, 0.08)
    pulses = [
        sp.Step(time=float(t), force=(float(-size * step), 0.0))
        for t, step in zip(edges, (1.0, -1.0, -1.0, 1.0), strict=True)
    ]
    ours = sp.simulate(replace(scene, motion=move), dt=1e-4, record=("state", "contact"))
    theirs = sp.simulate(replace(scene, disturbances=pulses), dt=1e-4, record=("state", "contact"))
    if contact == "unilateral":
        assert sp.ContactMode.SLIP in {change.after for change in ours.contact_changes}
    np.testing.assert_allclose(ours.t, theirs.t, atol=1e-12)
    np.testing.assert_allclose(states(ours), states(theirs), atol=1e-9)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize(
    "scene",
    [CARRIED, replace(SHOVED, motion=MOTIONS["shaken"])],
    ids=["bilateral", "unilateral"],
)
def test_the_ledger_of_a_moving_hand_closes(scene: sp.Scene, formulation: Any) -> None:
    if scene.contact == "unilateral" and formulation == "nullspace":
        pytest.skip("nullspace is bilateral")
    open_by = []
    for dt in (4e-5, 2e-5):
        run = sp.simulate(scene, dt=dt, formulation=formulation, record=EVERYTHING)
        assert run.status == "completed"
        run.check()
        assert np.abs(run.energy.motion_work).max() > 1e-3 and not run.energy.gravity.any()
        open_by.append(np.abs(run.energy.closure).max())
    assert open_by[1] < 1e-8 * run.energy.exchanged and open_by[0] > 12.0 * open_by[1]


def test_the_ledger_of_a_hand_at_rest_has_no_work_of_a_motion() -> None:
    run = sp.simulate(UNLIKE, dt=1e-4, record=("energy",))
    assert not run.energy.motion_work.any() and run.energy.gravity.any()


def test_runs_in_lanes_have_the_bits_that_they_have_alone() -> None:
    scenes = {
        "turning": {"motion.tilts": sp.Uniform((0.0, 0.0), (0.4, 0.8))},
        "shaken": {"motion.amplitude": sp.Uniform(0.0, 0.4), "motion.frequency": sp.Uniform(2, 9)},
        "translation": {"motion.acceleration": sp.Uniform(20.0, 30.0)},
    }
    for name, vary in scenes.items():
        for scene in (UNLIKE, SHOVED):
            found = sp.monte_carlo(
                replace(scene, motion=MOTIONS[name]), 9, vary=vary, dt=2e-4, progress=False
            )
            assert len(np.unique(found["final_state"][:, 0])) == 9
            for run in (0, 4, 8):
                require_alone(found, run)


def test_a_mirrored_motion_gives_the_mirror_image() -> None:
    data = MOTIONS["turning"].to_dict()
    image = sp.HandMotion.minimum_jerk(
        data["times"], np.multiply(data["points"], [-1, 1]), np.negative(data["tilts"])
    )
    ours = sp.simulate(CARRIED, dt=1e-4)
    theirs = sp.simulate(replace(mirrored(UNLIKE), motion=image), dt=1e-4)
    np.testing.assert_allclose(theirs.q, mirrored_coordinates(ours.q), atol=1e-12)


def test_a_carried_grasp_goes_on_where_it_stopped() -> None:
    whole = sp.simulate(CARRIED, dt=1e-4)
    middle = whole.state(300)
    rest = sp.simulate(replace(CARRIED, initial=middle, duration=0.06 - middle.time), dt=1e-4)
    np.testing.assert_array_equal(states(rest)[-1], states(whole)[-1])
    sim = sp.Simulator(replace(CARRIED, disturbances=()), period=0.01, dt=1e-4)
    steps = [sim.step(CARRIED.schedule.angles[0]) for _ in range(4)]
    one = replace(CARRIED, disturbances=(), duration=0.04)
    one = replace(one, schedule=sp.Schedule.steps([0.0], CARRIED.schedule.angles[:1]))
    # Each period has polynomials about its own start.
    np.testing.assert_allclose(steps[-1].q, sp.simulate(one, dt=1e-4).q[-1], rtol=0, atol=1e-14)


def test_impulses_act_along_fixed_axes() -> None:
    tilt = 0.5
    kick = np.array([0.02, -0.01])
    turn = np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
    scene = replace(UNLIKE, gravity=0.0, duration=0.03)
    ours, theirs = (
        sp.simulate(
            replace(scene, disturbances=[sp.Impulse(time=0.01, impulse=impulse)], motion=motion),
            dt=1e-4,
        )
        for impulse, motion in ((kick, sp.HandMotion.constant(tilt=tilt)), (turn @ kick, None))
    )
    np.testing.assert_allclose(states(ours), states(theirs), atol=1e-12)


def test_a_run_knows_where_the_hand_is() -> None:
    run = sp.simulate(CARRIED, dt=1e-3)
    np.testing.assert_array_equal(run.hand.tilt, CARRIED.motion.at(run.t).tilt)
    both = np.stack([run.q[:, :2], run.q[:, :2] + [0.0, 0.01]], axis=1)
    world = run.world(both)
    assert world.shape == both.shape
    across = world[:, 1] - world[:, 0]
    expected = 0.01 * np.stack([-np.sin(run.hand.tilt), np.cos(run.hand.tilt)], axis=1)
    np.testing.assert_allclose(across, expected, atol=1e-15)
    np.testing.assert_array_equal(run.world(run.q[:, :2]), world[:, 0])
    at_rest = sp.simulate(UNLIKE, dt=1e-3)
    np.testing.assert_array_equal(at_rest.world(at_rest.q[:, :2]), at_rest.q[:, :2])
    with pytest.raises(ValueError, match=r"points: has shape \(2,\), must be"):
        run.world([0.0, 1.0])


def test_scenes_with_a_motion_are_files_and_have_paths() -> None:
    assert sp.Scene.from_toml(CARRIED.to_toml()) == CARRIED
    assert CARRIED.vary_paths()["motion.points"][1] == "m"
    moved = CARRIED.with_({"motion.tilts.1": 1.0})
    assert moved.motion.to_dict()["tilts"][1] == 1.0
    with pytest.raises(TypeError, match=r"Scene\.motion = 1: must be a HandMotion, such as"):
        sp.Scene(motion=1)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("method", "formulation", "dt"),
    [
        ("rk4", "csm", 1e-4),
        ("dop853", "nullspace", 1e-3),
        ("implicit_midpoint", "csm", 2e-4),
        ("radau5", "nullspace", 1e-3),
        ("rosenbrock", "projected", 2e-4),
    ],
)
def test_derivatives_are_differences_of_runs(method: Any, formulation: Any, dt: float) -> None:
    options: dict[str, Any] = {"method": method, "formulation": formulation, "dt": dt}
    paths = ("grasped.mass", "gravity", "hand.left.inertia", "hand.right.root_offset")
    run = sp.simulate(CARRIED, **options, sensitivities=paths)
    for path in paths:
        value = CARRIED.with_({}).to_dict()
        for name in path.split("."):
            value = value[name]
        step = 1e-4 * float(value)
        after, before = (
            states(sp.simulate(CARRIED.with_({path: value + by}), **options))
            for by in (step, -step)
        )
        expected = (after - before) / (2.0 * step)
        found = run.sensitivity[path]
        error = np.abs(found[:, :18] - expected[:, :18]).max()
        assert error <= 1e-6 * np.abs(expected).max(), path


REFERRED = {
    **MOTIONS,
    "sine": sp.HandMotion.sine(0.002, 12.0, 0.4, phase=0.3, tilt=0.2),
    "swing": sp.HandMotion.sine(0.2, 6.0, "tilt"),
    "trapezoid": sp.HandMotion.trapezoid([0.01, 0.05], [[0, 0], [0.004, 0.002]], 20.0, 0.1),
}


@pytest.mark.parametrize("name", REFERRED)
def test_the_reference_agrees_with_runs(name: str) -> None:
    """SciPy integrates the null-space form with the forces of docs/moving-hand.md."""
    loads = (
        sp.Impulse(time=0.03, impulse=(0.004, 0.002)),
        sp.Step(force=(1.0, 0.5), time=0.02),
        sp.Sine(force=(0.3, 0.1), frequency_hz=40.0),
    )
    scene = replace(UNLIKE, motion=REFERRED[name], disturbances=loads)
    times = np.linspace(0.0, scene.duration, 7)[1:]
    found = sp.reference.confirmed(scene, times)
    assert found.own_error is not None and max(found.own_error.values()) < 1e-11
    run = sp.simulate(
        scene,
        times=times,
        tolerance=1e-12,
        method="dop853",
        formulation="nullspace",
        record=("state", "multipliers"),
    )
    rows = np.isin(run.t, times)
    for own in ("q", "p", "multipliers"):
        error = np.abs(getattr(run, own)[rows] - getattr(found, own)) / found.scales[own]
        assert error.max() < 1e-11, own


VARIED = {
    "minimum_jerk": (
        sp.HandMotion.minimum_jerk([0.0, 0.04], [[0.0, 0.0], [0.02, 0.01]], [0.1, 0.4]),
        ("motion.points.1.0", "motion.points.0.1", "motion.tilts.1", "motion.times.1"),
    ),
    "sine": (
        sp.HandMotion.sine(0.002, 12.0, 0.4, phase=0.3, tilt=0.2),
        ("motion.amplitude", "motion.frequency", "motion.axis", "motion.phase", "motion.tilt"),
    ),
    "swing": (sp.HandMotion.sine(0.2, 6.0, "tilt"), ("motion.amplitude", "motion.frequency")),
    "constant": (
        sp.HandMotion.constant((2.0, -1.0), 0.3),
        ("motion.acceleration.0", "motion.acceleration.1", "motion.tilt"),
    ),
    "sampled": (
        sp.HandMotion.sampled([0.0, 0.02, 0.05], [[0.0, 0.0], [0.004, 0.001], [0.008, 0.0]]),
        ("motion.positions.1.0", "motion.times.1"),
    ),
    "jerk_limited": (
        sp.HandMotion.jerk_limited([0.0, 0.05], [[0.0, 0.0], [0.008, 0.0]], 20.0, 3000.0),
        ("motion.points.1.0", "motion.acceleration"),
    ),
}


@pytest.mark.parametrize("name", VARIED)
def test_derivatives_by_the_numbers_of_a_motion_are_differences_of_runs(name: str) -> None:
    motion, paths = VARIED[name]
    kick = sp.Impulse(time=0.03, impulse=(0.004, 0.002))
    shaking = sp.Noise(acceleration_std=2.0, rate_hz=200.0)
    scene = replace(UNLIKE, motion=motion, disturbances=(kick, shaking), duration=0.06)
    paths = (*paths, "disturbances.0.impulse.0", "disturbances.0.time")
    paths = (*paths, "disturbances.1.acceleration_std")
    options: dict[str, Any] = {"dt": 5e-5, "formulation": "nullspace"}
    run = sp.simulate(scene, **options, sensitivities=paths)
    for path in paths:
        value, _ = scene.vary_paths()[path]
        step = 1e-4 * max(abs(value), 1e-2)
        after, before = (
            states(sp.simulate(scene.with_({path: value + by}), **options, every=10_000))[-1]
            for by in (step, -step)
        )
        expected = (after - before) / (2.0 * step)
        error = np.abs(run.sensitivity[path][-1, :18] - expected[:18]).max()
        assert error <= 1e-5 * np.abs(expected).max(), path


def test_a_linear_model_is_the_derivative_of_the_rates_while_the_hand_turns() -> None:
    state = sp.simulate(CARRIED, dt=1e-4, formulation="nullspace").state(300)
    model = sp.linearize(CARRIED, state)
    assert CARRIED.motion.at(state.time).tilt_rate

    def rates(part: str, k: int, by: float) -> NDArray[np.float64]:
        q, p = state.q.copy(), state.p.copy()
        {"q": q, "p": p}[part][k] += by
        moved = sp.State(q, p, integral=state.integral, time=state.time)
        return sp.linearize(CARRIED, moved).state_rates

    columns = [("q", k, 1e-6) for k in range(5)] + [("p", k, 1e-4) for k in range(5)]
    for column, (part, k, step) in enumerate(columns):
        found = (rates(part, k, step) - rates(part, k, -step)) / (2.0 * step)
        expected = model.A[:, column]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())


def rise(direction: tuple[float, float], **options: Any) -> float:
    """How far 50 moves of 0.1 s back and forth lift the object, m; no tip slips."""
    held = sp.Scene(
        contact="unilateral",
        friction=0.5,
        hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
        schedule=sp.Schedule.in_degrees("steps", [0.0], [[8.0, 8.0]]),
        duration=3.0,
    )
    settled = sp.simulate(held, dt=1e-3, method="rosenbrock").state(-1)
    times = 3.0 + 0.1 * np.arange(101)
    points = np.zeros((101, 2))
    points[1::2] = direction
    motion = sp.HandMotion.minimum_jerk(times, points)
    moved = held.with_({"initial": settled, "duration": 11.0, "motion": motion})
    run = sp.simulate(moved, **options, times=[13.9], record=("state", "contact"))
    assert run.status == "completed" and not run.contact_changes
    return float(run.q[0, 1] - settled.q[1])


def test_a_grasp_does_not_creep() -> None:
    """What fast oblique moves lift it by is the no-slip constraint's, and no error of the steps."""
    assert abs(rise((0.0, 0.05), dt=1e-3, method="rosenbrock")) < 1e-9
    lifted = rise((0.1, 0.05), dt=1e-3, method="rosenbrock")
    assert lifted > 1e-6
    others: list[dict[str, Any]] = [
        {"dt": 5e-4, "method": "rosenbrock"},
        {"dt": 1e-3, "method": "radau5"},
        {"dt": 1e-3, "method": "radau5", "formulation": "projected"},
    ]
    for options in others:
        assert rise((0.1, 0.05), **options) == pytest.approx(lifted, rel=1e-3)


def test_a_computation_without_motions_says_so() -> None:
    with pytest.raises(ValueError, match=r"Scene\.motion: turns at t = 0\.03 s"):
        sp.equilibrium(CARRIED, time=0.03)
