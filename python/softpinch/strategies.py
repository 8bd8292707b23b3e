"""Hypothesis strategies for scenes and their parts. Needs the extra `testing`.

    from hypothesis import given
    import softpinch as sp
    from softpinch import strategies

    @given(strategies.scenes(duration=0.1))
    def test_every_run_ends_with_a_status_and_keeps_the_constraints(scene):
        sp.simulate(scene).check(residual=1e-3, closure=1e-2)

Examples shrink towards the default `Scene()`. Parameters are the default values times 10**u with
|u| <= `spread`, so `spread` is in decades. Most drawn times lie within the scene's `duration`, s.
The repr of an example shows only changed values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import accumulate
from typing import Any, TypeVar

import numpy as np

from .scene import Pid, Scene, Stabilization, State, outline, usual
from .scene.disturbance import DISTURBANCES, Disturbance, Impulse, Noise, Pulse, Sampled, Sine, Step
from .scene.hand import Finger, Fingertip, GraspedObject, Hand, links
from .scene.motion import MOTIONS, HandMotion
from .scene.parts import Arc, Face, Jaw, Parallelogram, PowerLaw, lever
from .scene.schedule import HOLDS, KINDS, Schedule
from .support import ContactModel, Fingers, require

require("hypothesis", extra="testing", purpose="softpinch.strategies")

from hypothesis import assume, reject  # noqa: E402
from hypothesis import strategies as st  # noqa: E402
from hypothesis.strategies import DrawFn, SearchStrategy  # noqa: E402

T = TypeVar("T")
# Both finger angles in the paper's operation 1, degrees.
_HELD = 6.0
# About the distance of the object from the hand's origin, m, and the largest tilt at rest, rad.
_ARM, _TILT = 0.1, 0.5


@st.composite
def _number(draw: DrawFn, least: float, of: Callable[[float], float]) -> float:
    """Numbers `of` a share from `least` to 1; with `map`, the text of `of` would be printed."""
    # Single precision keeps drawn values so large that their products do not underflow in doubles.
    return of(draw(st.floats(least, 1.0, width=32, allow_subnormal=False)))


@cache
def _within(limit: float) -> SearchStrategy[float]:
    """Numbers from -limit to limit that shrink to 0."""
    return _number(-1.0, lambda share: limit * share) if limit else st.just(0.0)


@cache
def _between(low: float, high: float) -> SearchStrategy[float]:
    """Numbers from low to high that shrink to low."""
    return _number(0.0, lambda share: low + (high - low) * share)


@cache
def _scaled(value: float, spread: float) -> SearchStrategy[float]:
    """Numbers within `spread` decades of `value` that shrink to it."""
    return _number(-1.0, lambda u: value * 10.0 ** (spread * u)) if spread else st.just(value)


def _near(draw: DrawFn, paper: Any, names: Sequence[str], spread: float) -> dict[str, Any]:
    """Numbers of a record, each drawn within `spread` decades of the paper's value."""
    return {name: draw(_scaled(getattr(paper, name), spread)) for name in names}


def _one_or_pair(one: SearchStrategy[T], symmetric: bool) -> SearchStrategy[T | tuple[T, T]]:
    return one if symmetric else st.one_of(one, st.tuples(one, one))


@st.composite
def fingers(draw: DrawFn, spread: float = 0.3) -> Finger:
    """Fingers with independently drawn parameters."""
    names = ("length", "root_offset", "half_thickness", "mass", "inertia")
    return Finger(**_near(draw, Finger(), names, spread))


@st.composite
def fingertips(
    draw: DrawFn,
    spread: float = 0.3,
    tilt_couplings: Sequence[float] = (1.0, 0.0, -1.0),
    own_masses: bool = True,
) -> Fingertip:
    """Fingertips with independently drawn parameters.

    Args:
        tilt_couplings: Possible values of kappa; examples shrink to the first.
        own_masses: Whether a tip may have its own masses instead of the object's.
    """
    mass = st.none()
    masses = st.one_of(mass, _scaled(GraspedObject().mass, spread)) if own_masses else mass
    names = ("radius", "youngs_modulus", "normal_viscosity", "tangential_viscosity")
    return Fingertip(
        **_near(draw, Fingertip(), names, spread),
        tilt_coupling=draw(st.sampled_from(list(tilt_couplings))),
        normal_mass=draw(masses),
        tangential_mass=draw(masses),
    )


