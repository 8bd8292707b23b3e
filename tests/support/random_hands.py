"""Random hands that hold an object at rest, and where the energy around their rests has a minimum.

`python tests/support/random_hands.py 1000` prints the numbers of docs/model.md.
"""

import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

import softpinch as sp
from softpinch.reproduce.energy_minimum import Rest, coordinates, rest_at
from softpinch.reproduce.verdict import is_minimum

SEED = 19
# Long enough for the slowest of these hands to settle, s.
DURATION = 4.0


def random_scene(rng: np.random.Generator) -> sp.Scene:
    """Two different fingers and tips, an object, gains and targets, all drawn at random.

    Lengths, masses and moduli vary by factors up to 1.5 and 2 about the default values. The fingers
    begin where the tips touch the object, and press it at once.
    """

    def scaled(value: float, factor: float) -> float:
        return float(value * factor ** rng.uniform(-1.0, 1.0))

    def finger() -> sp.Finger:
        usual = sp.Finger()
        return sp.Finger(
            length=scaled(usual.length, 1.3),
            half_thickness=scaled(usual.half_thickness, 1.5),
            mass=scaled(usual.mass, 1.5),
        )

    def tip() -> sp.Fingertip:
        usual = sp.Fingertip()
        return sp.Fingertip(
            radius=scaled(usual.radius, 1.2),
            youngs_modulus=scaled(usual.youngs_modulus, 2.0),
            normal_viscosity=scaled(usual.normal_viscosity, 2.0),
            tangential_viscosity=scaled(usual.tangential_viscosity, 2.0),
            tilt_coupling=float(rng.choice([1.0, 0.0, -1.0])),
        )

    usual = sp.GraspedObject()
    width = scaled(usual.width, 1.2)
    press, turn = rng.uniform(3.0, 8.0), rng.uniform(-12.0, 12.0)
    return sp.Scene(
        hand=sp.Hand(right=finger(), left=finger(), tip=(tip(), tip())),
        grasped=sp.GraspedObject(
            width=width,
            mass=scaled(usual.mass, 2.0),
            inertia=scaled(usual.inertia, 1.5),
            com_offset=width * rng.uniform(-0.1, 0.1),
        ),
        # The operation begins at once, so that the object does not fall.
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[press + turn, press - turn]])),
        initial="touching",
        duration=DURATION,
    )


@dataclass(frozen=True)
class Settled:
    """A run that has come to rest, and its rest.

    Attributes:
        run: The run.
        rest: The rest, and the energy around it.
        bound: How far each coordinate may still be from the rest (9,), m or rad: the slowest
            motion, which decays as exp(-s t), still goes |p| / s, with the largest |p| of all
            lengths or of all angles. A factor of two is for the other motions.
    """

    run: sp.Run
    rest: Rest
    bound: np.ndarray


def settle(scene: sp.Scene) -> sp.Run:
    return sp.simulate(scene, dt=2e-4, formulation="nullspace", record=("state",), every=1000)


def settled(count: int, seed: int = SEED) -> Iterator[Settled | str]:
    """The rests of `count` random hands, and between them the statuses of those that lost it."""
    found, root = 0, np.random.SeedSequence(seed)
    while found < count:
        (child,) = root.spawn(1)
        scene = random_scene(np.random.default_rng(child))
        run = settle(scene)
        if not run.success:
            yield run.status
            continue
        found += 1
        rest = rest_at(scene, run.q[-1], float(run.t[-1]))
        slowest = np.abs(rest.found.eigenvalues[2:].real).min() if rest.found.state else np.nan
        angles = np.isin(np.arange(9), (2, 3, 4))
        speed = np.abs(run.p[-1])
        fastest = np.where(angles, speed[angles].max(), speed[~angles].max())
        # Round-off is a share of the coordinates themselves.
        yield Settled(run, rest, 2.0 * fastest / slowest + 1e-13)


def equilibria(count: int, seed: int = SEED) -> Iterator[sp.Equilibrium]:
    """Equilibria of random hands with very soft tips that hold the object anywhere.

    Many of them hold it too far below its centre of gravity, so that it would topple.
    """
    found, root = 0, np.random.SeedSequence(seed)
    while found < count:
        (child,) = root.spawn(1)
        rng = np.random.default_rng(child)
        scene = random_scene(rng)
        softer = 10.0 ** rng.uniform(-2.5, -1.0)
        right, left = (
            replace(tip, youngs_modulus=softer * tip.youngs_modulus) for tip in scene.hand.tips
        )
        scene = replace(scene, hand=replace(scene.hand, tip=(right, left)))
        held = sp.equilibrium(scene, grip=rng.uniform(-0.05, 0.05, 2))
        if held.state is not None:
            found += 1
            yield held


def survey(count: int) -> str:
    """Facts about `count` rests, and about as many equilibria, in words."""
    drawn = list(settled(count))
    rests = [each for each in drawn if isinstance(each, Settled)]
    lost = Counter(each for each in drawn if isinstance(each, str))
    off = [np.abs(each.rest.q - each.run.q[-1]) for each in rests]
    within = sum(bool((moved <= each.bound).all()) for moved, each in zip(off, rests, strict=True))
    minima = [is_minimum(each.rest) for each in rests]
    raised = [coordinates(each.rest.weightless)[1] - each.rest.q[1] for each in rests]
    kinds = Counter((each.stable, each.minimum) for each in equilibria(count))
    lines = [
        f"{len(drawn)} random hands: {len(rests)} come to rest, "
        + ", ".join(f"{number} end {status}" for status, number in sorted(lost.items())),
        f"equilibrium(scene, near=run) within what the last speed explains: {within}",
        f"farthest from it: {1e6 * max(moved[:2].max() for moved in off):.2g} um and "
        f"{1e3 * np.rad2deg(max(moved[2] for moved in off)):.2g} mdeg",
        f"stable: {sum(each.rest.found.stable for each in rests)}; minimum of elastic energy and "
        f"gravity without slip: {sum(minima)}",
        "smallest second derivative: "
        f"{1e-3 * min(each.rest.curvature for each in rests):.1f} N/mm; smallest by theta: "
        f"{min(each.rest.turning for each in rests):.2f} N m/rad",
        f"minimum of elastic energy alone, higher by: {1e3 * min(raised):.3f} to "
        f"{1e3 * max(raised):.3f} mm",
        f"{count} equilibria of soft hands: stable and minimum {kinds[True, True]}, neither "
        f"{kinds[False, False]}, only stable {kinds[True, False]}, only minimum "
        f"{kinds[False, True]}",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    warnings.simplefilter("ignore", sp.SuspiciousValueWarning)
    print(survey(int(sys.argv[1]) if len(sys.argv) > 1 else 1000))
