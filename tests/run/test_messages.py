"""What a run that failed says: what happened, in words for its own steps, and what to do."""

import math
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch import stress


@pytest.mark.parametrize(
    "how", [{"dt": 1e-4}, {"tolerance": 1e-6, "method": "dop853"}], ids=["dt", "tolerance"]
)
def test_a_failure_after_separation_says_that_the_run_had_gone_on(how: dict[str, Any]) -> None:
    scene = stress.CASES["thrown_out"].scene
    run = sp.simulate(scene, **how, stop_on=(), max_steps=None)
    assert run.status not in ("completed", "separated")
    gone = rf"The run had gone on from t = {run.violations['separated']} s, where it was separated"
    assert gone in run.message and run.message.endswith('with stop_on = "separated" it ends there')
    assert "may help" not in run.message
    # The same words in lanes.
    many = sp.monte_carlo(
        scene, vary={"grasped.mass": np.full(5, 0.1)}, **how, stop_on=(), progress=False
    )
    assert set(many.message) == {run.message}


def test_a_run_with_a_tolerance_is_not_told_of_dt_alone() -> None:
    huge = sp.Scene(hand=sp.Hand(tip=sp.Fingertip(radius=1e200)), duration=0.01)
    for how in ({"dt": 1e-3}, {"tolerance": 1e-6, "method": "radau5"}):
        with pytest.warns(sp.SuspiciousValueWarning):
            run = sp.simulate(huge, **how)  # type: ignore[arg-type]
        assert run.status == "not_finite"
        assert "a smaller dt or tolerance" in run.message


def test_fingers_that_do_not_reach_are_told_at_which_angle_they_touch() -> None:
    """Closing them at the start is not enough: the schedule opens them again."""
    narrow = sp.GraspedObject(width=0.02)
    with pytest.raises(
        ValueError, match=r"It touches at ([\d.]+) degrees: .*opens again"
    ) as caught:
        sp.simulate(sp.Scene(grasped=narrow))
    degrees = float(str(caught.value).partition("touches at ")[2].split()[0])
    start = sp.Scene(grasped=narrow, initial="touching").start()
    assert degrees == pytest.approx(math.degrees(start.q[3]), rel=1e-5)
    assert 'initial = "touching" starts there' in str(caught.value)
    for share, status in ((0.5, "separated"), (1.3, "completed")):
        angle = share * math.radians(degrees)
        schedule = sp.Schedule.steps([0.0], [[angle, angle]])
        run = sp.simulate(sp.Scene(grasped=narrow, initial="touching", schedule=schedule))
        assert run.status == status
    assert run.success
    with pytest.raises(ValueError, match="It touches at") as caught:
        sp.simulate(sp.Scene(grasped=narrow, fingers="driven"))
    assert "initial" not in str(caught.value)


def test_a_grasp_that_is_opened_is_told_to_close_further() -> None:
    opened = sp.Schedule.steps([0.0], [[-0.2, -0.2]])
    run = sp.simulate(sp.Scene(schedule=opened))
    assert run.status == "separated"
    assert "angles that close the fingers further" in run.message
