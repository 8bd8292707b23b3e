"""`loop`: beside linear loops that are followed instant by instant, and beside runs."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

import softpinch as sp
from sampled_blocks import SAME, Block
from softpinch.analysis.loops import _model

EYE, SWAY = np.eye(2), np.array([[1.0], [-1.0]])
TARGETS = sp.Schedule.steps([0.0], [[0.1, 0.1]])
SERVO = sp.SampledController.pid(1e-3, 20.0, 0.2, 100.0, delay=0.4e-3, first_sample=0.3e-3)


def camera(ki: float, kp: float = 0.0, **changes: Any) -> sp.SampledController:
    """Moves the targets of the fingers in opposite directions against the object's rotation."""
    period = changes.get("period", 1 / 30)
    how = {"period": period, "measure_delay": 0.03, "measures": ("rotation", "target")} | changes
    matrices = [[1.0]], [[period, 0.0, 0.0]], ki * SWAY, np.hstack([kp * SWAY, EYE])
    return sp.SampledController(**dict(zip("ABCD", matrices, strict=True)), **how)


def scene_of(*blocks: sp.SampledController, **changes: Any) -> sp.Scene:
    control = sp.SampledController.cascade(blocks)
    return sp.Scene(control=control, **{"schedule": TARGETS} | changes)


