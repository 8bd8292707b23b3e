"""Usual ranges of a scene's numbers, and a warning for numbers outside them.

Such a number is allowed, but it often has the wrong unit: degrees for radians, millimetres for
metres, megapascals for pascals. The ranges are ten times wider than realistic values.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..support import SIDES, SuspiciousValueWarning, errors
from ..support.suggest import places
from .contact import coefficients
from .control import SampledController
from .fields import COORDINATE_RANGES, COORDINATE_UNITS, Unit, of_coordinates, units, usual_range
from .loop_matrix import common_period, growth
from .motion import TimedMotion
from .outline import closing, compression
from .parts import Arc, MeasuredLaw, PowerLaw, TipLaw, in_words, jaws, refuse_crossed, width
from .schedule import default_schedule

if TYPE_CHECKING:
    from .scene import Scene

# Unilateral contact of a tip whose surface is as heavy as the object always has a mode up to a
# friction of about 1.5, of tips of 10 g up to 5 (Painlevé's paradox lies beyond).
_HEAVY_TIP_FRICTION, _LIGHT = 1.4, 0.01
# The square of the largest usual radius of gyration of an object without a height, in widths, and
# a share for round-off.
_SLENDER, _SMALLER = 100.0, 1.0 - 1e-9
# Growth of a free finger's swings during the scene that is worth a warning.
_GROWN = 10.0
# A gap below this length, m, is round-off of the start.
_ROUND_OFF = 1e-9


def warn(scene: Scene, schedule_replaced: bool = False) -> None:
    """Warns once for each field with an unusual number, but not of torques that are replaced."""
    refuse_crossed(scene)
    texts = scene._suspicions
    if scene.law == "torque" and scene.schedule == default_schedule() and not schedule_replaced:
        angle, unit = scene.schedule.angles[0, 0], units("control.limits", (), jaws(scene))
        what = "forces in N" if unit == "N" else f"torques in {unit}"
        texts += (
            f"schedule: this is the default schedule, whose {angle:.3g} rad are meant as angles; "
            f"with control=Torque() they are {what}. Give schedule= in {unit}, such as "
            "Schedule.steps([0.0], [[1.2, 1.2]])",
        )
    elif any(jaws(scene)) and scene.schedules_angles and scene.schedule == default_schedule():
        texts += (
            "schedule: this is the default schedule, whose angles of 6 degrees would be 105 mm of "
            "a Jaw. Give schedule= in m, such as Schedule.steps([0.0], [[4e-3, 4e-3]])",
        )
    for text in texts:
        errors.warn(text, SuspiciousValueWarning)


def warn_beyond(scene: Scene, result: Mapping[str, Any]) -> None:
    """Warns of tips that rows of a run, or its last state, compress beyond a measured curve."""
    q = result["final"]["q"][None] if result["q"] is None else result["q"]
    for side, tip, d in zip(SIDES, scene.hand.tips, q[:, 5:7].T, strict=True):
        if isinstance(tip.law, MeasuredLaw) and (d > (end := tip.law.compression[-1])).any():
            text = f"hand.tip.{side}.law: was measured up to {1e3 * end:.4g} mm, and the run"
            most = f"compresses the tip by {1e3 * np.nanmax(d):.4g} mm"
            errors.warn(f"{text} {most}", SuspiciousValueWarning)


def suspicions(scene: Scene) -> tuple[str, ...]:
    """Returns messages of `warn`: one for each unusual field, about an array's worst entry."""
    found = (_unusual, _laws, _heavy_tips, _growing_swings, _beside)
    texts = tuple(text for kind in found for text in kind(scene))
    if not any(text.startswith("schedule.") for text in texts):
        texts += tuple(_opening(scene))
    if not any(text.startswith("grasped.") for text in texts):
        texts += tuple(_other_inertia(scene))
    return tuple(t for t in texts if scene.schedules_angles or not t.startswith("schedule.angles"))


def _beside(scene: Scene) -> Iterator[str]:
    """Yields a message about a motion that is over before the run, or begins after it."""
    if not isinstance(scene.motion, TimedMotion):
        return
    times, begin = scene.motion.times, getattr(scene.initial, "time", 0.0)
    end, goes_on = begin + scene.duration, getattr(scene.motion, "hold", False)
    if len(times) > 1 and (times[0] >= end or (times[-1] < begin and not goes_on)):
        run = f"the run is from {begin:g} to {end:g} s"
        yield f"motion.times: the hand moves from {times[0]:g} to {times[-1]:g} s only, {run}"


def _heavy_tips(scene: Scene) -> Iterator[str]:
    """Yields a message about the highest friction of tips that have the object's mass (14)."""
    if scene.contact != "unilateral":
        return
    pair = scene.friction
    high = [
        (friction, f"friction.{side}" if isinstance(pair, tuple) else "friction")
        for side, friction, tip in zip(SIDES, coefficients(pair), scene.hand.tips, strict=True)
        if tip.normal_mass is None and friction > _HEAVY_TIP_FRICTION
    ]
    if high:
        friction, path = max(high, key=lambda one: one[0])
        yield (
            f"{path} = {friction:g}: above {_HEAVY_TIP_FRICTION:g} a sliding tip as heavy as the "
            "object may have no consistent contact forces; give the tips masses of their own, "
            f"about normal_mass = tangential_mass = {_LIGHT:g} kg"
        )