@st.composite
def hands(draw: DrawFn, spread: float = 0.3, symmetric: bool = False) -> Hand:
    """Hands, of equal fingers and tips if `symmetric`, that may not reach an object.

    `scenes` adjusts the roots so that they do.
    """
    right = draw(fingers(spread))
    left = right if symmetric else draw(st.one_of(st.just(right), fingers(spread)))
    return Hand(right=right, left=left, tip=draw(_one_or_pair(fingertips(spread), symmetric)))


@st.composite
def grasped_objects(draw: DrawFn, spread: float = 0.3, offset: float = 0.2) -> GraspedObject:
    """Grasped objects, with a height or without, and an inertia that mass and faces allow.

    `offset` is the largest distance from the middle to the centre of gravity, in widths.
    """
    paper = GraspedObject()
    width, mass = draw(_scaled(paper.width, spread)), draw(_scaled(paper.mass, spread))
    height = draw(st.one_of(st.none(), _scaled(0.02, spread)))
    least, most = usual.inertias(width, mass, height)
    inertia = min(max(draw(_scaled(paper.inertia, spread)), least), most)
    centred = GraspedObject(width=width, mass=mass, inertia=inertia, height=height)
    return replace(centred, com_offset=width * draw(_within(offset)))


@st.composite
def pids(draw: DrawFn, spread: float = 0.3) -> Pid:
    """PID gains."""
    return Pid(**_near(draw, Pid(), ("kp", "kd", "ki"), spread))


@st.composite
def stabilizations(draw: DrawFn, spread: float = 0.3) -> Stabilization:
    """Gains about 1000 1/s. RK4 is stable if gain * dt < 2.785."""
    return Stabilization(**_near(draw, Stabilization(), ("alpha", "beta"), spread))


@st.composite
def _times(draw: DrawFn, duration: float, most: int) -> list[float]:
    """At most `most` increasing times, s; examples shrink to [0.0]."""
    first = draw(_between(0.0, duration / 2))
    gaps = _between(duration / 64, duration / 2)
    return list(accumulate(draw(st.lists(gaps, max_size=most - 1)), initial=first))


@st.composite
def schedules(
    draw: DrawFn,
    duration: float = 1.0,
    largest_change: float = math.radians(10.0),
    kinds: Sequence[str] = KINDS,
    knots: int = 4,
) -> Schedule:
    """Schedules around 6 degrees for both fingers; examples shrink to constant 6 degrees.

    Args:
        largest_change: Largest difference of an angle from 6 degrees, rad.
        kinds: Possible kinds, out of `schedule.KINDS`.
        knots: Largest number of scheduled times.
    """
    kind = draw(st.sampled_from(list(kinds)))
    times = draw(_times(duration, knots))
    changes = [draw(st.tuples(*[_within(math.degrees(largest_change))] * 2)) for _ in times]
    # Millionths of a degree: examples then show degrees of few digits.
    millionths = np.trunc(1e6 * np.array(changes))
    angles = np.deg2rad((_HELD + millionths / 1e6).round(6))
    if kind == "minimum_jerk":
        shortest = min(np.diff(times), default=duration)
        return Schedule.minimum_jerk(times, angles, shortest * draw(_between(0.125, 1.0)))
    if kind == "sampled":
        return Schedule.sampled(times, angles, hold=draw(st.sampled_from(HOLDS)))
    return Schedule(kind=kind, times=np.array(times), angles=angles)  # type: ignore[arg-type]


