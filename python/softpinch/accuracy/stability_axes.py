"""The horizontal axes of stability maps: named axes, paths into the scene, users' functions.

To add a named axis, write a function from a scene and a value to a `Scene` or a `Stabilization`
with that value, and a line in `_TABLE`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from ..run.evaluate import evaluate
from ..scene import Impulse, Scene, SceneTemplate, Schedule, Stabilization, State, outline
from ..scene import fields as units
from ..scene.contact import as_bilateral
from ..scene.control import WRITTEN, pids_of
from ..scene.hand import Finger, Fingertip, links
from ..scene.parts import jaws, lever
from ..support import SIDES, Floats, checks

# An axis of a path or function is logarithmic if its last value exceeds its first by this factor.
_DECADES = 100.0
# Compression of the tips on the axis "tilt", as a share of their radius.
_TILTED_DEPTH = 0.05
# Direction of the blow on the axis "impulse": sideways and down, so that the object also turns.
_BLOW = np.array([0.8, -0.6])


@dataclass(frozen=True)
class Axis:
    """One axis of a stability map."""

    name: str  # the name, path or function name with which the axis is requested
    label: str  # its label in figures
    unit: str  # the unit of the values; "1" if they have none
    # The spacing in figures: "linear", "log", "logit" (for shares, stretched near 0 and 1) or
    # "right_angle" (for degrees, stretched towards 90).
    scale: str
    values: tuple[float, ...]  # default values (v,); empty if there are none
    # A function from a scene and a value to the scene with that value, or to gains of "csm".
    at: Callable[[Scene, float], Scene | Stabilization]

    def apply(
        self, scene: Scene, stabilization: Stabilization, value: float
    ) -> tuple[Scene, Stabilization]:
        """The scene and the gains of "csm" at a value of the axis."""
        with checks.reworded(f"{self.name} = {value:.6g}: "):
            found = self.at(scene, value)
        if isinstance(found, Stabilization):
            return scene, found
        checks.instance(f"axis({value:.6g})", found, Scene)
        return found, stabilization


def choose(
    scene: Scene, axis: str | Callable[[float], Scene], values: ArrayLike | None
) -> tuple[Axis, Floats]:
    """The axis with a name, or made from a path or a function; and its values (v,), checked."""
    if values is not None:
        values = checks.increasing("values", values)
    if isinstance(axis, str) and axis in AXES:
        found = AXES[axis]
        return found, np.array(found.values) if values is None else values
    if isinstance(axis, str):
        # Paths are those of `monte_carlo`.
        path = axis
        if path.split(".")[0] not in {f.name for f in fields(Scene)}:
            rule = f'must be one of {checks.quoted(AXES)}, or a path such as "grasped.mass"'
            hint = checks.hint(path, AXES)
            raise ValueError(f"axis = {checks.shown(path)}: {rule}{hint}")
        varied = SceneTemplate(scene, [path], 0)
        varied.require_numbers("axis")
        label, unit = units.label(path), units.units(path, (), jaws(scene))
        assert isinstance(unit, str)
        found = Axis(path, label, unit, "linear", (), lambda _, v: varied.changed({path: v}))
    elif callable(axis):
        function = axis
        name = getattr(function, "__name__", type(function).__name__)
        found = Axis(name, name, "1", "linear", (), lambda _, value: function(value))
    else:
        rule = "must be a name, a path or a function value -> Scene"
        raise TypeError(f"axis = {checks.shown(axis)}: {rule}")
    if values is None:
        raise ValueError(f"values: must be given for axis = {found.name!r}")
    wide = values[0] > 0.0 and values[-1] > _DECADES * values[0]
    return replace(found, scale="log" if wide else "linear"), values


def _object_mass(scene: Scene, value: float) -> Scene:
    inertia = scene.grasped.inertia * (value / scene.grasped.mass)
    return scene.with_({"grasped.mass": value, "grasped.inertia": inertia})


def _gains(scene: Scene, factor: float) -> Scene:
    if scene.law != "pid":
        law = WRITTEN[scene.law]
        raise ValueError(f'axis "gains": the scene has no PID gains, because of {law}')
    scaled = {}
    for side, pid in zip(SIDES, pids_of(scene.control), strict=True):
        for name, gain in pid.to_dict().items():
            scaled[f"control.{side}.{name}"] = factor * gain
    return scene.with_(scaled)


def _stabilization(scene: Scene, value: float) -> Stabilization:
    return Stabilization(alpha=value, beta=value)


def _grasp_depth(scene: Scene, share: float) -> Scene:
    if not 0.0 < share < 1.0:
        raise ValueError("must be > 0 and < 1, a share of the tips' radius")
    return _held_at(scene, [_closed(scene, k, share) for k in (0, 1)])


def _closed(scene: Scene, k: int, share: float) -> float:
    """The angle of finger `k` at which a centred object compresses its tip by a share (9), rad."""
    finger, radius = links(scene, 'the axis "grasp_depth"')[k], scene.hand.tips[k].radius
    # C^H = 0 at theta = 0 and x = w requires L sin(theta_i) + d_f cos(theta_i) to equal `inwards`.
    inwards = finger.root_offset - radius + share * radius - 0.5 * scene.grasped.width
    angle = outline.angle_at(finger.length, finger.half_thickness, inwards)
    if angle is None:
        wanted = f"the {SIDES[k]} finger would have to reach {1e3 * inwards:.4g} mm inwards"
        raise ValueError(f"{wanted}, and its length lets it reach {1e3 * lever(finger):.4g} mm")
    return angle


def _tilt(scene: Scene, degrees: float) -> Scene:
    if not 0.0 <= degrees < 90.0:
        raise ValueError("must be >= 0 and < 90 degrees")
    angle = math.radians(degrees)
    tips = scene.hand.tips

    def apart(finger: Finger, tip: Fingertip) -> Finger:
        # The condition of `_closed`, solved for the offset of the finger's root.
        inwards = outline.inward(finger, angle)
        reach = inwards + 0.5 * scene.grasped.width + (1.0 - _TILTED_DEPTH) * tip.radius
        return replace(finger, root_offset=reach)

    right, left = links(scene, 'the axis "tilt"')
    moved = replace(scene.hand, right=apart(right, tips[0]), left=apart(left, tips[1]))
    return _held_at(replace(scene, hand=moved), [angle, angle])


def _impulse(scene: Scene, size: float) -> Scene:
    time = _begin(scene) + 0.25 * scene.duration
    blow = Impulse(time=time, impulse=tuple((size * _BLOW).tolist()))
    return replace(scene, disturbances=(*scene.disturbances, blow))


def _held_at(scene: Scene, angles: list[float]) -> Scene:
    """The scene at rest, with PID integrals in balance, at these angles, which are the targets."""
    time = _begin(scene)
    scene = replace(scene, schedule=Schedule.steps([time], [angles]))
    fingers = links(scene, "a grasp at given angles")
    y = sum(map(outline.upward, fingers, angles)) / 2
    start = State.consistent(scene, x=scene.grasped.com_offset, y=y, fingers=angles, time=time)
    # While both tips stick the terms are those of bilateral contact.
    quiet = replace(as_bilateral(scene), disturbances=())

    def turning(integral: tuple[float, float]) -> Floats:
        found = evaluate(quiet, time, start.q, start.p, integral, formulation="nullspace")
        return found.accelerations[3:5]

    # The accelerations are affine in the integrals, so three evaluations give the linear system.
    free = turning((0.0, 0.0))
    slopes = np.column_stack([turning((1.0, 0.0)) - free, turning((0.0, 1.0)) - free])
    integral = np.linalg.lstsq(slopes, -free, rcond=None)[0]
    return replace(scene, initial=replace(start, integral=tuple(integral.tolist())))


def _begin(scene: Scene) -> float:
    """The instant at which the scene starts, s."""
    return scene.initial.time if isinstance(scene.initial, State) else 0.0


def _of_tips(*names: str) -> Callable[[Scene, float], Scene]:
    paths = [f"hand.tip.{side}.{name}" for side in SIDES for name in names]
    return lambda scene, value: scene.with_(dict.fromkeys(paths, value))


def _decades(low: float, high: float) -> tuple[float, ...]:
    return tuple(np.geomspace(low, high, 13).tolist())


_DEPTHS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 0.6, 0.8, 0.9, 0.97, 0.99, 0.999)
_TILTS = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 68.0, 75.0, 80.0, 84.0, 87.0, 89.0)
_VISCOSITIES = (0.0, *_decades(1e-1, 1e5))
_MODULUS = _of_tips("youngs_modulus")
_VISCOSITY = _of_tips("normal_viscosity", "tangential_viscosity")

_TABLE = (
    Axis("youngs_modulus", "modulus $E$", "Pa", "log", _decades(1e4, 1e10), _MODULUS),
    Axis("object_mass", "mass $M$", "kg", "log", _decades(1e-4, 1e1), _object_mass),
    Axis("viscosity", "viscosity $c_n, c_t$", "N s/m", "log", _VISCOSITIES, _VISCOSITY),
    Axis("gains", "factor on the gains", "1", "log", _decades(1e-3, 1e3), _gains),
    Axis("stabilization", r"$\alpha, \beta$", "1/s", "log", _decades(1e1, 1e7), _stabilization),
    Axis("grasp_depth", "depth $d_n/a$", "1", "logit", _DEPTHS, _grasp_depth),
    Axis("tilt", r"tilt $\theta_p$", "deg", "right_angle", _TILTS, _tilt),
    Axis("impulse", "size of the blow", "N s", "log", _decades(1e-3, 1e1), _impulse),
)
AXES: Mapping[str, Axis] = MappingProxyType({axis.name: axis for axis in _TABLE})
