"""The scenes of the reference problems, from which generate.py writes the data.

Readers of the data need neither this file nor softpinch.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import softpinch as sp

FACE, MASS, FRICTION, GRAVITY = 0.049, 0.1, 0.5, 9.81  # of the cube; m, kg, -, m/s^2
# Of the drives of the jaws: N/m and N s/m. These are MuJoCo's and Drake's fingers in
# benchmarks/creep.py, too.
STIFFNESS, DAMPING = 3000.0, 30.0
OPERATIONS = [[6, 6], [20, -10], [-2, 13], [-10, 20], [-7, 17], [17, -7], [-15, 25], [5, 5]]
LIGHT = sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)


@dataclass(frozen=True)
class Problem:
    """One problem.

    Attributes:
        name: Of its folder.
        title: One line.
        statement: What happens, and why it is a test.
        scene: Everything that is given.
        rows: Number of instants with a solution.
        creep: Instants, s, between which the object's way is the creep; None where it has none.
        methods: Of the solution, and the second one.
        steps: Of both methods, s.
        oracle: SciPy's method by which tests/oracle integrates it.
    """

    name: str
    title: str
    statement: str
    scene: Callable[[], sp.Scene]
    rows: int = 51
    creep: tuple[float, float] | None = None
    methods: tuple[str, str] = ("dop853", "radau5")
    steps: tuple[float, float] = (1e-5, 1e-5)
    oracle: str = "DOP853"


def steps(*pairs: tuple[float, float], times: tuple[float, ...] = (0.0,)) -> sp.Schedule:
    """Targets of both fingers in degrees that jump."""
    return sp.Schedule.in_degrees("steps", times, pairs)


def grasp(**changes: Any) -> sp.Scene:
    """The paper's fingers hold the cube at 6 degrees with light tips."""
    usual: dict[str, Any] = {
        "contact": "unilateral",
        "friction": FRICTION,
        "hand": sp.Hand(tip=LIGHT),
        "grasped": sp.GraspedObject.box(FACE, FACE, MASS),
        "schedule": steps((6, 6)),
        "duration": 0.05,
    }
    return sp.Scene(**usual | changes)


@cache
def at_rest(degrees: float) -> sp.State:
    """The state in which `grasp` has come to rest."""
    scene = grasp(schedule=steps((degrees, degrees)), duration=10.0)
    run = sp.simulate(scene, tolerance=1e-12, method="radau5", formulation="projected")
    state = run.state(-1)
    return sp.State(state.q, np.zeros(9), integral=state.integral)


def rested(degrees: float = 6.0, **changes: Any) -> sp.Scene:
    """`grasp`, which begins at rest."""
    schedule = steps((degrees, degrees))
    return grasp(**{"initial": at_rest(degrees), "schedule": schedule} | changes)


def jaws(share: float, **changes: Any) -> sp.Scene:
    """The cube between two jaws, at rest; its weight is this share of what friction carries."""
    jaw = sp.Jaw(root_offset=0.1, half_thickness=0.01, mass=0.1, height=0.0)
    scene = grasp(
        hand=sp.Hand(right=jaw, left=jaw, tip=LIGHT),
        control=sp.Pid(kp=STIFFNESS, kd=DAMPING, ki=0.0),
        schedule=sp.Schedule.steps([0.0], [[0.05, 0.05]]),
    )
    held = sp.grip(scene, force=MASS * GRAVITY / (2 * FRICTION * share))
    state = held.equilibrium.state
    assert state is not None
    start = sp.State(state.q, np.zeros(9))
    return held.scene.with_({"initial": start, **changes})


# The load on the jaws of "held" and "lost": a ramp of half a second.
RAMP = (0.1, 0.6)


def loaded(share: float, duration: float) -> sp.Scene:
    """Jaws whose load grows from half of what friction carries to a share of it."""
    down = MASS * GRAVITY * (share / 0.5 - 1)
    ramp = sp.Sampled(
        times=[0.0, *RAMP], force=[[0.0, 0.0], [0.0, 0.0], [0.0, -down]], hold="linear"
    )
    return jaws(0.5, disturbances=[ramp], duration=duration)