@st.composite
def disturbances(
    draw: DrawFn,
    duration: float = 1.0,
    force: float = 1.0,
    moment: float = 0.01,
    kinds: Sequence[str] = tuple(DISTURBANCES),
) -> Disturbance:
    """Disturbances that begin within `duration`; examples shrink to a step of zero force at t = 0.

    Args:
        force, moment: Largest component of a force, N, and largest moment, N m; for noise standard
            deviations. Impulses are at most these times a 64th of the duration.
        kinds: Possible kinds, which are names in `disturbance.DISTURBANCES`.
    """
    kind = draw(st.sampled_from(list(kinds)))
    time = draw(_between(0.0, duration))
    load = st.tuples(_within(force), _within(force))
    if kind == "sampled":
        times = draw(_times(duration, 4))
        return Sampled(
            times=np.array(times),
            force=np.array([draw(load) for _ in times]),
            moment=np.array([draw(_within(moment)) for _ in times]),
            hold=draw(st.sampled_from(HOLDS)),
        )
    push, turn = draw(load), draw(_within(moment))
    common: dict[str, Any] = {"time": time, "force": push, "moment": turn}
    lasting = _between(duration / 64, duration)
    if kind == "pulse":
        return Pulse(duration=draw(lasting), **common)
    if kind == "impulse":
        x, y, angular = (duration / 64 * load for load in (*push, turn))
        return Impulse(time=time, impulse=(x, y), angular_impulse=angular)
    if kind == "sine":
        return Sine(
            frequency_hz=draw(_scaled(2.0 / duration, 1.0)),
            phase=draw(_within(math.pi)),
            duration=draw(st.one_of(st.none(), lasting)),
            **common,
        )
    if kind == "noise":
        return Noise(
            force_std=(abs(push[0]), abs(push[1])),
            moment_std=abs(turn),
            rate_hz=draw(_scaled(16.0 / duration, 1.0)),
            time=time,
            duration=draw(st.one_of(st.none(), lasting)),
            seed=draw(st.integers(0, 2**64 - 1)),
        )
    return Step(**common)


@st.composite
def motions(
    draw: DrawFn,
    duration: float = 1.0,
    acceleration: float = 5.0,
    kinds: Sequence[str] = tuple(MOTIONS),
) -> HandMotion:
    """Motions of the hand; examples shrink to one that stays at the origin.

    Args:
        acceleration: Largest component of an acceleration, m/s^2; where the hand turns, that at
            0.1 m from its origin, if it turned from rest.
        kinds: Possible kinds, which are names in `motion.MOTIONS`.
    """
    kind, pair = draw(st.sampled_from(list(kinds))), st.tuples(*[_within(acceleration)] * 2)
    if kind == "constant":
        return HandMotion.constant(draw(pair), draw(_within(_TILT)))
    if kind == "sine":
        frequency = draw(_scaled(2.0 / duration, 1.0))
        axis = draw(st.one_of(st.sampled_from(["x", "y", "tilt"]), _within(math.pi)))
        amplitude = acceleration / (math.tau * frequency) ** 2 / (_ARM if axis == "tilt" else 1.0)
        phase, tilt = draw(_within(math.pi)), draw(_within(_TILT))
        return HandMotion.sine(draw(_within(amplitude)), frequency, axis, phase, tilt)
    times = draw(_times(duration, 4))
    shortest = min(np.diff(times), default=duration)
    # Each kind of move reaches points within this distance, m, in the shortest time.
    reach = acceleration * shortest**2 / 16.0
    turns = st.lists(_within(reach / _ARM), min_size=len(times), max_size=len(times))
    more: dict[str, Any] = {"tilts": draw(st.one_of(st.just(0.0), turns))}
    if kind == "sampled" and draw(st.booleans()):
        return HandMotion.sampled(times, accelerations=[draw(pair) for _ in times], **more)
    points = [draw(st.tuples(_within(reach), _within(reach))) for _ in times]
    if kind in ("trapezoid", "jerk_limited"):
        more |= {"acceleration": acceleration}
    if kind == "jerk_limited":
        more |= {"jerk": 32.0 * acceleration / shortest}
    return getattr(HandMotion, kind)(times, points, **more)  # type: ignore[no-any-return]


