"""Unilateral contact against Siconos: Moreau-Jean's time stepping converges to our event by event.

What is independent there: no events, no modes, no event location; the contacts and impacts of a
step are one nonsmooth problem that Siconos solves. Skipped where Siconos is not installed.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from oracle import moreau_jean

pytestmark = pytest.mark.skipif(moreau_jean.interpreter() is None, reason=moreau_jean.MISSING)

LIGHT = sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01))


def grasp(friction: float | tuple[float, float], duration: float, **changes: Any) -> sp.Scene:
    usual: dict[str, Any] = {
        "hand": LIGHT,
        "schedule": sp.Schedule.steps([0.0], np.deg2rad([[6, 6]])),
    }
    return sp.Scene(
        contact="unilateral", friction=friction, duration=duration, **{**usual, **changes}
    )


def dropped() -> sp.Scene:
    """Both tips off the object and on their way to it, one slower and with more to go."""
    scene = grasp((0.3, 0.4), 0.06)
    start = sp.State.consistent(scene, fingers=np.deg2rad([-0.6, -0.8]))
    q, p = start.q.copy(), np.zeros(9)
    q[5:7] = 0.0
    p[3:5] = 1.0, 1.5
    return replace(scene, initial=sp.State(q, p))


def jaws() -> sp.Scene:
    """A cube at rest between jaws, pushed down until both tips slip."""
    jaw = sp.Jaw(root_offset=0.1, half_thickness=0.01, mass=0.1, height=0.0)
    scene = grasp(
        0.5,
        0.06,
        hand=sp.Hand(right=jaw, left=jaw, tip=LIGHT.tip),
        grasped=sp.GraspedObject.box(0.049, 0.049, 0.1),
        control=sp.Pid(kp=3000.0, kd=30.0, ki=0.0),
        schedule=sp.Schedule.steps([0.0], [[0.05, 0.05]]),
        disturbances=[sp.Pulse(time=0.01, duration=0.01, force=(0.0, -20.0), moment=0.02)],
    )
    held = sp.grip(replace(scene, disturbances=()), force=9.81)
    state = held.equilibrium.state
    assert state is not None
    return replace(scene, schedule=held.scene.schedule, initial=sp.State(state.q, np.zeros(9)))


SCENES = {
    "sticks": grasp(
        0.5,
        0.05,
        schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.01], np.deg2rad([[6, 6], [8, 4]]), move_time=0.03
        ),
    ),
    "slips and stops": grasp(
        0.4,
        0.05,
        disturbances=[sp.Pulse(time=0.015, duration=0.01, force=(0.0, -110.0), moment=0.0)],
    ),
    "turns and slips, heavy tips": grasp(
        0.4,
        0.06,
        hand=sp.Hand(),
        disturbances=[sp.Pulse(time=0.015, duration=0.01, force=(0.0, -180.0), moment=3.0)],
    ),
    "opens and closes": grasp(
        0.5,
        0.06,
        schedule=sp.Schedule.steps([0.0, 0.02], np.deg2rad([[6, 6], [20, -10]])),
    ),
    "opens on both sides in turn, heavy tips": grasp(
        0.5,
        0.12,
        hand=sp.Hand(),
        schedule=sp.Schedule.steps(
            [0.0, 0.03, 0.06, 0.09], np.deg2rad([[6, 6], [20, -10], [-2, 13], [-10, 20]])
        ),
    ),
    "meets the object": dropped(),
    "slips and stops between jaws": jaws(),
}


def lasting(changes: list[tuple[float, int]], shortest: float) -> list[tuple[float, int]]:
    """(time, mode) of one finger, without modes that last less than `shortest`.

    The steps of one simulation skip what the events of the other find, such as a graze of 70 ns.
    """
    kept: list[tuple[float, int]] = []
    for k, (time, mode) in enumerate(changes):
        if k + 1 < len(changes) and changes[k + 1][0] - time < shortest:
            continue
        if not kept or kept[-1][1] != mode:
            kept.append((time, mode))
    return kept


# The other four stick, slip, open, meet and stop, and one of them has jaws.
MORE = ("sticks", "turns and slips, heavy tips", "opens on both sides in turn, heavy tips")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name in MORE else name for name in SCENES],
)
def test_siconos_converges_to_the_run(name: str) -> None:
    scene = SCENES[name]
    run = sp.simulate(scene, dt=2e-5, record=("state", "contact"), stop_on=())
    assert run.status == "completed"
    friction = scene.friction if isinstance(scene.friction, tuple) else (scene.friction,) * 2
    fine = 4800
    ends = [moreau_jean.stepped(scene, friction, steps) for steps in (fine // 4, fine)]  # type: ignore[arg-type]

    def error(end: moreau_jean.Stepped) -> float:
        """Lengths, angles and their rates, each by the largest of its kind along the run."""
        found = []
        for values, there in ((run.q, end.q), (run.p, end.p)):
            for kind in ([0, 1, 5, 6, 7, 8], [2, 3, 4]):
                size = np.abs(values[:, kind]).max()
                found.append(np.abs(values[-1] - there)[kind].max() / size)
        return float(max(found))

    coarse_error, fine_error = map(error, ends)
    # The object turns with little resistance where the fingers' angles decide nothing.
    assert fine_error <= (1e-2 if scene.initial is not None else 3e-3)
    # First order: a quarter of the step. But an impact falls anywhere within its step.
    opens = (run.contact == sp.ContactMode.FREE).any()
    low, high = (2.0, np.inf) if opens else (3.8, 4.2)
    assert low <= coarse_error / fine_error <= high

    step = ends[-1].step
    for i, finger in enumerate(("right", "left")):
        ours = [(0.0, int(run.contact[0, i]))]
        ours += [(c.time, int(c.after)) for c in run.contact_changes if c.finger == finger]
        theirs = [(t, mode) for t, side, mode in ends[-1].changes if side == finger]
        ours, theirs = lasting(ours, 8 * step), lasting(theirs, 8 * step)
        assert [mode for _, mode in ours] == [mode for _, mode in theirs]
        for (here, _), (there, _) in zip(ours, theirs, strict=True):
            assert abs(here - there) <= 10 * step