def dropped() -> sp.Scene:
    """Both tips off the object and on their way to it, one slower and with more to go."""
    scene = grasp(friction=(0.3, 0.4), duration=0.06)
    start = sp.State.consistent(scene, fingers=np.deg2rad([-0.6, -0.8]))
    q, p = start.q.copy(), np.zeros(9)
    q[5:7] = 0.0
    p[3:5] = 1.0, 1.5
    return scene.with_({"initial": sp.State(q, p)})


def carried(way: tuple[float, float], leg: float, **changes: Any) -> sp.Scene:
    """A grasp that an arm moves by 50 mm and, after a pause, back."""
    times = [0.05, 0.05 + leg, 0.15 + leg, 0.15 + 2 * leg]
    there = [0.05 * way[0], 0.05 * way[1]]
    points = [[0.0, 0.0], there, there, [0.0, 0.0]]
    motion = sp.HandMotion.minimum_jerk(times, points)
    return rested(2.0, motion=motion, duration=0.25 + 2 * leg, **changes)


def carried_in_jaws() -> sp.Scene:
    """The cube between jaws that an arm moves 50 mm sideways and up, and back."""
    times, there = [0.1, 0.3, 0.5, 0.7], [0.04, 0.03]
    motion = sp.HandMotion.minimum_jerk(times, [[0.0, 0.0], there, there, [0.0, 0.0]])
    return jaws(0.2, motion=motion, duration=1.0)


def bottle() -> sp.Scene:
    """Jaws close on a disc and hold it against a push."""
    jaw = sp.Jaw(root_offset=0.062, mass=0.15)
    return sp.Scene(
        contact="unilateral",
        friction=0.7,
        hand=sp.Hand(right=jaw, left=jaw, tip=LIGHT),
        grasped=sp.GraspedObject.disc(diameter=0.07, mass=0.3),
        control=sp.Pid(kp=2e4, kd=200.0, ki=2e5),
        schedule=sp.Schedule.steps([0.0], [[0.004, 0.005]]),
        disturbances=[sp.Pulse(time=0.1, duration=0.02, force=(0.0, -2.0), moment=0.01)],
        initial="touching",
        duration=0.2,
    )


def wedge() -> sp.Scene:
    """Parallel links hold a wedge, which a push turns."""
    link = sp.Parallelogram()
    return sp.Scene(
        hand=sp.Hand(right=link, left=link, tip=LIGHT),
        grasped=sp.GraspedObject.wedge(0.05, 0.06, 0.1, 0.1),
        schedule=steps((6, 5)),
        disturbances=[sp.Pulse(time=0.12, duration=0.01, force=(3.0, 0.0), moment=0.05)],
        initial="touching",
        duration=0.25,
    )


def relaxing() -> sp.Scene:
    """Jaws whose tips relax hold the cube against a push that makes it slip."""
    tip = sp.Fingertip(
        relaxation=sp.Maxwell(share=0.5, time=0.03), normal_mass=0.01, tangential_mass=0.01
    )
    push = sp.Pulse(time=0.02, duration=0.02, force=(1.0, -8.0), moment=0.01)
    scene = jaws(0.2, disturbances=[push], duration=0.2)
    return scene.with_({"hand": sp.Hand(right=scene.hand.right, left=scene.hand.left, tip=tip)})


def measured() -> sp.Scene:
    """Tips whose force has been measured at six compressions."""
    compression = np.linspace(1e-3, 6e-3, 6)
    force = np.array([1.0, 4.2, 9.8, 18.1, 29.5, 44.2])
    law = sp.MeasuredLaw(compression, force)
    hand = sp.Hand(tip=sp.Fingertip(law=law, normal_mass=0.01, tangential_mass=0.01))
    push = sp.Pulse(time=0.05, duration=0.01, force=(10.0, -5.0), moment=0.02)
    return sp.Scene(hand=hand, schedule=steps((6, 5)), disturbances=[push], duration=0.1)