def _laws(scene: Scene) -> Iterator[str]:
    """Yields messages about laws with a pole where tips open, and about their units."""
    for path, law in places(scene.hand, "hand"):
        if isinstance(law, PowerLaw) and law.exponent < 2.0 and not law.foot:
            why = "below 2 a run can end where a sheared tip opens, whose force has a pole there"
            yield f"{path}.exponent = {law.exponent:g}: {why}; give a foot, such as foot=1e-4 m"
        if isinstance(law, TipLaw):
            a = np.asarray(scene.hand.tips[".left." in path].radius)
            modulus = law._stiffness(a) / (2.0 * math.pi * a)  # of springs (5) that are as stiff
            known = usual_range("hand.tip.youngs_modulus", (False, False))
            if known and not known[0][0] <= modulus <= known[0][1]:
                usual = "usual is from {:g} to {:g} Pa; is it in m and N?".format(*known[0])
                yield f"{path}: is as stiff as springs with a modulus of {modulus:.3g} Pa: {usual}"


def _growing_swings(scene: Scene) -> Iterator[str]:
    """Yields a message about a sampled controller with which free fingers swing ever wider."""
    control = scene.control
    if not isinstance(control, SampledController):
        return
    factor, (period, _) = growth(scene, control), common_period(control)
    if factor <= 1.0 or math.log(factor) * scene.duration / period <= math.log(_GROWN):
        return
    time, gain = period / math.log(factor), units("control.ki", (), jaws(scene))
    yield (
        f"control: with this SampledController a finger that touches nothing swings ever wider, by "
        f"a factor of 2.7 in each {time:.3g} s; smaller gains, most of all ki (1000 {gain} in "
        f"pid unless given), or a shorter period ({control.period:g} s) or delay "
        f"({control.delay:g} s) make it stable"
    )


def _opening(scene: Scene) -> Iterator[str]:
    """Yields a message about fingers in contact whose first targets leave a gap to the object."""
    if scene.law == "driven" or not scene.schedules_angles:
        return
    try:
        start = scene.start()
    except ValueError:
        return  # a run says which gap there is
    pids = scene.control if isinstance(scene.control, tuple) else (scene.control,)
    if not any(getattr(pid, "kp", 1.0) or getattr(pid, "ki", 1.0) for pid in pids):
        return  # no target turns a finger
    touching = closing(scene, 0.0)
    targets = scene.schedule.target(start.time)
    gap = -compression(scene, targets.tolist())
    apart = compression(scene, start.q[3:5].tolist()) < -_ROUND_OFF
    if touching is None or gap <= _ROUND_OFF or apart:
        return
    # Beyond an arc there is a gap again.
    past = all(target > first for target, first in zip(targets, touching, strict=True))
    way = "closes the fingers past the object" if past else "opens the fingers"
    yield (
        f"schedule.angles: touching is at {in_words(scene, touching)}, the schedule asks for "
        f"{in_words(scene, targets).removesuffix(' degrees')} at the start: it {way}, "
        f"to a gap of {1e3 * gap:.3g} mm"
    )


def inertias(width: float, mass: float, height: float | None) -> tuple[float, float]:
    """Returns the smallest and the largest usual inertia of an object, kg m^2."""
    square = width**2
    # All mass in the corners of the faces, or a uniform box about 35 times as tall as wide.
    most = _SLENDER * square if height is None else 0.25 * (square + height**2)
    return mass * square / 12.0, mass * most


def _other_inertia(scene: Scene) -> Iterator[str]:
    """Yields a message about an inertia unlike those of bodies with this mass and these faces."""
    grasped = scene.grasped
    across = width(scene)
    least, most = inertias(across, grasped.mass, grasped.height)
    if _SMALLER * least <= grasped.inertia <= most / _SMALLER:
        return
    arcs = isinstance(grasped.right, Arc) and isinstance(grasped.left, Arc)
    maker = "disc(diameter" if arcs else "box(width, height"
    tall = "" if grasped.height is None else f" and {grasped.height:g} m tall"
    yield (
        f"grasped.inertia = {grasped.inertia:g} kg m^2: usual for {grasped.mass:g} kg, "
        f"{across:g} m wide{tall}, is from {least:.3g} to {most:.3g} kg m^2; was it given "
        f"for another mass or width? GraspedObject.{maker}, mass) computes it"
    )


def _unusual(scene: Scene) -> Iterator[str]:
    """Yields a message about each field with a number outside its usual range."""
    own = jaws(scene)
    for path, value in places(scene):
        if path == "initial.q":
            # One message for the whole state: about its first number outside the usual range.
            of_each = of_coordinates(COORDINATE_UNITS, own)
            ranges = enumerate(zip(COORDINATE_RANGES, of_each, strict=True))
            for k, (usual, unit) in ranges:
                if found := list(_outside(f"{path}.{k}", np.asarray(value[k]), *usual, unit)):
                    yield found[0]
                    break
        elif isinstance(value, float | tuple | np.ndarray):
            known = usual_range(path, own)
            sides = path == "friction" and isinstance(value, tuple)
            if known is not None and not sides:
                yield from _outside(path, np.asarray(value), *known[0], known[1])


def _outside(path: str, values: NDArray[Any], low: float, high: float, unit: Unit) -> Iterator[str]:
    # An infinite value is intentional: infinite friction means that the tips never slide.
    wrong = np.isfinite(values) & ((values < low) | (values > high))
    if not wrong.any():
        return
    index = np.unravel_index(np.argmax(np.where(wrong, np.abs(values), -1.0)), values.shape)
    where = ".".join([path, *(str(int(k)) for k in index)])
    unit = unit if isinstance(unit, str) else unit[int(index[-1])]
    unit = "" if unit == "1" else f" {unit}"
    advice = "; is it in another unit?"
    if unit == " rad":
        advice = "; degrees go through np.deg2rad"
        advice += " or Schedule.in_degrees" if path.startswith("schedule") else ""
    yield f"{where} = {values[index]:g}{unit}: usual is from {low:g} to {high:g}{unit}{advice}"