def by_steps(scene: sp.Scene, found: sp.Loop, periods: int) -> float:
    """The growth in a period, from a random start, of the linear motion with blocks beside it."""
    model, end = _model(scene, sp.equilibrium(scene)), periods * found.period
    parts = [one for _, one in scene.control.blocks()]  # type: ignore[union-attr]
    calm = [replace(one, outer=None, initial_torque=(0.0, 0.0), limits=None) for one in parts]
    blocks = [Block(one, k, end) for k, one in enumerate(calm)][::-1]
    ends = found.period * np.arange(periods + 1)
    whole = np.sort(np.hstack([ends, *[[*b.taken, *b.used, *b.acting] for b in blocks]]))
    whole = whole[(np.diff(whole, prepend=-1.0) > SAME) & (whole <= end)]
    x = np.random.default_rng(0).normal(size=len(model.A))
    inside = []
    generator = np.zeros((len(x) + 2, len(x) + 2))
    generator[: len(x)] = np.hstack([model.A, model.B])

    @cache
    def transition(femtoseconds: int) -> NDArray[np.float64]:
        """The intervals of one period come again in the next, but for round-off."""
        return np.array(expm(generator * (1e-15 * femtoseconds)))[: len(x)]

    for t, until in zip(whole, [*whole[1:], end], strict=True):
        if np.abs(ends - t).min() < SAME:
            inside.append(np.hstack([x, *[n for b in blocks for n in (b.xi, b.force)]]))
        y = model.C @ x + model.D @ blocks[-1].force
        q, p, target = y[:5], y[15:20], np.zeros(2)
        for block in blocks:
            block.at(t, q, p, target, np.zeros(2))
            target = block.force
        x = transition(round(1e15 * (until - t))) @ np.hstack([x, target])
    # In the end a few modes are left: s_k = a_1 s_(k-1) + ... + a_6 s_(k-6).
    late = inside[len(inside) // 3 :]
    rows = [[s / np.linalg.norm(late[k]) for s in late[k : k + 7]] for k in range(len(late) - 6)]
    sequence = np.array(rows).transpose(0, 2, 1).reshape(-1, 7)
    recurrence = np.linalg.lstsq(sequence[:, 5::-1], sequence[:, 6], rcond=None)[0]
    return float(np.abs(np.roots([1.0, *-recurrence])).max())


LOOPS = {
    "one block": scene_of(replace(SERVO, delay=3.1e-3)),
    "unstable": scene_of(replace(SERVO, delay=8.3e-3)),
    "camera": scene_of(camera(33.0), SERVO),
    "equal instants": scene_of(
        camera(25.0, 0.4, period=0.03, delay=0.03), replace(SERVO, first_sample=0.0, delay=0.0)
    ),
    "three blocks": scene_of(
        camera(20.0, period=0.03, first_sample=0.011),
        sp.SampledController(0.01, D=0.9 * EYE, measures=("target",), delay=0.013),
        SERVO,
    ),
}


@pytest.mark.parametrize("name", LOOPS)
def test_the_radius_is_the_growth_of_the_linear_loop(name: str) -> None:
    scene = LOOPS[name]
    found = sp.loop(scene)
    grows = by_steps(scene, found, 400 if found.period < 2e-3 else 60)
    assert grows == pytest.approx(found.spectral_radius, abs=1e-5)


def test_of_two_sets_of_gains_those_count_that_act() -> None:
    second = sp.SampledController.pid(1e-3, 30.0, 0.2, 50.0)
    late = sp.GainSwitch(C=second.C, D=second.D, at=0.5)
    sets = [SERVO, replace(SERVO, C=second.C, D=second.D)]
    first, other = (sp.loop(scene_of(camera(20.0), one)) for one in sets)
    assert abs(first.spectral_radius - other.spectral_radius) > 1e-3
    for duration, expected in ((0.4, first), (1.0, other)):
        switched = scene_of(camera(20.0), replace(SERVO, switch=late), duration=duration)
        assert sp.loop(switched) == expected
        rest = sp.equilibrium(switched)
        assert rest.state is not None
        stays = sp.simulate(replace(switched, initial=rest.state, duration=0.2))
        assert stays.success
        if duration == 1.0:
            assert np.abs(stays.q - rest.state.q).max() < 1e-9
    by_measure = replace(SERVO, switch=replace(late, at=None, measure="angle_rate", above=1.0))
    scene = scene_of(camera(20.0), by_measure)
    for function in (sp.loop, sp.equilibrium):
        with pytest.raises(ValueError, match=r"GainSwitch\.measure = 'angle_rate': decides"):
            function(scene)
    for time, expected in ((-np.inf, first), (np.inf, other)):
        assert sp.loop(replace(scene, control=scene.control.gains_at(time))) == expected  # type: ignore[union-attr]


def test_margins_are_where_the_loop_becomes_unstable() -> None:
    for scene, block in ((LOOPS["one block"], 0), (scene_of(camera(20.0, 0.3), SERVO), 0)):
        found = sp.loop(scene, block=block)
        rest = sp.equilibrium(scene)  # louder targets would move it
        parts = [replace(one, outer=None) for _, one in scene.control.blocks()][::-1]  # type: ignore[union-attr]
        own = parts[block]
        for share, holds in ((0.999, True), (1.001, False)):
            louder = {n: share * found.gain_margin * np.asarray(getattr(own, n)) for n in "CD"}
            later = {"delay": own.delay + share * found.delay_margin}
            for change in (louder, later):
                parts[block] = replace(own, **change)
                control = sp.SampledController.cascade(parts)
                changed = sp.loop(replace(scene, control=control), rest)
                assert (changed.spectral_radius < 1.0) == holds
    unstable = sp.loop(LOOPS["unstable"])
    assert unstable.spectral_radius > 1.001
    assert np.isnan([unstable.gain_margin, unstable.delay_margin]).all()
    weak = sp.loop(scene_of(replace(SERVO, period=1e-4, delay=0.0)))
    assert weak.delay_margin == np.inf  # it is longer than 20 periods


def test_runs_grow_beyond_the_gain_that_is_predicted_and_settle_below() -> None:
    limit = 20.0 * sp.loop(scene_of(camera(20.0), SERVO), block=0).gain_margin
    rest = sp.equilibrium(sp.Scene(control=sp.Pid(kp=20.0, kd=0.2, ki=100.0), schedule=TARGETS))
    assert rest.state is not None
    begin = rest.torque / 100.0
    for share in (0.97, 1.03):
        servo = replace(SERVO, initial_torque=rest.torque, initial_state=-begin)
        eye = replace(camera(share * limit), initial_torque=(0.1, 0.1))
        push = sp.Impulse(time=0.05, impulse=(0.0, 0.0), angular_impulse=1e-6)
        start = replace(rest.state, time=0.0)
        scene = scene_of(eye, servo, initial=start, disturbances=[push], duration=6.0)
        run = sp.simulate(scene, 1e-3, every=5)
        assert run.success
        first, last = (np.abs(run.q[(run.t > t) & (run.t < t + 1.0), 2]).max() for t in (2.0, 5.0))
        expected = sp.loop(scene).spectral_radius
        assert (expected > 1.0) == (share > 1.0)
        assert (last / first) ** (1 / 30) == pytest.approx(expected, rel=2e-3)


def test_states_and_refusals() -> None:
    scene = LOOPS["camera"]
    one = sp.loop(scene)
    rest = sp.equilibrium(replace(scene, control=sp.Pid()))
    again = sp.loop(scene, rest).spectral_radius
    assert again == pytest.approx(one.spectral_radius, rel=1e-12)
    assert rest.state is not None
    begun = replace(
        scene,
        control=sp.SampledController.cascade(
            [
                replace(camera(33.0), initial_torque=(0.1, 0.1)),
                replace(SERVO, initial_torque=rest.torque, initial_state=-rest.torque / 100.0),
            ]
        ),
        initial=replace(rest.state, time=0.0),
        duration=0.05,
    )
    state = sp.simulate(begun, 1e-4).state(0)
    assert sp.loop(scene, state).spectral_radius == pytest.approx(one.spectral_radius, rel=1e-6)
    fast = replace(state, p=np.where(np.arange(9) == 5, -0.02, 0.0))
    for call, named in (
        (
            lambda: sp.loop(scene, fast),
            r"state\.p\[5\] = -0\.02 m/s: must have settled, .* 0\.001 m/s",
        ),
        (lambda: sp.loop(sp.Scene()), r"control=Pid.*loop needs a SampledController"),
        (lambda: sp.loop(scene, block=2), r"block = 2: must be at most 1"),
        (lambda: sp.loop(scene, rest.state), r"state\.controller = None: must have the torques"),
        (lambda: sp.loop(scene_of(camera(1.0, period=np.pi / 100), SERVO)), "common period"),
        (lambda: sp.loop(scene_of(camera(1.0, measure_delay=9.0), SERVO)), "at most 50 periods"),
    ):
        with pytest.raises(ValueError, match=named):
            call()
