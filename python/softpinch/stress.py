"""Named scenes that are stiff or extreme, for testing methods; each says why it is hard.

    >>> import softpinch as sp
    >>> case = sp.stress.CASES["overdamped"]
    >>> sp.simulate(case.scene, tolerance=1e-6, method="radau5", formulation="nullspace").status
    'completed'

Parameters that a case does not set have their defaults.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any

import numpy as np

from .scene import HandMotion, Impulse, Pid, Scene, Schedule, Stabilization, State, outline
from .scene.hand import Finger, Fingertip, GraspedObject, Hand
from .scene.parts import Arc, Face, Jaw, MeasuredLaw, Parallelogram, PowerLaw

# Durations, s, that SciPy's methods can integrate at their tightest tolerance within seconds.
_SHORT, _MEDIUM = 0.02, 0.1
_LIGHT, _RAIL = Fingertip(normal_mass=1e-3, tangential_mass=1e-3), Pid(kp=2e4, kd=200.0, ki=2e5)
# A move whose jumps are on no grid of steps.
_WHIRL = HandMotion.trapezoid([0.0213, 0.0717], [[0.0, 0.0], [0.15, 0.1]], 400.0, [0.0, -1.0])


@dataclass(frozen=True, kw_only=True)
class StressCase:
    """A scene that is hard to integrate.

    Attributes:
        name: The key of the case in `CASES`.
        why: The reason why it is hard, in one line.
        scene: The scene.
        stabilization: The gains to use with formulation "csm".
        dt: The step, s, that the motion alone suggests, without regard to stiffness.
        end: The status with which an exact solution ends.
        long: Whether a run takes seconds even with the best method and formulation.
    """

    name: str = ""
    why: str
    scene: Scene
    dt: float = 1e-4
    stabilization: Stabilization = Stabilization()  # noqa: RUF009, it is frozen
    end: str = "completed"
    long: bool = False


def _held(angle: float = 6.0, **parts: Any) -> Scene:
    """Fingers that close from point contact: the right to `angle` degrees, the left to 0.8 of it.

    The angles differ so that no symmetry hides an error.
    """
    return Scene(schedule=Schedule.steps([0.0], np.deg2rad([[angle, 0.8 * angle]])), **parts)


def _heavy(mass: float) -> GraspedObject:
    """The default object with another density."""
    return GraspedObject(mass=mass, inertia=GraspedObject().inertia / GraspedObject().mass * mass)


def _grip(targets: Any, right: Any, left: Any = None, tip: Any = _LIGHT, **parts: Any) -> Scene:
    """Fingers of any kind that close from where they touch, with a little shear in their tips."""
    hand = Hand(right=right, left=left or right, tip=tip)
    control = [_RAIL if isinstance(each, Jaw) else Pid() for each in (hand.right, hand.left)]
    parts |= {"hand": hand, "control": control, "schedule": Schedule.steps([0.0], [targets])}
    scene = Scene(initial="touching", duration=_SHORT, **parts)
    start = State.consistent(scene, fingers=scene.start().q[3:5], shear=(2e-4, -1e-4))
    return replace(scene, initial=start)


def _folded() -> Scene:
    """Fingers whose roots are so far apart that they compress the tips by 1 mm at 80 degrees."""
    tilt, tip, width, finger = math.radians(80.0), Fingertip(), GraspedObject().width, Finger()
    root_offset = outline.inward(finger, tilt) + tip.radius - 1e-3 + 0.5 * width
    wide = replace(finger, root_offset=root_offset)
    scene = Scene(
        hand=Hand(right=wide, left=wide, tip=tip),
        control=Pid(kp=0.0, kd=0.0, ki=0.0),
        schedule=Schedule.steps([0.0], [[tilt, tilt]]),
        duration=0.015,
    )
    y = outline.upward(wide, tilt)
    start = State.consistent(scene, fingers=(tilt, tilt), finger_rates=(40.0, 30.0), x=0.0, y=y)
    return replace(scene, initial=start)


def _swinging() -> Schedule:
    """Targets that jump between two poses every 0.1 ms."""
    swing = 6.0 + 0.5 * np.where(np.arange(200) % 2 == 0, 1.0, -1.0)
    angles = np.deg2rad(np.column_stack([swing, 12.0 - swing]))
    return Schedule.sampled(1e-4 * np.arange(200), angles, hold="zero")


def _struck(x: float, y: float, angular: float) -> Scene:
    blow = Impulse(time=0.05, impulse=(x, y), angular_impulse=angular)
    return _held(disturbances=[blow], duration=_MEDIUM)


_SMALL = Finger(length=0.02, root_offset=0.02, mass=2e-3, inertia=1e-6)
_LINK, _TIP = Parallelogram(root_offset=0.1235), replace(_LIGHT, radius=4e-3, youngs_modulus=1e8)
_ODD = GraspedObject(width=0.03, mass=0.02, right=Face(tilt=0.2), left=Arc(0.02, (4e-3, 0.0)))
_CASES = {
    "near_rigid": StressCase(
        why="E = 10 GPa: the tip is a spring that only just gives way, at kilohertz",
        scene=_held(hand=Hand(tip=Fingertip(youngs_modulus=1e10)), duration=_SHORT),
        dt=5e-4,
    ),
    "feather": StressCase(
        why="an object and tips of 0.1 g: viscosity stops them within a microsecond",
        scene=_held(grasped=_heavy(1e-4), duration=_SHORT),
    ),
    "anvil": StressCase(
        why="10 kg between fingers of 0.1 kg: masses far apart, and slow sagging",
        scene=_held(grasped=_heavy(10.0), duration=_MEDIUM),
        dt=2e-4,
    ),
    "overdamped": StressCase(
        why="c = 1e4 N s/m on 1 g: rates die out in 1e-7 s, a thousandth of a step",
        scene=_held(
            hand=Hand(tip=Fingertip(normal_viscosity=1e4, tangential_viscosity=1e4)),
            grasped=GraspedObject(mass=1e-3),
            duration=_SHORT,
        ),
    ),
    "undamped": StressCase(
        why="no viscosity: the tips ring on, and so does every error",
        scene=_held(
            hand=Hand(tip=Fingertip(normal_viscosity=0.0, tangential_viscosity=0.0)),
            duration=_MEDIUM,
        ),
    ),
    "deadbeat_gains": StressCase(
        why="K_P = 1e4, K_D = 20: the fingers arrive within a step",
        scene=_held(control=Pid(kp=1e4, kd=20.0), duration=_MEDIUM),
    ),
    "strong_stabilization": StressCase(
        why="alpha = beta = 1e6 1/s: the constraint's own modes are faster than any step",
        scene=_held(duration=_MEDIUM),
        stabilization=Stabilization(alpha=1e6, beta=1e6),
    ),
    "barely_touching": StressCase(
        why="compressed by micrometres, where a tip has next to no stiffness",
        scene=_held(0.02, gravity=0.0, duration=_MEDIUM),
        dt=2e-4,
    ),
    "nearly_crushed": StressCase(
        why="pressed to within millimetres of the whole radius, in a fraction of a second",
        scene=_held(12.0, hand=Hand(tip=Fingertip(youngs_modulus=3e4)), duration=_MEDIUM),
        dt=2e-4,
    ),
    "crushed": StressCase(
        why="tips so soft that the fingers press them flat: it ends, as a status",
        scene=_held(25.0, hand=Hand(tip=Fingertip(youngs_modulus=3e3)), duration=_MEDIUM),
        end="crushed",
    ),
    "folded": StressCase(
        why="tips thrown at 90 degrees, where their energy is infinite: a long step leaps over",
        scene=_folded(),
        dt=1e-3,
    ),
    "hammer": StressCase(
        why="a blow that changes every velocity at once, in the middle of the motion",
        scene=_struck(0.03, -0.02, 1e-4),
    ),
    "thrown_out": StressCase(
        why="a blow that tears the object from a tip: it ends, as a status",
        scene=_struck(6.0, 0.0, 0.0),
        end="separated",
    ),
    "switching_every_step": StressCase(
        why="targets that jump every 0.1 ms: no step is longer, and no history helps",
        scene=Scene(schedule=_swinging(), duration=_SHORT),
    ),
    "whirled": StressCase(
        why="a move of 0.18 m and 57 degrees in 50 ms: forces of forty weights, which jump",
        scene=replace(_held(duration=_MEDIUM), motion=_WHIRL),
    ),
    "gram_jaws": StressCase(
        why="jaws and tips of 1 g, E = 100 MPa: the drives stop them within 10 microseconds",
        scene=_grip([4e-3, 3e-3], Jaw(mass=1e-3), tip=replace(_LIGHT, youngs_modulus=1e8)),
    ),
    "needle": StressCase(
        why="a needle of 6 mm and 1 g between tips of 20 mm, on which it rolls and turns",
        scene=_grip([0.45, 0.4], Finger(), grasped=GraspedObject.disc(6e-3, 1e-3)),
    ),
    "steep_wedge": StressCase(
        why="faces of 34 degrees on 1 g: the grip shears the tips as far as it presses them",
        scene=_grip([4e-3, 3e-3], Jaw(), grasped=GraspedObject.wedge(0.05, 0.03, 1e-3, 0.6)),
    ),
    "unlike_fingers": StressCase(
        why="a jaw of 2 kg and a link of 2 g, a face and an arc: time scales far apart",
        scene=_grip([8e-3, 0.05], Jaw(mass=2.0, height=0.02), _SMALL, (_LIGHT, _TIP), grasped=_ODD),
    ),
    "sharp_start": StressCase(
        why="F ~ d^1.2 with a foot of 1 micrometre: ever denser springs where sheared tips touch",
        scene=_grip([0.1, 0.08], Finger(), tip=replace(_LIGHT, law=PowerLaw(1.2e4, 1.2, 1e-6))),
    ),
    "long": StressCase(
        why="1000 s, 10^7 steps of 0.1 ms: round-off and drift have time",
        scene=_held(duration=1000.0),
        long=True,
    ),
}
# All cases by their names; made when asked for, since SciPy fits one of their laws.
CASES: Mapping[str, StressCase]


def __getattr__(name: str) -> Any:
    if name != "CASES":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if "toggle" not in _CASES and find_spec("scipy"):
        law = MeasuredLaw(np.linspace(1e-3, 6e-3, 6), np.geomspace(9.0, 1800.0, 6))
        _CASES["toggle"] = StressCase(
            why="links at their dead centre press without bound, on tips that are stiff from 4 mm",
            scene=_grip([1.57, 1.52], _LINK, tip=replace(_LIGHT, law=law)),
        )
    return MappingProxyType({key: replace(case, name=key) for key, case in _CASES.items()})
