"""Symmetries of the mechanics as maps of scenes and results: the mirror image, and other units."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from noises import held

Floats = NDArray[np.float64]

# x, theta change sign; the fingers, compressions and shears change sides.
MIRROR_ORDER = [0, 1, 2, 4, 3, 6, 5, 8, 7]
MIRROR_SIGN = np.array([-1.0, 1, -1, 1, 1, 1, 1, 1, 1])
MIRROR_MULTIPLIERS = [1, 0, 3, 2]


def mirrored_coordinates(q: Floats) -> Floats:
    return np.asarray(q)[..., MIRROR_ORDER] * MIRROR_SIGN


def _swap(pair: Any) -> Any:
    return (pair[1], pair[0]) if isinstance(pair, tuple) else pair


def without_noise(scene: sp.Scene) -> sp.Scene:
    """The scene with held noise as samples, which need no generator of random numbers."""
    until = scene.start().time + scene.duration
    return replace(
        scene,
        disturbances=[
            held(d, place, until) if isinstance(d, sp.Noise) else d
            for place, d in enumerate(scene.disturbances)
        ],
    )


def _mirrored_disturbance(disturbance: Any) -> Any:
    if isinstance(disturbance, sp.Impulse):
        x, y = disturbance.impulse
        return replace(disturbance, impulse=(-x, y), angular_impulse=-disturbance.angular_impulse)
    force = np.asarray(disturbance.force) * [-1.0, 1.0]
    moment = -np.asarray(disturbance.moment)
    if isinstance(disturbance, sp.Sampled):
        return replace(disturbance, force=force, moment=moment)
    return replace(disturbance, force=tuple(force), moment=float(moment))


def _mirrored_initial(initial: Any) -> Any:
    if not isinstance(initial, sp.State):
        return initial
    return replace(
        initial,
        q=mirrored_coordinates(np.asarray(initial.q)),
        p=mirrored_coordinates(np.asarray(initial.p)),
        integral=np.asarray(initial.integral)[::-1],
    )


def _mirrored_side(side: Any) -> Any:
    if not isinstance(side, sp.Arc):
        return side
    x, y = side.center
    return replace(side, center=(-x, y))


def mirrored(scene: sp.Scene) -> sp.Scene:
    """The scene as a mirror on the y axis shows it."""
    scene = without_noise(scene)
    hand = scene.hand
    return replace(
        scene,
        hand=replace(hand, right=hand.left, left=hand.right, tip=_swap(hand.tip)),
        grasped=replace(
            scene.grasped,
            com_offset=-scene.grasped.com_offset,
            right=_mirrored_side(scene.grasped.left),
            left=_mirrored_side(scene.grasped.right),
        ),
        control=_swap(scene.control),
        friction=_swap(scene.friction),
        schedule=replace(scene.schedule, angles=np.asarray(scene.schedule.angles)[:, ::-1]),
        disturbances=[_mirrored_disturbance(d) for d in scene.disturbances],
        initial=_mirrored_initial(scene.initial),
    )


# Unit -> powers of length, mass and time.
DIMENSIONS = {
    **{"1": (0, 0, 0), "rad": (0, 0, 0), "m": (1, 0, 0), "kg": (0, 1, 0), "s": (0, 0, 1)},
    **{"N": (1, 1, -2), "Pa": (-1, 1, -2), "Hz": (0, 0, -1)},
}


class Units:
    """Other units of length, mass and time, each a power of two, so that every product is exact."""

    def __init__(self, length: int, mass: int, time: int) -> None:
        self.length, self.mass, self.time = 2.0**length, 2.0**mass, 2.0**time

    def of(self, length: int = 0, mass: int = 0, time: int = 0) -> float:
        """The factor of a quantity with these dimensions."""
        return self.length**length * self.mass**mass * self.time**time

    @property
    def coordinates(self) -> Floats:
        return self.of_coordinates((False, False))

    def of_coordinates(self, jaws: tuple[bool, bool]) -> Floats:
        """The factors of the coordinates, of which those of jaws are lengths."""
        a = self.length
        return np.array([a, a, 1, *(a if jaw else 1 for jaw in jaws), a, a, a, a])

    def factor(self, unit: str) -> float:
        """The factor of a quantity with a unit of the package, such as "N s/m"."""
        above, _, below = unit.partition("/")
        result = 1.0
        for part, sign in ((above, 1), (below, -1)):
            for word in part.strip("()").split():
                name, _, power = word.partition("^")
                result *= self.of(*DIMENSIONS[name]) ** (sign * int(power or 1))
        return result

    def law(self, law: Any) -> Any:
        """The same law of a tip in these units."""
        force = self.of(1, 1, -2)
        if isinstance(law, sp.MeasuredLaw):
            compression, forces = law.compression * self.length, law.force * force
            return replace(law, compression=compression, force=forces)
        if isinstance(law, sp.PowerLaw):
            foot = None if law.foot is None else law.foot * self.length
            coefficient = law.coefficient * (force / self.length**law.exponent)
            return replace(law, coefficient=coefficient, foot=foot)
        return law

    def scene(self, scene: sp.Scene) -> sp.Scene:
        """The same scene in these units: each of its numbers is multiplied by its unit's factor."""
        tips = tuple(replace(tip, law=self.law(tip.law)) for tip in scene.hand.tips)
        if any(tip.law for tip in tips):
            scene = replace(scene, hand=replace(scene.hand, tip=tips))
        changes: dict[str, Any] = {}
        chosen: set[tuple[str, ...]] = set()
        for path, (value, unit) in scene.vary_paths().items():
            own = path.split(".")
            if "law" in own:
                continue
            shared = [step for step in own if step not in ("right", "left")]
            if any(tuple(one[:k]) in chosen for one in (own, shared) for k in range(1, 9)):
                continue  # a part of a number that has changed already
            chosen.add(tuple(own))
            factors = [self.factor(one) for one in ([unit] if isinstance(unit, str) else unit)]
            if value is not None:
                scaled = np.asarray(value) * (factors if len(factors) > 1 else factors[0])
                changes[path] = scaled if scaled.ndim else float(scaled)
        return scene.with_(changes)


def require_scaled(
    run: sp.Run, other: sp.Run, units: Units, jaws: tuple[bool, bool] = (False, False)
) -> None:
    """The other run is that of the same scene in other units, to the bit."""
    assert other.status == run.status
    coordinates = units.of_coordinates(jaws)
    rate = coordinates / units.time
    pairs = {
        "t": units.time,
        "q": coordinates,
        "p": rate,
        "multipliers": units.of(1, 1, -2),
        "residuals": units.length / np.array([1, 1, units.time, units.time]),
    }
    for name, scale in pairs.items():
        np.testing.assert_array_equal(getattr(other, name), getattr(run, name) * scale, name)
    for name in ("kinetic", "elastic", "gravity", "controller_work", "viscous_loss",
                 "friction_loss", "impact_loss", "relaxation_work", "closure"):  # fmt: skip
        ours, theirs = getattr(run.energy, name), getattr(other.energy, name)
        np.testing.assert_array_equal(theirs, ours * units.of(2, 1, -2), name)
