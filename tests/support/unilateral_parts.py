"""Random grasps of other parts that slip, open and meet again, and grasps made by hand."""

from dataclasses import replace
from typing import Any

import numpy as np

import softpinch as sp
from other_hands import STIFF
from softpinch.scene.outline import closing

# The part of which a scene has two; the last one has six parts at random.
KINDS = ("jaw", "parallelogram", "tilted face", "arc", "power law", "measured law", "mixed")


def _finger(kind: str, rng: np.random.Generator) -> Any:
    shared = {
        "half_thickness": rng.uniform(0.004, 0.006),
        "root_offset": rng.uniform(0.047, 0.051),
        "mass": rng.uniform(0.08, 0.15),
    }
    if kind == "jaw":
        direction, angle = rng.uniform(-0.25, 0.25, 2)
        height = rng.uniform(0.070, 0.082)
        return sp.Jaw(height=height, direction=direction, angle=angle, **shared)
    links = {"length": rng.uniform(0.070, 0.082), "inertia": rng.uniform(5e-4, 7e-4)}
    if kind == "parallelogram":
        return sp.Parallelogram(angle=rng.uniform(-0.2, 0.2), **links, **shared)
    return sp.Finger(**links, **shared)


def _side(kind: str, sign: float, rng: np.random.Generator) -> Any:
    """A side; `sign` is 1 on the right."""
    if kind == "tilted face":
        return sp.Face(tilt=rng.uniform(-0.2, 0.2), height=rng.choice([0.05, 0.1]))
    if kind == "arc":
        radius = rng.uniform(0.02, 0.06)
        centre = sign * (rng.uniform(0.0225, 0.0265) - radius), rng.uniform(-4e-3, 4e-3)
        counterface = str(rng.choice(["cylinder", "cylinder", "sphere", "flat"]))
        return sp.Arc(radius, centre, rng.choice([None, 1.5]), counterface)
    return None


def _law(kind: str, rng: np.random.Generator) -> Any:
    """A law with about the force of the default springs at 5 mm."""
    force, share = rng.uniform(16.0, 34.0), rng.uniform(0.5, 1.0)
    if kind == "power law":
        exponent = rng.uniform(1.5, 2.6)
        foot = rng.uniform(2e-4, 1e-3) if exponent < 2.0 or rng.random() < 0.5 else None
        return sp.PowerLaw(force / 5e-3**exponent, exponent, foot, share)
    if kind == "measured law":
        d = np.array([1.0, 2.0, 3.5, 5.0, 6.5, 8.0]) * 1e-3
        curve = (d / 5e-3) ** rng.uniform(1.5, 2.2) * rng.uniform(0.97, 1.03, 6)
        return sp.MeasuredLaw(d, force * curve, share)
    return None


def grasp(kind: str, seed: int, duration: float = 0.016, scale: float = 1.0) -> sp.Scene:
    """A grasp that a push and a jump of the targets may loosen.

    Args:
        kind: One of `KINDS`. Even seeds have the paper's parts beside it, odd ones any.
        seed: Of all numbers.
        duration: s.
        scale: Of push and jump.
    """
    rng = np.random.default_rng([KINDS.index(kind), seed])
    tables = [("link", "jaw", "parallelogram"), ("box", "tilted face", "arc"),
              ("springs", "power law", "measured law")]  # fmt: skip
    others = kind == "mixed" or seed % 2

    def kinds(table: tuple[str, ...]) -> list[str]:
        if kind in table:
            return [kind, kind]
        return [str(rng.choice(table)) if others else table[0] for _ in range(2)]

    mechanisms, shapes, laws = map(kinds, tables)
    fingers = [_finger(each, rng) for each in mechanisms]
    right, left = (_side(k, s, rng) for k, s in zip(shapes, (1.0, -1.0), strict=True))
    tips = []
    for each in laws:
        mass = rng.uniform(0.01, 0.1)
        numbers: dict[str, Any] = {
            "radius": rng.uniform(0.018, 0.022),
            "youngs_modulus": rng.uniform(2e5, 4e5),
            "normal_viscosity": rng.uniform(70.0, 130.0),
            "tangential_viscosity": rng.uniform(70.0, 130.0),
            "tilt_coupling": float(rng.choice([1.0, 0.0, -1.0])),
            "normal_mass": mass,
            "tangential_mass": mass * rng.uniform(0.5, 1.5),
            "law": _law(each, rng),
        }
        if numbers["law"] is not None:
            del numbers["youngs_modulus"]  # which a law of its own does not have
        tips.append(sp.Fingertip(**numbers))
    force, way = scale * rng.uniform(20.0, 120.0), rng.uniform(-np.pi, np.pi)
    pulse = sp.Pulse(
        time=duration / 5,
        duration=duration / 4,
        force=(force * np.cos(way), force * np.sin(way)),
        moment=scale * rng.uniform(-2.0, 2.0),
    )
    jaws = np.array([each == "jaw" for each in mechanisms])
    scene = sp.Scene(
        hand=sp.Hand(right=fingers[0], left=fingers[1], tip=(tips[0], tips[1])),
        grasped=sp.GraspedObject(
            com_offset=rng.uniform(-4e-3, 4e-3),
            height=rng.choice([None, 0.049]),
            mass=rng.uniform(0.08, 0.15),
            inertia=rng.uniform(3e-5, 6e-5),
            right=right,
            left=left,
        ),
        control=(STIFF if jaws[0] else sp.Pid(), STIFF if jaws[1] else sp.Pid(kp=90.0, kd=0.9)),
        disturbances=[pulse],
        duration=duration,
        friction=(rng.uniform(0.1, 1.2), rng.uniform(0.1, 1.2)),
        contact="unilateral",
        initial="touching",
    )
    pressed, deeper = (closing(scene, depth) for depth in rng.uniform([2e-3, 3e-3], [4e-3, 7e-3]))
    assert pressed and deeper
    jump = scale * rng.uniform(-1.0, 1.0, 2) * np.where(jaws, 8e-3, 0.1)
    return replace(
        scene,
        schedule=sp.Schedule.steps([0.0, duration / 2], [deeper, np.add(deeper, jump)]),
        initial=sp.State.consistent(scene, fingers=pressed),
    )