@st.composite
def scenes(
    draw: DrawFn,
    spread: float = 0.3,
    duration: float = 0.5,
    symmetric: bool = False,
    most_disturbances: int = 2,
    force: float = 1.0,
    moment: float = 0.01,
    largest_change: float = math.radians(10.0),
    fingers: Fingers = "pid",
    contact: ContactModel = "bilateral",
    acceleration: float = 0.0,
) -> Scene:
    """Scenes whose start is valid: the tips touch or press the object, or close until they touch.

    The grasp may be lost during the run; with the default arguments most grasps hold.

    Args:
        symmetric: Whether hand, control, object and target angles are mirror-symmetric.
        most_disturbances: Largest number of disturbances.
        force, moment: As in `disturbances`.
        largest_change: As in `schedules`; "driven" fingers move at most twice this angle from their
            start.
        fingers: "pid", or "driven", whose schedules are smooth and begin at the start's angles.
        contact: "bilateral"; or "unilateral", always with friction. Then a tip of "pid" fingers may
            also start with a gap of up to a tenth of its radius.
        acceleration: The largest of the hand, m/s^2, as in `motions`; with 0 it stays at rest.
    """
    driven, unilateral = fingers == "driven", contact == "unilateral"
    hand = draw(hands(spread, symmetric))
    grasped = draw(grasped_objects(spread, offset=0.0 if symmetric else 0.2))
    tips = hand.tips
    starts = ["contact", "pressed", "touching", *["apart"] * (unilateral and not driven)]
    start = draw(st.sampled_from(starts))
    deepest = {"pressed": 0.3, "apart": -0.1}.get(start, 0.0)
    fitted: list[Finger] = []
    begun: list[float] = []
    for finger, tip in [(hand.right, tips[0]), (hand.left, tips[1])][: 1 if symmetric else 2]:
        assert isinstance(finger, Finger)
        angle = press = 0.0
        if start == "touching":
            # At a larger inward angle the root would have to lie beyond the middle of the hand.
            reach = tip.radius + 0.5 * grasped.width
            angle = draw(_within(0.3 * min(1.0, reach / finger.length)))
        elif deepest:
            press = tip.radius * draw(_between(0.0, deepest))
        # At this angle the tip just touches the upright object, or presses on it.
        touching = outline.inward(finger, angle) + tip.radius + 0.5 * grasped.width
        fitted.append(replace(finger, root_offset=touching - press))
        begun.append(angle)
    schedule = draw(schedules(duration, largest_change, ("minimum_jerk",) if driven else KINDS))
    if driven:
        schedule = replace(schedule, angles=schedule.angles - schedule.angles[0] + begun)
    if symmetric:
        schedule = replace(schedule, angles=schedule.angles[:, [0, 0]])
    friction = _one_or_pair(_scaled(0.5, spread), symmetric)
    pushes = st.lists(disturbances(duration, force, moment), max_size=most_disturbances)
    return Scene(
        hand=replace(hand, right=fitted[0], left=fitted[-1]),
        grasped=grasped,
        control=draw(_one_or_pair(pids(spread), symmetric)),
        schedule=schedule,
        disturbances=tuple(draw(pushes)),
        duration=duration,
        initial="touching" if start == "touching" and not driven else None,
        friction=draw(friction if unilateral else st.one_of(st.none(), friction)),
        fingers=fingers,
        contact=contact,
        motion=draw(motions(duration, acceleration)) if acceleration else None,
    )


@st.composite
def _arcs(draw: DrawFn, sign: float) -> Arc:
    """Arcs about as far from the centre of gravity as the sides of the default object."""
    radius = draw(_between(0.02, 0.2))
    across = sign * (draw(_between(0.022, 0.027)) - radius)
    counterface = draw(st.sampled_from(["cylinder", "sphere", "flat"]))
    return Arc(radius, (across, draw(_within(5e-3))), counterface=counterface)


