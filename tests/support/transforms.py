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


def mirrored(scene: sp.Scene) -> sp.Scene:
    """The scene as a mirror on the y axis shows it."""
    scene = without_noise(scene)
    hand = scene.hand
    return replace(
        scene,
        hand=replace(hand, right=hand.left, left=hand.right, tip=_swap(hand.tip)),
        grasped=replace(scene.grasped, com_offset=-scene.grasped.com_offset),
        control=_swap(scene.control),
        friction=_swap(scene.friction),
        schedule=replace(scene.schedule, angles=np.asarray(scene.schedule.angles)[:, ::-1]),
        disturbances=[_mirrored_disturbance(d) for d in scene.disturbances],
        initial=_mirrored_initial(scene.initial),
    )


class Units:
    """Other units of length, mass and time, each a power of two, so that every product is exact."""

    def __init__(self, length: int, mass: int, time: int) -> None:
        self.length, self.mass, self.time = 2.0**length, 2.0**mass, 2.0**time

    def of(self, length: int = 0, mass: int = 0, time: int = 0) -> float:
        """The factor of a quantity with these dimensions."""
        return self.length**length * self.mass**mass * self.time**time

    @property
    def coordinates(self) -> Floats:
        a = self.length
        return np.array([a, a, 1, 1, 1, a, a, a, a])

    def _fields(self, record: Any, **dimensions: tuple[int, int, int]) -> Any:
        values = {name: getattr(record, name) for name in dimensions}
        return replace(
            record,
            **{
                name: value * self.of(*dimensions[name])
                for name, value in values.items()
                if value is not None
            },
        )

    def _finger(self, finger: sp.Finger) -> Any:
        length = (1, 0, 0)
        return self._fields(
            finger,
            length=length,
            root_offset=length,
            half_thickness=length,
            mass=(0, 1, 0),
            inertia=(2, 1, 0),
        )

    def _tip(self, tip: sp.Fingertip) -> Any:
        drag = (0, 1, -1)
        return self._fields(
            tip,
            radius=(1, 0, 0),
            youngs_modulus=(-1, 1, -2),
            normal_viscosity=drag,
            tangential_viscosity=drag,
            normal_mass=(0, 1, 0),
            tangential_mass=(0, 1, 0),
        )

    def _each(self, value: Any, one: Any) -> Any:
        return tuple(map(one, value)) if isinstance(value, tuple) else one(value)

    def _disturbance(self, disturbance: Any) -> Any:
        changes: dict[str, Any] = {}
        for name, dimensions in {
            "time": (0, 0, 1),
            "times": (0, 0, 1),
            "duration": (0, 0, 1),
            "frequency_hz": (0, 0, -1),
            "rate_hz": (0, 0, -1),
            "force_std": (1, 1, -2),
            "moment_std": (2, 1, -2),
            "force": (1, 1, -2),
            "moment": (2, 1, -2),
            "impulse": (1, 1, -1),
            "angular_impulse": (2, 1, -1),
        }.items():
            value = getattr(disturbance, name, None)
            if value is not None:
                scaled = np.asarray(value) * self.of(*dimensions)
                changes[name] = (
                    scaled
                    if isinstance(value, np.ndarray)
                    else (tuple(scaled) if isinstance(value, tuple) else float(scaled))
                )
        return replace(disturbance, **changes)

    def scene(self, scene: sp.Scene) -> sp.Scene:
        """The same scene in these units."""
        hand = scene.hand
        changes: dict[str, Any] = {"times": np.asarray(scene.schedule.times) * self.time}
        if scene.schedule.move_time is not None:
            changes["move_time"] = scene.schedule.move_time * self.time
        gains = {"kp": (2, 1, -2), "kd": (2, 1, -1), "ki": (2, 1, -3)}
        return replace(
            scene,
            hand=replace(
                hand,
                right=self._finger(hand.right),
                left=self._finger(hand.left),
                tip=self._each(hand.tip, self._tip),
            ),
            grasped=self._fields(
                scene.grasped,
                width=(1, 0, 0),
                mass=(0, 1, 0),
                inertia=(2, 1, 0),
                com_offset=(1, 0, 0),
                height=(1, 0, 0),
            ),
            control=self._each(scene.control, lambda pid: self._fields(pid, **gains)),
            schedule=replace(scene.schedule, **changes),
            disturbances=[self._disturbance(d) for d in scene.disturbances],
            gravity=scene.gravity * self.of(1, 0, -2),
            duration=scene.duration * self.time,
            initial=self._initial(scene.initial),
        )

    def _initial(self, initial: Any) -> Any:
        if not isinstance(initial, sp.State):
            return initial
        return replace(
            initial,
            q=np.asarray(initial.q) * self.coordinates,
            p=np.asarray(initial.p) * self.coordinates / self.time,
            integral=np.asarray(initial.integral) * self.time,
            time=initial.time * self.time,
        )


def require_scaled(run: sp.Run, other: sp.Run, units: Units) -> None:
    """The other run is that of the same scene in other units, to the bit."""
    assert other.status == run.status
    rate = units.coordinates / units.time
    pairs = {
        "t": units.time,
        "q": units.coordinates,
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
