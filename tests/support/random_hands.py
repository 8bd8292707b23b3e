"""Random hands that hold an object at rest, and where the energy around their rests has a minimum.

`python tests/support/random_hands.py 1000` prints the numbers of docs/model.md.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import softpinch as sp
from softpinch.reproduce.rests import Rest, coordinates, family_slope, rest_at

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
        bound: How far the pose may still be from the rest in x, y (m) and theta (rad), (3,): what
            the slowest motion makes of the last speed, with a factor of two for the other motions.
    """

    run: sp.Run
    rest: Rest
    bound: np.ndarray


def settle(scene: sp.Scene) -> sp.Run:
    return sp.simulate(scene, dt=2e-4, formulation="nullspace", record=("state",), every=1000)


def settled(count: int, seed: int = SEED) -> Iterator[Settled | str]:
    """For each of `count` random hands its rest, or the status of a run that loses the object."""
    for child in np.random.SeedSequence(seed).spawn(count):
        scene = random_scene(np.random.default_rng(child))
        run = settle(scene)
        if not run.success:
            yield run.status
            continue
        rest = rest_at(scene, run.q[-1], float(run.t[-1]))
        slowest = np.abs(rest.found.eigenvalues[2:].real).min() if rest.found.state else np.nan
        yield Settled(run, rest, 2.0 * np.abs(run.p[-1]).max() / slowest)
