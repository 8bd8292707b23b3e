"""Which steps a scene allows: predicted from eigenvalues, and measured."""

import os
import re
import signal
import threading
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import softpinch as sp
from random_pinches import open_share, random_pinch
from softpinch import strategies

EXPLICIT = ("rk4", "dop853")
FORMULATIONS = ("csm", "nullspace", "projected")
STRONG = sp.Stabilization(alpha=2e4, beta=2e4)


def held(angles: tuple[float, float] = (6.0, 4.8), **fields: object) -> sp.Scene:
    schedule = sp.Schedule.steps([0.0], np.deg2rad([angles]))
    return sp.Scene(schedule=schedule, **{"duration": 4.0, **fields})


def settled(scene: sp.Scene) -> sp.Scene:
    """The same, at rest: from where it has held one angle for seconds."""
    run = sp.simulate(scene, tolerance=1e-9, method="radau5", formulation="nullspace")
    assert run.success, run.message
    last = run.state(-1)
    return replace(scene, initial=sp.State(last.q, last.p, last.integral), duration=0.5)


AT_REST = {
    "paper": held(),
    "overdamped": held(
        hand=sp.Hand(tip=sp.Fingertip(normal_viscosity=1e3, tangential_viscosity=2e3))
    ),
    "uneven": held(
        hand=sp.Hand(
            left=sp.Finger(length=0.07, mass=0.15),
            tip=(sp.Fingertip(youngs_modulus=4e5), sp.Fingertip(tilt_coupling=-1.0)),
        ),
        control=(sp.Pid(kp=90.0), sp.Pid(kd=1.4, ki=600.0)),
        initial="touching",
    ),
}


@cache
def rest(name: str) -> sp.Scene:
    return settled(AT_REST[name])


@pytest.mark.parametrize("method", EXPLICIT)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", AT_REST)
def test_prediction_and_measurement_agree_at_rest(name: str, formulation: str, method: str) -> None:
    found = sp.max_stable_dt(rest(name), method, formulation)
    assert found.measured == pytest.approx(found.predicted, rel=0.1), found.message
    assert found.dt == min(found.predicted, found.measured)
    assert "they part" not in found.message


@pytest.mark.parametrize("method", EXPLICIT)
@pytest.mark.parametrize("name", ["paper", "uneven"])
def test_strong_stabilisation_is_what_limits_csm(name: str, method: str) -> None:
    found = sp.max_stable_dt(rest(name), method, "csm", stabilization=STRONG)
    assert found.measured == pytest.approx(found.predicted, rel=0.1), found.message
    limit = {"rk4": 2.785, "dop853": 6.39}[method]
    assert found.predicted == pytest.approx(limit / STRONG.alpha, rel=0.02)
    assert found.rate == pytest.approx(-STRONG.alpha, rel=0.02)
    free = sp.max_stable_dt(rest(name), method, "nullspace", stabilization=STRONG, measure=False)
    assert free.predicted > 5.0 * found.predicted and free.measured is None


FINGER = sp.Finger(length=0.062115446459495544)


@settings(max_examples=15)
# The core's QR iteration ends without the eigenvalues of this one.
@example(sp.Hand(right=FINGER, left=FINGER), "csm", "rk4")
@given(strategies.hands(spread=0.15), st.sampled_from(FORMULATIONS), st.sampled_from(EXPLICIT))
def test_they_agree_for_any_hand_at_rest(hand: sp.Hand, formulation: str, method: str) -> None:
    scene = held(hand=hand, initial="touching")
    try:
        angles = scene.start().q[3:5]
    except ValueError:
        assume(False)
    assume(np.abs(angles).max() < 0.7)
    schedule = sp.Schedule.steps([0.0], [angles + np.deg2rad([5.0, 4.0])])
    scene = replace(scene, schedule=schedule)
    run = sp.simulate(scene, tolerance=1e-6, method="radau5", formulation="nullspace")
    assume(run.success)
    found = sp.max_stable_dt(settled(scene), method, formulation)
    assert found.measured == pytest.approx(found.predicted, rel=0.1), found.message