def overdamped() -> sp.Scene:
    """Tips so viscous, and so light, that their rates decay within 0.1 microseconds."""
    tip = sp.Fingertip(
        normal_mass=1e-3, tangential_mass=1e-3, normal_viscosity=1e4, tangential_viscosity=1e4
    )
    return sp.Scene(hand=sp.Hand(tip=tip), schedule=steps((6, 5)), duration=0.1)


def push(x: float, y: float, moment: float = 0.0) -> list[sp.Disturbance]:
    return [sp.Pulse(time=0.015, duration=0.01, force=(x, y), moment=moment)]


PROBLEMS = (
    Problem(
        "01-rest",
        "A cube at rest between two jaws for 100 s",
        "Two jaws hold a cube whose weight is 10 % of what friction carries. Nothing happens: the "
        "start is the equilibrium. Whatever moves, creeps.",
        lambda: jaws(0.1, duration=100.0),
        rows=41,
        creep=(1.0, 100.0),
        steps=(1e-4, 1e-4),
        oracle="Radau",
    ),
    Problem(
        "02-rest-half",
        "The same cube at half of the friction limit for 100 s",
        "As 01-rest, with a grip that is five times lighter.",
        lambda: jaws(0.5, duration=100.0),
        rows=41,
        creep=(1.0, 100.0),
        steps=(1e-4, 1e-4),
        oracle="Radau",
    ),
    Problem(
        "03-held",
        "A load that grows to 0.9 of the friction limit is held",
        "A force pulls the cube of 02-rest-half down. It grows within half a second from zero "
        "until weight and force together are 0.9 of what friction carries.",
        lambda: loaded(0.9, 20.0),
        creep=(2.0, 20.0),
        steps=(1e-4, 1e-4),
        oracle="Radau",
    ),
    Problem(
        "04-lost",
        "A load that grows to 1.1 of the friction limit pulls the cube out",
        "As 03-held, with 1.1 instead of 0.9. The cube slips on both tips until they reach the "
        "ends of its faces; there the problem ends.",
        lambda: loaded(1.1, 2.0),
    ),
    Problem(
        "05-operations",
        "The paper's eight operations with its own contact",
        "The targets of both fingers jump every second. The contact is the paper's, bilateral.",
        lambda: sp.Scene(
            schedule=steps(*OPERATIONS, times=tuple(map(float, range(8)))), duration=8.0
        ),
        rows=81,
    ),
    Problem(
        "06-operations-friction",
        "Three of the operations with friction and light tips",
        "Targets jump while tips slip, open and meet the object again.",
        lambda: grasp(schedule=steps(*OPERATIONS[:3], times=(0.0, 0.3, 0.6)), duration=0.9),
        rows=61,
    ),
    Problem(
        "07-smooth",
        "Smooth moves of the fingers with the paper's contact",
        "Targets move by minimum jerk.",
        lambda: sp.Scene(
            schedule=sp.Schedule.in_degrees(
                "minimum_jerk", [0.0, 0.5, 1.0], [[6, 6], [14, -3], [4, 8]], move_time=0.4
            ),
            duration=1.5,
        ),
    ),
    Problem(
        "08-smooth-friction",
        "Smooth moves that friction carries",
        "As 07-smooth, with tips that could slip and do not. The end of the first move depends on "
        "the way there, because rolling without slip is not integrable.",
        lambda: rested(
            schedule=sp.Schedule.in_degrees(
                "minimum_jerk", [0.0, 0.1], [[6, 6], [9, 3]], move_time=0.3
            ),
            duration=0.6,
        ),
    ),
    Problem(
        "09-driven",
        "Fingers that follow their targets exactly",
        "The fingers have no dynamics: their angles are given functions of time.",
        lambda: grasp(
            fingers="driven",
            schedule=sp.Schedule.in_degrees(
                "minimum_jerk", [0.0, 0.3], [[5, 5], [10, 1]], move_time=0.25
            ),
            initial=sp.State.consistent(
                grasp(schedule=steps((5, 5))), fingers=np.deg2rad([5.0, 5.0])
            ),
            duration=0.7,
        ),
    ),
    Problem(
        "10-slip",
        "A push that makes the cube slip, and recovery",
        "A push of 10 ms downwards: both tips slip, and stick again.",
        lambda: rested(disturbances=push(0.0, -80.0), duration=0.08),
    ),
    Problem(
        "11-turn-and-slip",
        "A push that turns the cube and makes it slip",
        "As 10-slip with a moment, so that the tips slip at different times.",
        lambda: rested(friction=0.4, disturbances=push(0.0, -40.0, 2.0), duration=0.08),
    ),
    Problem(
        "12-open",
        "A push that opens a contact, an impact, and recovery",
        "A push of 10 ms to the right: the left tip slips, grazes, leaves the cube and meets it "
        "again. Heavy tips, as the paper has them.",
        lambda: rested(disturbances=push(150.0, 0.0), duration=0.1),
    ),
    Problem(
        "13-knocked-out",
        "A push that knocks the cube out",
        "The push is so hard that a tip comes to the end of a face.",
        lambda: rested(disturbances=push(0.0, -120.0), duration=0.2),
    ),
    Problem(
        "14-impact",
        "Both fingers meet a free cube",
        "The fingers fly towards the cube with different speeds: impacts without restitution, "
        "slip in both directions, and stick.",
        dropped,
    ),
    Problem(
        "15-impulse",
        "An ideal impulse on the cube",
        "Velocities jump by a given impulse, which both contacts answer at once.",
        lambda: rested(
            disturbances=[sp.Impulse(time=0.02, impulse=(0.1, -0.3), angular_impulse=0.002)],
            duration=0.08,
        ),
    ),
    Problem(
        "16-viscous",
        "Stiff viscous tips",
        "Tips of 1 g with 10^4 N s/m: rates decay within 0.1 microseconds.",
        overdamped,
        methods=("radau5", "rosenbrock"),
        steps=(1e-6, 1e-6),
        oracle="Radau",
    ),
    Problem(
        "17-light",
        "A light object",
        "An object of 1 g, whose mass is the mass of the tips, too.",
        lambda: sp.Scene(
            grasped=sp.GraspedObject(mass=1e-3, inertia=4e-7), schedule=steps((6, 5)), duration=0.1
        ),
    ),
    Problem(
        "18-carried",
        "A grasp that an arm carries up and back",
        "An arm moves the hand by 50 mm in 0.1 s upwards and back; friction carries it.",
        lambda: carried((0.0, 1.0), 0.1),
    ),
    Problem(
        "19-carried-slip",
        "A grasp that an arm carries too fast",
        "As 18-carried, in half the time: the cube slips on both tips.",
        lambda: carried((0.6, 0.8), 0.06),
    ),
    Problem(
        "20-carried-in-jaws",
        "A cube between jaws that an arm carries sideways and up, and back",
        "As 18-carried with the jaws of 01-rest, which press half as hard: the weight is 20 % of "
        "what friction carries.",
        carried_in_jaws,
        creep=(0.0, 1.0),
    ),
    Problem(
        "21-disc",
        "Jaws close on a disc, and a push turns it",
        "The sides of the object are arcs.",
        bottle,
    ),
    Problem(
        "22-wedge",
        "Parallel links hold a wedge",
        "The faces of the object are not parallel.",
        wedge,
    ),
    Problem(
        "23-measured",
        "Tips whose force was measured",
        "The law of the tips is fitted to a table; a push of 10 ms shakes the object.",
        measured,
    ),
    Problem(
        "26-relaxing",
        "Tips that relax",
        "A Maxwell branch beside the springs of each tip meets a push of 20 ms, under which the "
        "cube slips. At the start the branches have relaxed.",
        relaxing,
    ),
)
BY_NAME = {problem.name: problem for problem in PROBLEMS}