@st.composite
def other_hands(
    draw: DrawFn, duration: float = 0.03, laws: bool = True, contact: ContactModel = "bilateral"
) -> Scene:
    """Scenes with any mechanisms, sides and laws, whose fingers press on a pushed object.

    Lengths, masses and gains are near the default values; the run starts where the tips touch.
    Examples shrink towards links, faces and parallel springs. With `laws` a tip may have a
    `PowerLaw`; in "unilateral" `contact` the coefficient of friction is 0.8.
    """
    angle = _within(0.1)
    kinds = st.one_of(
        st.builds(Finger),
        st.builds(Jaw, direction=_within(0.2), angle=angle),
        st.builds(Parallelogram, angle=angle),
    )
    law = st.builds(
        PowerLaw,
        coefficient=st.just(1.64e5),
        exponent=_between(1.6, 2.5),
        foot=_between(1e-4, 1e-3),
        shear_factor=_between(0.5, 1.0),
    )
    fingers = [draw(kinds) for _ in (0, 1)]
    faces = st.one_of(st.none(), st.builds(Face, tilt=angle))
    right, left = (draw(st.one_of(faces, _arcs(sign))) for sign in (1.0, -1.0))
    tips = [Fingertip(law=draw(st.one_of(st.none(), law)) if laws else None) for _ in fingers]
    jaw = Pid(kp=2e4, kd=200.0, ki=2e5)
    gains = [jaw if isinstance(finger, Jaw) else Pid() for finger in fingers]
    scene = Scene(
        hand=Hand(right=fingers[0], left=fingers[1], tip=(tips[0], tips[1])),
        grasped=GraspedObject(com_offset=draw(_within(3e-3)), right=right, left=left),
        control=(gains[0], gains[1]),
        disturbances=[Pulse(time=0.3 * duration, duration=0.3 * duration, force=(3.0, 2.0))],
        duration=duration,
        initial="touching",
        friction=0.8 if contact == "unilateral" else None,
        contact=contact,
    )
    closed = outline.closing(scene, draw(_between(1e-3, 6e-3)))
    if closed is None:
        reject()
    return replace(scene, schedule=Schedule.steps([0.0], [closed]))


@st.composite
def consistent_states(
    draw: DrawFn,
    scene: Scene,
    compression: float = 0.5,
    shear: float = 0.25,
    rotation: float = math.radians(15.0),
    offset: float = 0.5,
    speed: float = 0.5,
    rate: float = 5.0,
) -> State:
    """States that satisfy the constraints of a scene, with both tips in contact with the object.

    The object's pose, compressions, shears and velocities are drawn; the finger angles follow from
    (9). Examples shrink to an upright object at rest in point contact.

    Args:
        scene: The scene whose geometry is used.
        compression, shear: Largest d_n and largest |d_t|, as shares of the tip's radius.
        rotation: Largest |theta|, rad.
        offset: Largest distance of the object from its start in the scene, in each of x and y, as
            a share of the smaller tip's radius.
        speed: Largest speed of the object in each of x and y, m/s.
        rate: Largest angular rate of the object and of each finger, rad/s.
    """
    hand, grasped = links(scene, "consistent_states"), scene.grasped
    tips = scene.hand.tips
    here = State.consistent(scene).q
    reach = offset * min(tip.radius for tip in tips)
    x, y = here[0] + draw(_within(reach)), here[1] + draw(_within(reach))
    theta = draw(_within(rotation))
    angles = []
    for sign, finger, tip in zip(outline.SIGNS, hand, tips, strict=True):
        d_n = tip.radius * draw(_between(0.0, compression))
        # With (7, 8), (9) becomes L sin(theta_p) + d_f cos(theta_p) = span. Solve it for theta_i.
        along = sign * (x * math.cos(theta) + y * math.sin(theta))
        faces = tip.radius - d_n + 0.5 * grasped.width + sign * grasped.com_offset
        span = along + finger.root_offset * math.cos(theta) - faces
        assume(abs(span) < 0.95 * lever(finger))
        tilt = outline.angle_at(finger.length, finger.half_thickness, span)
        assert tilt is not None
        angles.append(tilt - sign * theta)
    return State.consistent(
        scene,
        x=x,
        y=y,
        rotation=theta,
        fingers=angles,
        shear=[tip.radius * draw(_within(shear)) for tip in tips],
        velocity=[draw(_within(speed)), draw(_within(speed)), draw(_within(rate))],
        finger_rates=[draw(_within(rate)), draw(_within(rate))],
    )
