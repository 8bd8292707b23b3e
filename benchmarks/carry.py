"""A grasp moved back and forth 1000 times within its friction cone: softpinch, MuJoCo and Drake.

make bench-carry
"""

import math
import time
from bisect import bisect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import carry_peers
import softpinch as sp
from carry_peers import Peer
from command import parser
from creep import FACE, FRICTION, GRAVITY, MASS, SETTLING, STEP, STIFFNESS
from machine import describe, without_mujoco

GRIP = 2.0  # degrees
DISTANCE = 0.05  # m, of a move one way
PAUSE = 2.0  # s, after each number of moves whose result is printed
COUNTS = (1, 10, 100, 1000)
CHECK = 50  # steps, after which a peer is asked whether it has lost the object
# Name, direction, and duration of one way, s.
MOVES = (
    ("none", (0.0, 0.0), 0.1),
    ("horizontal", (1.0, 0.0), 0.1),
    ("vertical", (0.0, 1.0), 0.1),
    ("oblique", (0.8, 0.6), 0.1),
    ("oblique, slow", (0.8, 0.6), 0.4),
)
OURS = (("rosenbrock, dt = 1 ms", "rosenbrock", 1e-3), ("radau5, dt = 2 ms", "radau5", 2e-3))
# Integrators, of which older versions lack the second; then options and time constant (s) of the
# contacts. What MuJoCo's chapter on modelling advises: elliptic cones, a large impratio, then up to
# three iterations of noslip against slipping, and 4 to 10 ms for contacts that are crisp.
INTEGRATORS = ("implicitfast", "discrete")
FIRM = {"cone": "elliptic", "impratio": "100"}
CONTACTS: tuple[tuple[str, dict[str, str], float], ...] = (
    ("defaults", {}, 0.02),
    ("elliptic cones", {"cone": "elliptic"}, 0.02),
    ("elliptic cones, impratio 100", FIRM, 0.02),
    ("the same, contacts of 4 ms", FIRM, 0.004),
    ("the same, 3 noslip iterations", {**FIRM, "noslip_iterations": "3"}, 0.004),
)
# Drake's approximations of contact. Its default is "lagged", whose slip at the edge of the cone is
# the stiction tolerance; "sap" chooses its own regularisation.
DRAKE: tuple[tuple[str, dict[str, Any]], ...] = (
    ("lagged (default)", {"discrete_contact_approximation": "lagged"}),
    (
        "lagged, stiction tolerance 1e-6 m/s",
        {"discrete_contact_approximation": "lagged", "stiction_tolerance": 1e-6},
    ),
    ("sap", {"discrete_contact_approximation": "sap"}),
)

Floats: TypeAlias = NDArray[np.float64]


@dataclass
class Journey:
    """Moves back and forth with their pauses, which start at `SETTLING`.

    Attributes:
        motion: Of the hand.
        ends: When each move is over, s.
        marks: When the pauses are over, s.
    """

    motion: sp.HandMotion
    ends: list[float]
    marks: list[float]


@dataclass
class Carried:
    """Where moves left the object.

    Attributes:
        heights: In the hand (counts,) at each mark, less that before the first move, m; NaN once
            the object is lost.
        cone: Largest friction force during the first move, by what friction carries.
        lost: Number of moves after which the object had left the tips, or None.
        spent: Processor time, s.
    """

    heights: Floats
    cone: float
    lost: int | None
    spent: float


def grasp() -> sp.Scene:
    return sp.Scene(
        contact="unilateral",
        friction=FRICTION,
        hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
        grasped=sp.GraspedObject.box(FACE, FACE, MASS),
        schedule=sp.Schedule.in_degrees("steps", [0.0], [[GRIP, GRIP]]),
        duration=SETTLING,
    )


def journey(way: tuple[float, float], leg: float, counts: tuple[int, ...], pause: float) -> Journey:
    times, points = [SETTLING], [(0.0, 0.0)]
    ends, marks = [], []
    for n in range(1, counts[-1] + 1):
        begin = times[-1]
        ends.append(begin + 2 * leg)
        times += [begin + leg, ends[-1]]
        points += [(DISTANCE * way[0], DISTANCE * way[1]), (0.0, 0.0)]
        if n in counts:
            marks.append(ends[-1] + pause)
            times.append(marks[-1])
            points.append((0.0, 0.0))
    return Journey(sp.HandMotion.minimum_jerk(times, points), ends, marks)


def ours(there: Journey, settled: sp.State, method: str, dt: float) -> Carried:
    """The moves by softpinch.

    Raises:
        RuntimeError: A tip slips.
    """
    marks = there.marks
    scene = grasp().with_(
        {"initial": settled, "motion": there.motion, "duration": marks[-1] - SETTLING}
    )
    options: dict[str, Any] = {"dt": dt, "method": method}
    first = scene.with_({"duration": marks[0] - SETTLING})
    forces = sp.simulate(first, **options, record=("multipliers",)).multipliers
    cone = float((np.abs(forces[:, 2:]) / (FRICTION * forces[:, :2])).max())
    begin = time.process_time()
    run = sp.simulate(scene, **options, times=marks, record=("state", "contact"))
    spent = time.process_time() - begin
    if not run.holds or run.contact_changes:
        raise RuntimeError(f"the grasp did not stick: {run.status}, {run.contact_changes}")
    return Carried(run.q[:, 1] - settled.q[1], cone, None, spent)


