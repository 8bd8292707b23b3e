"""Random scenes with unilateral contact, and what holds along every run of one."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st
from numpy.typing import NDArray

import softpinch as sp

FREE, STICK, SLIP, GRAZE = sp.ContactMode
EVERYTHING = ("state", "multipliers", "residuals", "energy", "contact")


def within(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers of single precision, so that products of them do not underflow."""
    return st.floats(0.0, 1.0, width=32).map(lambda share: low + (high - low) * share)


@st.composite
def grasps(draw: Any, duration: float = 0.03, steps: bool = True) -> sp.Scene:
    """Uneven hands with light or heavy tips whose grasp a push or a jump of the targets may loosen.

    Args:
        duration: s.
        steps: Whether the targets may jump.
    """
    tips = []
    for _ in range(2):
        mass = draw(within(0.01, 0.1))
        tip = sp.Fingertip(
            radius=draw(within(0.018, 0.022)),
            youngs_modulus=draw(within(2e5, 4e5)),
            normal_viscosity=draw(within(70.0, 130.0)),
            tangential_viscosity=draw(within(70.0, 130.0)),
            normal_mass=mass,
            tangential_mass=mass * draw(within(0.5, 1.5)),
        )
        tips.append(tip)
    fingers = [
        sp.Finger(
            length=draw(within(0.070, 0.082)),
            half_thickness=draw(within(0.004, 0.005)),
            mass=draw(within(0.08, 0.12)),
            inertia=draw(within(5e-4, 7e-4)),
        )
        for _ in range(2)
    ]
    width, offset = draw(within(0.045, 0.052)), draw(within(-0.005, 0.005))
    depths = [draw(within(0.002, 0.005)) for _ in range(2)]
    # Pressed by the depth, with straight fingers and the object upright.
    placed = [
        replace(finger, root_offset=width / 2 + tip.radius + finger.half_thickness - depth)
        for finger, tip, depth in zip(fingers, tips, depths, strict=True)
    ]
    force, angle = draw(within(0.0, 120.0)), draw(within(-np.pi, np.pi))
    pulse = sp.Pulse(
        time=duration / 5,
        duration=duration / 4,
        force=(float(force * np.cos(angle)), float(force * np.sin(angle))),
        moment=draw(within(-2.0, 2.0)),
    )
    first = np.deg2rad([draw(within(2.0, 8.0)) for _ in range(2)])
    jump = np.deg2rad([draw(within(-6.0, 6.0)) for _ in range(2)]) if steps else np.zeros(2)
    return sp.Scene(
        hand=sp.Hand(right=placed[0], left=placed[1], tip=(tips[0], tips[1])),
        grasped=sp.GraspedObject(
            width=width,
            com_offset=offset,
            height=draw(st.sampled_from([None, 0.049])),
            mass=draw(within(0.08, 0.15)),
            inertia=draw(within(3e-5, 6e-5)),
        ),
        control=(sp.Pid(), sp.Pid(kp=draw(within(80.0, 120.0)), kd=draw(within(0.7, 1.3)))),
        schedule=sp.Schedule.steps([0.0, duration / 2], [first, first + jump]),
        disturbances=[pulse],
        duration=duration,
        friction=(draw(within(0.1, 1.2)), draw(within(0.1, 1.2))),
        contact="unilateral",
    )


def perturbed(scene: sp.Scene, size: float) -> sp.Scene:
    """The scene from a start that is slightly moved, turned and accelerated."""
    start = scene.start()
    q = np.asarray(start.q)
    moved = sp.State.consistent(
        scene,
        x=q[0] + size * 0.05,
        y=q[1] + size * 0.05,
        rotation=q[2] + size,
        fingers=q[3:5],
        shear=q[7:9],
        velocity=(size, size, 10 * size),
    )
    return replace(scene, initial=moved)


def settled(run: sp.Run, finger: str) -> list[tuple[float, int, int]]:
    """Time and modes of a finger's changes after the start; several at one instant are one."""
    start = run.scene.start().time
    merged: list[tuple[float, int, int]] = []
    for change in run.contact_changes:
        if change.finger != finger or change.time == start:
            continue
        time, before, after = change.time, int(change.before), int(change.after)
        if merged and time - merged[-1][0] <= 1e-12:
            time, before, _ = merged.pop()
        if before != after or before == SLIP:
            merged.append((time, before, after))
    return merged


def sequence(run: sp.Run) -> list[list[tuple[int, int]]]:
    """The modes before and after each change, by finger, without times."""
    return [[change[1:] for change in settled(run, finger)] for finger in ("right", "left")]


# Examples are not simplified where one takes seconds.
UNHURRIED: dict[str, Any] = {
    "phases": [Phase.explicit, Phase.reuse, Phase.generate],
    "suppress_health_check": [
        HealthCheck.filter_too_much,
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
    ],
}


def heights(run: sp.Run) -> NDArray[np.float64]:
    """Positions of the tips' centres along the object's faces (n, 2), m, from its middle."""
    hand, (x, y, theta) = run.scene.hand, run.q[:, :3].T
    columns = []
    for i, (finger, s) in enumerate([(hand.right, -1), (hand.left, 1)]):
        angle = run.q[:, 3 + i]
        across = finger.length * np.sin(angle) + finger.half_thickness * np.cos(angle)
        along = finger.length * np.cos(angle) - finger.half_thickness * np.sin(angle)
        root = s * (across - finger.root_offset)
        columns.append((y - along) * np.cos(theta) - (x - root) * np.sin(theta))
    return np.array(columns).T


def check(run: sp.Run, closure: float = 1e-6) -> None:
    """Checks invariants of a run with unilateral contact that was recorded with EVERYTHING."""
    grasped, hand = run.scene.grasped, run.scene.hand
    friction = np.broadcast_to(np.asarray(run.scene.friction, dtype=float), 2)
    normal, tangential = run.multipliers[:, :2], run.multipliers[:, 2:]
    size = np.abs(run.multipliers).max() + 1e-300
    assert normal.min() >= -1e-9 * size
    assert (np.abs(tangential) - friction * normal).max() <= 1e-9 * size * (1 + friction.max())
    loose = (run.contact == FREE) | (run.contact == GRAZE)
    assert not normal[loose].any() and not tangential[loose].any()
    radius = max(tip.radius for tip in hand.tips)
    beside = np.abs(heights(run)) < (np.inf if grasped.height is None else grasped.height / 2)
    # A run ends as lost where a tip comes beside the face from beyond it, inside the object.
    beside[-1] &= run.status != "lost"
    gaps = run.residuals[:, :2]
    assert gaps[(run.contact == FREE) & beside].min(initial=0) >= -1e-10 * radius
    ledger = run.energy
    exchanged = ledger.exchanged
    assert np.diff(ledger.friction_loss).min(initial=0) >= -1e-9 * exchanged
    assert np.diff(ledger.viscous_loss).min(initial=0) >= -1e-9 * exchanged
    if not any(isinstance(d, sp.Impulse) for d in run.scene.disturbances):
        assert np.diff(ledger.impact_loss).min(initial=0) >= -1e-9 * exchanged
    assert np.abs(ledger.closure).max() <= closure * exchanged
    times = [change.time for change in run.contact_changes]
    assert times == sorted(times) and not any(np.isnan(times))
    # A change begins where the change before it of this finger ended.
    for finger in ("right", "left"):
        own = [c for c in run.contact_changes if c.finger == finger]
        assert all(a.after == b.before for a, b in pairwise(own))
        if own:
            assert own[-1].after == run.contact[-1, ["right", "left"].index(finger)]
