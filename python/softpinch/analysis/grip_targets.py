"""`grip`, which finds the targets to which the fingers must close to press with a given force."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..scene import Scene, Schedule
from ..scene.control import WRITTEN, Pid, pids_of
from ..scene.outline import closing
from ..scene.parts import in_words, jaws, others
from ..support import SIDES, Floats, Result, checks
from .rest import Equilibrium, equilibrium

# Statuses of fingers that close too little, and too far, to hold the object at rest.
_LOOSE = ("apart", "separated", "overloaded", "slipping", "pulling")
_TIGHT = ("crushed", "folded")
# Relative error at which the search ends; round-off of the equilibrium is far below it.
_CLOSE = 1e-11
_HELD = 1e-6
_MOST_STEPS = 200
# The change of the angle that tells whether the force grows with it, rad.
_STEP = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Grip(Result):
    """The targets of the fingers that press on the object with a given force at rest.

    Attributes:
        targets: The targets of the fingers (2,), right and left, rad, or m of a jaw.
        force: The mean of lambda_1^H and lambda_2^H at rest, N; `compression` is of d_n1, d_n2, m.
        equilibrium: The rest under these targets, without disturbances.
        scene: The scene with a schedule that holds these targets.
    """

    targets: Floats
    force: float
    compression: float
    equilibrium: Equilibrium
    scene: Scene

    def __repr__(self) -> str:
        targets = in_words(self.scene, self.targets, ".4f", same=False)
        rest = f"compression {1e3 * self.compression:.6g} mm; {self.equilibrium.message}"
        return f"<Grip of {self.force:.6g} N: targets {targets}, {rest}>"

    def _picture(self) -> str:
        return self.equilibrium._picture()


def grip(scene: Scene, force: float | None = None, compression: float | None = None) -> Grip:
    """Finds the targets with which the fingers press on the object so hard at rest.

    Both fingers stand at the same angle at rest; where parts are not the paper's, where they would
    compress both tips alike on an upright object. A PID with K_I stands at its targets, so both
    targets are this angle; without K_I each target is ahead of the finger by torque / K_P. In the
    `equilibrium` both tips hold the object at the height of its centre of gravity.

    Rests form a family, so a run that does not start at `equilibrium.state` may settle in another
    one with another force: of alike fingers within about 2 % of it, of tips with unlike radii
    within 3 %, and of fingers of unlike length or root offset 10 % to 30 % off at a few newtons.

        >>> import softpinch as sp
        >>> held = sp.grip(sp.Scene(), force=5.0)
        >>> held
        <Grip of 5 N: targets 1.7301 and 1.7301 degrees, compression 2.299 mm; at rest, stable>
        >>> run = sp.simulate(held.scene)

    Args:
        scene: The scene. Its schedule and its start are not used, and its disturbances do not act
            on the rest.
        force: The mean of lambda_1^H and lambda_2^H, N, which differ only by horizontal forces.
        compression: The mean of the compressions d_n1 and d_n2, m, instead of `force`.

    Raises:
        ValueError: No equilibrium has this force (the message has the nearest one, and why there is
            no other), or the fingers have no target angles (`Torque()`, `SampledController`, or a
            PID without K_P and K_I).
    """
    checks.instance("scene", scene, Scene)
    if (force is None) == (compression is None):
        raise ValueError("force and compression: give one of them, N or m")
    name, unit = ("force", "N") if compression is None else ("compression", "m")
    wanted = checks.positive(name, force if compression is None else compression)
    _require_targets(scene)
    # Driven fingers stand at their angles, whatever the gains.
    still = replace(scene, disturbances=(), initial=None)
    found = _Search(replace(still, fingers="driven", control=Pid()), name, unit, wanted).run()
    assert found.state is not None
    targets = np.array(found.state.q[3:5])
    if scene.law == "pid":
        for k, pid in enumerate(pids_of(scene.control)):
            if pid.ki == 0.0:
                targets[k] += found.torque[k] / pid.kp
    schedule = Schedule.steps([0.0], [targets])
    # Fingers without K_I yield, and the same targets may have another rest.
    rest = equilibrium(replace(still, schedule=schedule), 0.0, near=found.state)
    if rest.state is None:
        raise ValueError(f"{name} = {wanted:g} {unit}: {rest.message}")
    held = _size(rest, name)
    if abs(held - wanted) > _HELD * wanted:
        raise ValueError(
            f"{name} = {wanted:g} {unit}: the fingers yield (K_I = 0), and with the targets of "
            f"this grip the search finds another rest, of {held:.4g} {unit}; a larger K_P or a K_I "
            "leaves one"
        )
    return Grip(
        targets=targets,
        force=_size(rest, "force"),
        compression=_size(rest, "compression"),
        equilibrium=rest,
        scene=replace(scene, schedule=schedule),
    )


def _require_targets(scene: Scene) -> None:
    """Refuses fingers without target angles, or whose angles do not depend on them."""
    if scene.law in ("torque", "sampled"):
        rule = "grip finds target angles, which these fingers do not have"
        raise ValueError(f"Scene.{WRITTEN[scene.law]}: {rule}")
    for side, pid, jaw in zip(SIDES, pids_of(scene.control), jaws(scene), strict=True):
        moves = "travel moves the jaw" if jaw else "angle turns the finger"
        if scene.law == "pid" and pid.kp == 0.0 and pid.ki == 0.0:
            raise ValueError(f"Scene.control.{side}: kp and ki are zero, so no target {moves}")


def _size(rest: Equilibrium, name: str) -> float:
    assert rest.state is not None
    pair = rest.multipliers[:2] if name == "force" else rest.state.q[5:7]
    return float(np.mean(pair))


class _Search:
    """The search for one angle of both fingers, between touching and crushing the tips.

    The force grows with the angle from its least value on; looser grips, whose tips carry the
    weight by large shears, which press too (6), are left out.
    """

    def __init__(self, scene: Scene, name: str, unit: str, wanted: float) -> None:
        self.scene, self.name, self.wanted = scene, name, wanted
        self.unit, self.asked = unit, f"{name} = {wanted:g} {unit}"
        touching = closing(scene, 0.0)
        if touching is None:
            place = "position" if others(scene) else "angle"
            raise ValueError(f"scene: no {place} of the fingers brings the tips to the object")
        depth = 0.5 * sum(tip.radius for tip in scene.hand.tips)
        # Other parts than the paper's are searched by the depth of both tips, not by an angle.
        self.by_depth = bool(others(scene))
        high = closing(scene, depth)
        # Where no angle crushes the tips, fingers may close up to a right angle.
        self.ends = [touching[0], 0.5 * math.pi if high is None else high[0]]
        if self.by_depth:
            self.ends = [0.0, depth]
        # At each end: the size there, if it is known, and the state at rest or why there is none.
        self.sizes: list[float | None] = [0.0 if name == "compression" else None, None]
        self.rests: list[Equilibrium | None] = [None, None]

    def run(self) -> Equilibrium:
        """Returns the equilibrium with the wanted size, or says why there is none."""
        width = math.inf
        for _ in range(_MOST_STEPS):
            low, high = self.ends
            # The secant, or the middle where it is not known or the last step was slow.
            angle, (below, above) = 0.5 * (low + high), self.sizes
            slow, width = high - low > 0.5 * width, high - low
            if below is not None and above is not None and below < self.wanted and not slow:
                angle = low + width * (self.wanted - below) / (above - below)
            if not low < angle < high:
                break
            if self._targets(angle) is None:
                # Beyond the fingers' reach, which ends before the tips are crushed.
                self.ends[1], self.sizes[1], self.rests[1] = angle, None, None
                continue
            size, rest = self._rest_at(angle)
            if size is not None and abs(size - self.wanted) <= _CLOSE * self.wanted:
                return rest
            too_tight = rest.status in _TIGHT
            if size is not None and size > self.wanted:
                # Too tight if the size grows with the angle, or the tips are crushed.
                after, beyond = self._rest_at(angle + _STEP)
                too_tight = beyond.status in _TIGHT if after is None else after >= size
            self.ends[too_tight], self.sizes[too_tight] = angle, size
            self.rests[too_tight] = rest
        return self._nearest()

    def _rest_at(self, angle: float) -> tuple[float | None, Equilibrium]:
        """The equilibrium with both fingers at an angle, and its size, None where there is none."""
        # The step beyond an angle may leave the fingers' reach.
        targets = self._targets(angle) or self._targets(angle - _STEP)
        assert targets is not None
        schedule = Schedule.steps([0.0], [targets])
        rest = equilibrium(replace(self.scene, schedule=schedule), 0.0)
        if rest.state is not None:
            return _size(rest, self.name), rest
        if rest.status not in _LOOSE + _TIGHT:
            # No other angle removes the reason.
            raise ValueError(f"{self.asked}: at {self._place(angle)} {rest.message}")
        return None, rest

    def _targets(self, angle: float) -> tuple[float, float] | None:
        """The fingers' coordinates at an angle, or at a depth; None if they do not reach it."""
        return closing(self.scene, angle) if self.by_depth else (angle, angle)

    def _place(self, angle: float) -> str:
        targets = self._targets(angle)
        assert targets is not None
        return in_words(self.scene, targets)

    def _nearest(self) -> Equilibrium:
        """Returns an end of the interval that is close enough, or says why there is none."""
        words = [f"{self.asked}: no grip at rest has it"]
        below, above = self.sizes
        if above is not None and (below is None or below > self.wanted):
            words = [f"{self.asked}: no grip at rest has so little {self.name}; the least is"]
            words[0] += f" {above:.4g} {self.unit}"
        for angle, size, rest in zip(self.ends, self.sizes, self.rests, strict=True):
            if rest is None:
                continue
            if size is not None and abs(size - self.wanted) <= _HELD * self.wanted:
                return rest
            there = rest.message if size is None else f"it is {size:.4g} {self.unit}"
            words.append(f"at {self._place(angle)} {there}")
        raise ValueError("; ".join(dict.fromkeys(words)))