def close(peer: Peer, grip: float) -> None:
    """Closes a peer's fingers until they press with the grip, N, and leaves the hand at rest.

    The fingers close without weight, in a flight upwards at whose top the hand comes to rest:
    contacts that creep would lose the object before they press.
    """
    rounds = 20
    steps = round(SETTLING / rounds / peer.step)
    peer.throw(GRAVITY * rounds * steps * peer.step)
    peer.press(grip / STIFFNESS)
    for _ in range(rounds):
        peer.advance(0.0, -GRAVITY, steps)
        # The contact yields: the targets follow until the fingers press as they should.
        pressing = sum(normal for normal, _ in peer.forces()) / 2
        peer.press((grip - pressing) / STIFFNESS)


def theirs(peer: Peer, there: Journey, grip: float) -> Carried:
    """The moves by a peer, whose fingers press as ours do."""
    close(peer, grip)
    instants = [round((t - SETTLING) / peer.step) for t in there.marks]
    accelerations = there.motion.at(SETTLING + peer.step * np.arange(instants[-1])).acceleration
    start, cone, lost = peer.height(), 0.0, None
    heights = np.full(len(instants), np.nan)
    begin = time.process_time()
    for step, (x, y) in enumerate(accelerations.tolist(), 1):
        peer.advance(x, y)
        if step <= instants[0]:
            cone = max([cone, *(shear / (FRICTION * n) for n, shear in peer.forces() if n > 0.0)])
        if step % CHECK == 0 and (abs(peer.height() - start) > FACE / 2 or len(peer.forces()) < 2):
            lost = bisect(there.ends, SETTLING + step * peer.step)
            break
        if step in instants:
            heights[instants.index(step)] = peer.height() - start
    return Carried(heights, cone, lost, time.process_time() - begin)


def peers(missing: Mapping[str, str]) -> list[tuple[str, Callable[[], Peer]]]:
    """Name, and what makes a peer that has not moved."""
    found: list[tuple[str, Callable[[], Peer]]] = []
    if "MuJoCo" not in missing:
        for integrator in carry_peers.mujoco_integrators(INTEGRATORS):
            for name, options, time_constant in CONTACTS:
                settings = {"integrator": integrator, **options}
                make = partial(carry_peers.MuJoCo, settings, time_constant)
                found.append((f"MuJoCo {integrator}, {name}", make))
    if "Drake" not in missing:
        found += [(f"Drake, {name}", partial(carry_peers.Drake, config)) for name, config in DRAKE]
    return found


def rows(
    there: Journey, settled: sp.State, grip: float, missing: Mapping[str, str]
) -> Iterator[tuple[str, Carried]]:
    for name, method, dt in OURS:
        yield f"softpinch, {name}", ours(there, settled, method, dt)
    for name, make in peers(missing):
        yield name, theirs(make(), there, grip)


def heading(scene: sp.Scene, name: str, way: tuple[float, float], leg: float) -> str:
    if not any(way):
        return f"no move, for as long as moves of {leg:g} s take"
    # The largest acceleration of a minimum-jerk move.
    peak = 10.0 / math.sqrt(3.0) * DISTANCE / leg**2
    limit = float(sp.carry_limits(scene, np.array([way, way]) * [[1.0], [-1.0]]).limit.min())
    return (
        f"{name}: {1e3 * DISTANCE:g} mm in {leg:g} s, and back; up to {peak:.3g} m/s^2, "
        f"{peak / limit:.0%} of the limit by carry_limits"
    )


def line(name: str, done: Carried) -> str:
    """A row: use of the cone, what the first move does, and what the others add to it."""
    along = 1e3 * done.heights
    cells = "".join(
        f"{value:10.2g}" if math.isfinite(value) else f"{'-':>10s}"
        for value in [along[0], *(along[1:] - along[0])]
    )
    lost = "" if done.lost is None else f"  lost after {done.lost} moves"
    return f"  {name:56s} {done.cone:5.0%}{cells} {done.spent:8.2f}{lost}"


def main() -> None:
    quick = parser(__doc__).parse_args().quick
    counts, pause = ((1, 2), 0.2) if quick else (COUNTS, PAUSE)
    missing = {**without_mujoco(), **carry_peers.without_drake()}
    libraries = [name for name in ("mujoco", "drake") if name not in map(str.lower, missing)]
    print(describe(libraries=libraries, missing=missing))
    scene = grasp()
    held = sp.simulate(scene, dt=1e-3, method="rosenbrock", record=("state", "multipliers"))
    grip = float(held.multipliers[-1, :2].mean())
    print(
        f"\na cube of {MASS:g} kg, friction {FRICTION:g}, pressed with {grip:.3g} N from each "
        "side\n"
        f"steps of {1e3 * STEP:g} ms in MuJoCo and {1e3 * carry_peers.DRAKE_STEP:g} ms in Drake\n"
        "cone: largest friction force during the first move, by what friction carries\n"
        "how far the object has risen in the hand, mm: by the first move, and from there to the "
        f"end of\nmore moves; read after a pause of {pause:g} s, which follows each of these "
        "numbers of moves\ntime: of the processor"
    )
    numbers = "".join(f"{count:10d}" for count in counts[1:])
    for name, way, leg in MOVES[3:4] if quick else MOVES:
        print(f"\n{heading(scene, name, way, leg)}")
        print(f"  {'moves':56s} {'cone':>5s}{'first':>10s}{numbers} {'time, s':>8s}")
        for row in rows(journey(way, leg, counts, pause), held.state(-1), grip, missing):
            print(line(*row), flush=True)


if __name__ == "__main__":
    main()