def moving() -> tuple[sp.Scene, sp.State]:
    """A state with every coordinate and every rate in play."""
    scene = AT_REST["uneven"]
    state = sp.State.consistent(
        scene, fingers=(0.12, 0.1), rotation=0.05, shear=(3e-4, -2e-4), velocity=(0.1, -0.2, 1.0),
        finger_rates=(0.5, -0.3), integral=(1e-3, -2e-3),
    )  # fmt: skip
    return scene, state


def differenced(rate: object, y: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The Jacobian of `rate` by central differences of fourth order."""
    columns = []
    for k, size in enumerate(sizes):
        step = np.zeros_like(y)
        step[k] = 1e-4 * size
        near, far = rate(y + step) - rate(y - step), rate(y + 2 * step) - rate(y - 2 * step)
        columns.append((8.0 * near - far) / (12e-4 * size))
    return np.column_stack(columns)


def assert_same_rates(found: np.ndarray, expected: np.ndarray, rel: float) -> None:
    """Every eigenvalue has a partner of its own."""
    left = list(expected)
    for rate in found:
        nearest = int(np.argmin([abs(rate - other) for other in left]))
        assert abs(rate - left.pop(nearest)) <= rel * np.abs(expected).max(), (rate, expected)


PLACES = np.array([0.02, 0.02, 1.0, 1.0, 1.0, 0.02, 0.02, 0.02, 0.02])


def test_csms_eigenvalues_are_those_of_differenced_accelerations() -> None:
    scene, state = moving()
    gains = sp.Stabilization(alpha=700.0, beta=900.0)
    target = scene.schedule.target(0.0)

    def rate(y: np.ndarray) -> np.ndarray:
        q, p, integral = y[:9], y[9:18], y[18:]
        found = sp.evaluate(scene, 0.0, q, p, integral, formulation="csm", stabilization=gains)
        return np.concatenate([p, found.accelerations, q[3:5] - target])

    y = np.concatenate([state.q, state.p, state.integral])
    sizes = np.concatenate([PLACES, 30.0 * PLACES, [0.1, 0.1]])
    modes = sp.modes(scene, [0.0], [state.q], [state.p], [state.integral],
                     formulation="csm", stabilization=gains)  # fmt: skip
    jacobian = differenced(rate, y, sizes)
    scaled = (modes.jacobian[0] - jacobian) * sizes / sizes[:, None]
    assert np.abs(scaled).max() <= 1e-6 * np.abs(jacobian * sizes / sizes[:, None]).max()
    assert modes.states[9:11] == ("rate of x", "rate of y") and modes.states[-1] == "integral_2"
    assert_same_rates(modes.rates[0], np.linalg.eigvals(jacobian), 1e-4)


def test_the_nullspaces_eigenvalues_are_those_of_its_own_coordinates() -> None:
    scene, state = moving()
    target = scene.schedule.target(0.0)

    def rate(y: np.ndarray) -> np.ndarray:
        pose, speed, shear, integral = y[:5], y[5:10], y[10:12], y[12:]
        on = sp.State.consistent(
            scene, x=pose[0], y=pose[1], rotation=pose[2], fingers=pose[3:], shear=shear,
            velocity=speed[:3], finger_rates=speed[3:],
        )  # fmt: skip
        found = sp.evaluate(scene, 0.0, on.q, on.p, integral, formulation="nullspace")
        return np.concatenate([speed, found.accelerations[:5], on.p[7:], pose[3:] - target])

    y = np.concatenate([state.q[:5], state.p[:5], state.q[7:], state.integral])
    sizes = np.concatenate([PLACES[:5], 30.0 * PLACES[:5], [0.02, 0.02, 0.1, 0.1]])
    modes = sp.modes(scene, [0.0], [state.q], [state.p], [state.integral])
    expected = np.linalg.eigvals(differenced(rate, y, sizes))
    assert modes.rates.shape == (1, 14)
    assert_same_rates(modes.rates[0], expected, 1e-4)


def test_without_viscosity_the_edge_of_the_imaginary_axis_counts() -> None:
    # Where it comes to rest does not depend on what damps it.
    damped = settled(held((6.0, 6.0), control=sp.Pid(ki=0.0), gravity=0.0))
    tip = sp.Fingertip(normal_viscosity=0.0, tangential_viscosity=0.0)
    scene = replace(damped, hand=sp.Hand(tip=tip), control=sp.Pid(kd=0.0, ki=0.0))
    state = replace(scene.start(), p=np.zeros(9))
    modes = sp.modes(scene, [0.0], [state.q], [state.p], [state.integral])
    fastest = np.abs(modes.rates[0].imag).max()
    assert np.abs(modes.rates[0].real).max() < 1e-6 * fastest
    # On the imaginary axis RK4 is stable up to 2 sqrt 2.
    assert modes.stable_step("rk4")[0] == pytest.approx(2.0 * np.sqrt(2.0) / fastest, rel=1e-6)
    for method in EXPLICIT:
        found = sp.max_stable_dt(replace(scene, initial=state), method, "nullspace")
        assert found.measured == pytest.approx(found.predicted, rel=0.1), found.message


@pytest.mark.parametrize(
    ("rates", "limit"),
    [
        # Growth of the motion's own limits nothing.
        ([5.0, -2.0], 2.785 / 2.0),
        ([5.0 + 20.0j, 0.0], np.inf),
        # What swings counts as swinging, on whichever side of the axis round-off has put it.
        ([5e-14 + 430.0j, -1e-14 + 390.0j], 2.0 * np.sqrt(2.0) / 430.0),
        ([-5e-14 + 430.0j, 1e-14 + 390.0j], 2.0 * np.sqrt(2.0) / 430.0),
        # What overflowed allows no step, and is no NaN.
        ([complex(np.nan, np.nan), -2.0], 0.0),
    ],
)
def test_growing_modes_limit_no_step_but_undamped_do(rates: list[complex], limit: float) -> None:
    some = sp.Modes(
        t=np.zeros(1), jacobian=np.zeros((1, 2, 2)), rates=np.array([rates], complex),
        states=("x", "y"),
    )  # fmt: skip
    assert some.stable_step("rk4") == pytest.approx([limit], rel=1e-3)
    assert some.stable_step("radau5") == (np.inf if limit else 0.0)


def test_a_method_for_stiff_scenes_has_no_predicted_limit() -> None:
    found = sp.max_stable_dt(rest("overdamped"), "radau5", "nullspace")
    assert found.predicted == np.inf
    assert "radau5 is stable for every step" in found.message


def test_too_small_a_limit_of_steps_is_in_the_message() -> None:
    found = sp.max_stable_dt(rest("paper"), "rk4", max_steps=20)
    assert found.measured is None and found.dt == found.predicted
    assert "not measured: even 20 steps are not enough" in found.message


@pytest.mark.parametrize("measure", [True, False])
def test_a_motion_that_takes_too_many_steps_is_no_end_to_be_met(measure: bool) -> None:
    scene = held(disturbances=[sp.Sine(frequency_hz=40.0, force=(3.0, 1.0))], duration=1e4)
    found = sp.max_stable_dt(scene, max_steps=1000, measure=measure)
    assert found.measured is None and 0.0 < found.dt == found.predicted < 1.0
    said = "not measured: the motion is known to t = [0-9.]+ s only, where radau5 with tolerance"
    assert re.search(f"{said} 1e-08 ended as too_many_steps$", found.message)


def test_ctrl_c_ends_a_search_and_is_no_failed_run() -> None:
    scene = held(disturbances=[sp.Sine(frequency_hz=40.0, force=(3.0, 1.0))], duration=1e4)
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        sp.max_stable_dt(scene)
    timer.join()


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_steps_below_the_measured_one_end_alike_and_keep_their_energy(contact: str) -> None:
    rng = np.random.default_rng(3)
    formulation = "nullspace" if contact == "bilateral" else "projected"
    for _ in range(12):
        scene = random_pinch(rng, contact)
        exact = sp.simulate(scene, tolerance=1e-8, method="radau5", formulation=formulation)
        longest = sp.max_stable_dt(scene).measured
        assert longest is not None
        run = sp.simulate(scene, dt=0.9 * longest, record=("energy",))
        assert run.status == exact.status
        assert open_share(run) < 1.0
