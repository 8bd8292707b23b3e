"""Messages of failed runs: the cause, in words for the kind of steps, and a remedy."""

import math
import re
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch import stress
from softpinch.scene.outline import contacts
from unilateral_scenes import gripped, thrown


@pytest.mark.parametrize(
    "how", [{"dt": 1e-4}, {"tolerance": 1e-6, "method": "dop853"}], ids=["dt", "tolerance"]
)
def test_a_failure_after_separation_says_that_the_run_had_gone_on(how: dict[str, Any]) -> None:
    scene = stress.CASES["thrown_out"].scene
    run = sp.simulate(scene, **how, stop_on=(), max_steps=None)
    assert run.status not in ("completed", "separated")
    since = f"{run.violations['separated']:.6g} s"
    gone = f"The run had gone on from t = {since}, where it was separated"
    assert gone in run.message and run.message.endswith('with stop_on = "separated" it ends there')
    assert "may help" not in run.message
    # The same words in lanes.
    many = sp.monte_carlo(
        scene, vary={"grasped.mass": np.full(5, 0.1)}, **how, stop_on=(), progress=False
    )
    assert set(many.message) == {run.message}


def test_fingers_that_do_not_reach_are_told_at_which_angle_they_touch() -> None:
    """Closing them at the start is not enough: the schedule opens them again."""
    narrow = sp.GraspedObject(width=0.02)
    with pytest.raises(
        ValueError, match=r"It touches at ([\d.]+) degrees: .*separate it again"
    ) as caught:
        sp.simulate(sp.Scene(grasped=narrow))
    degrees = float(str(caught.value).partition("touches at ")[2].split()[0])
    start = sp.Scene(grasped=narrow, initial="touching").start()
    assert degrees == pytest.approx(math.degrees(start.q[3]), rel=1e-5)
    assert 'initial = "touching" starts the run there' in str(caught.value)
    for share, status in ((0.5, "separated"), (1.3, "completed")):
        angle = share * math.radians(degrees)
        schedule = sp.Schedule.steps([0.0], [[angle, angle]])
        run = sp.simulate(sp.Scene(grasped=narrow, initial="touching", schedule=schedule))
        assert run.status == status
    assert run.success
    with pytest.raises(ValueError, match="It touches at") as caught:
        sp.simulate(sp.Scene(grasped=narrow, fingers="driven"))
    assert "initial" not in str(caught.value)


def _opened() -> sp.Scene:
    """Both tips let go, and the object falls past them."""
    opened = sp.Schedule.steps([0.0], [[-0.2, -0.2]])
    return gripped(schedule=opened, duration=0.3)


def _dropped() -> sp.Scene:
    """The right tip is under a tilted object that falls, and not outside of its face."""
    start = gripped().start()
    q = np.add(start.q, [0.0, 0.03, 0.2, 0.1, -0.1, 0.0, 0.0, 0.0, 0.0])
    free = sp.State(q, start.p, contact=(0.0, 0.0, 0.0, 0.0), check=False)
    return gripped(initial=free, grasped=sp.GraspedObject(height=0.05), duration=0.1)


@pytest.mark.parametrize(
    ("scene", "cause"),
    [
        (thrown(), r"the contact of the (\w+) tip, which \w+, left its face"),
        (_opened(), "both tips are free, and neither is beside its face any longer"),
        (_dropped(), r"the (\w+) tip, which is free, met the end of the face"),
    ],
)
def test_a_lost_object_is_told_how(scene: sp.Scene, cause: str) -> None:
    run = sp.simulate(scene, record=("state", "residuals"))
    assert run.status == "lost"
    lost = rf"the object was lost at t = (\S+) s: {cause} \((.*)\); more friction"
    said = re.match(lost, run.message)
    assert said, run.message
    time, *finger, measured = said.groups()
    assert time == f"{run.t[-1]:.6g}"
    now, start = (
        np.abs(contacts(run.scene, np.asarray(run.state(k).q)[None]).places)[0] for k in (-1, 0)
    )
    half = 0.5 * scene.grasped.height  # type: ignore[operator]
    if finger:
        side = ["right", "left"].index(finger[0])
        expected = [now[side], start[side], half]
    else:
        expected = [*now, half]
    found = [float(number) for number in re.findall(r"(\S+) m\b", measured)]
    if finger:
        # C^N (12) is the velocity of the slip.
        slipped = np.trapezoid(run.residuals[:, 2 + side], run.t)
        assert found.pop(2) == pytest.approx(abs(slipped), rel=0.05, abs=1e-5)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_a_crushed_tip_is_told_what_would_keep_it_whole() -> None:
    run = sp.simulate(stress.CASES["crushed"].scene)
    assert run.status == "crushed"
    assert "a stiffer or larger tip" in run.message