LIGHT = sp.Fingertip(normal_mass=0.02, tangential_mass=0.02)
GRIPPER = sp.Hand(right=sp.Jaw(), left=sp.Jaw(), tip=LIGHT)


def jawed(grasped: sp.GraspedObject, target: Any = (4e-3, 4e-3), **fields: Any) -> sp.Scene:
    """Jaws that close on an object, which they touch unless a start is given."""
    return sp.Scene(
        **{
            "hand": GRIPPER,
            "grasped": grasped,
            "control": STIFF,
            "schedule": sp.Schedule.steps([0.0], [target]),
            "contact": "unilateral",
            "friction": 0.4,
            "initial": "touching",
        }
        | fields
    )


def started(
    scene: sp.Scene, coordinates: dict[int, float], rates: dict[int, float] | None = None
) -> sp.Scene:
    """The scene from its own start with other entries of q and p."""
    q, p = np.array(scene.start().q), np.zeros(9)
    q[list(coordinates)] = [*coordinates.values()]
    for k, rate in (rates or {}).items():
        p[k] = rate
    return replace(scene, initial=sp.State(q, p))


BOTTLE = sp.GraspedObject.disc(diameter=0.05, mass=0.15)
SHORT = replace(BOTTLE, right=sp.Arc(0.025, span=0.8), left=sp.Arc(0.025, span=0.8))
HIGH, LOW = sp.Arc(0.025, (0.0, 4.4e-3)), sp.Arc(0.025, (0.0, -6.9e-3))
CURVE = np.array([1.0, 1.5, 2.0, 3.0]) * 1e-3
PAD = sp.MeasuredLaw(CURVE, 23.6 * (CURVE / 5e-3) ** 1.8)
_NEAR = sp.Parallelogram(root_offset=0.0515)
# A scene for each name, which says what happens in it.
BY_HAND: dict[str, sp.Scene] = {
    # It opens no faster than the surface relaxes, and slips again after a millisecond.
    "a parallelogram grazes on a disc": jawed(
        replace(BOTTLE, right=HIGH, left=HIGH),
        hand=sp.Hand(
            right=sp.Parallelogram(angle=0.4),
            left=sp.Parallelogram(angle=0.4),
            tip=sp.Fingertip(normal_mass=0.4, tangential_mass=0.4),
        ),
        control=sp.Pid(),
        schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.02], [[0.07, 0.07], [0.04792, -0.00668]], move_time=0.0156
        ),
        duration=0.035,
        friction=0.6,
    ),
    "a jaw grazes on a disc": jawed(
        replace(BOTTLE, right=LOW, left=LOW),
        hand=sp.Hand(
            right=sp.Jaw(angle=0.45, direction=-0.26),
            left=sp.Jaw(angle=0.45, direction=-0.26),
            tip=sp.Fingertip(normal_mass=0.2, tangential_mass=0.2),
        ),
        schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.02], [[4e-3, 4e-3], [0.65e-3, 2.2e-3]], move_time=0.0132
        ),
        duration=0.035,
        friction=0.6,
    ),
    "jaws close on a bottle that stands aside": started(
        jawed(BOTTLE, duration=0.03), {0: 1.5e-3, 1: 0.0742, 3: -3e-3, 4: -3e-3}, {2: 20.0}
    ),
    "a bottle is struck": jawed(
        BOTTLE,
        disturbances=[sp.Impulse(time=0.01, impulse=(0.12, -0.05), angular_impulse=8e-4)],
        duration=0.02,
    ),
    "a bottle falls past the ends of its arcs": started(
        jawed(SHORT, duration=0.05, friction=0.05), {}, {1: -0.8}
    ),
    # The right arc's end turns towards the tip, which has come behind it meanwhile.
    "a tip meets the end of an arc": started(
        jawed(replace(SHORT, left=sp.Arc(0.025)), duration=0.05, friction=0.5),
        {2: 0.6, 3: -7e-4, 4: -7e-4},
        {2: -40.0},
    ),
    "a wedge slips out of its jaws": jawed(
        sp.GraspedObject.wedge(width=0.05, height=0.02, mass=0.05, angle=-0.25),
        duration=0.08,
        friction=0.1,
    ),
    "driven parallelograms close on a bottle": started(
        jawed(
            BOTTLE,
            hand=sp.Hand(right=_NEAR, left=_NEAR, tip=LIGHT),
            fingers="driven",
            schedule=sp.Schedule.minimum_jerk(
                [0.0, 0.004], [[0.0, 0.0], [0.1, 0.07]], move_time=0.03
            ),
            control=sp.Pid(),
            initial=None,
            duration=0.04,
        ),
        {1: 0.075, 3: 0.0, 4: 0.0},
    ),
    "a measured tip is pressed beyond its range and lets go": jawed(
        sp.GraspedObject(),
        hand=sp.Hand(right=sp.Jaw(), left=sp.Jaw(), tip=replace(LIGHT, law=PAD)),
        schedule=sp.Schedule.steps([0.0, 0.012], [[6e-3, 6e-3], [-5e-3, 2e-3]]),
        duration=0.016,
    ),
}
