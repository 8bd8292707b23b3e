"""MuJoCo and Drake on the reference problems with jaws.

The hand is that of the problems: a cube of the same size, mass and friction between two balls of
20 mm on fingers with the same mass and the same drives, in a plane. The tips are not: both
simulators have contacts of their own, which yield by their own laws; in some settings MuJoCo's hand
has the paper's tips between jaws and contacts (tips.py). The fingers close until each presses with
the normal force of the problem at rest, without the weight and with it. A load on the cube is the
acceleration of the carriage that has the same effect in the hand.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import carry
import carry_peers
import softpinch as sp
from carry_peers import Peer
from creep import FACE, FRICTION, GRAVITY, MASS, STIFFNESS

from . import tips

# What MuJoCo's documentation advises against slip: elliptic cones, a large impratio and Newton's
# solver, its default, with a tolerance such as 1e-10 (Modeling, "Algorithms"); a larger impedance,
# the first two numbers of solimp (Overview, "Softness and slip"); one to three iterations of the
# noslip solver (Modeling, "Preventing slip"); a time constant of at least twice the step (Modeling,
# "Reference"). Name, options, time constant of the contacts, s, and impedance.
_FIRM = {"cone": "elliptic", "impratio": "100", "tolerance": "1e-10"}
_NOSLIP = {**_FIRM, "noslip_iterations": "3"}
MUJOCO: tuple[tuple[str, dict[str, str], float, tuple[float, float] | None], ...] = (
    ("defaults", {}, 0.02, None),
    ("elliptic, impratio 1", {**_FIRM, "impratio": "1"}, 0.02, None),
    ("elliptic, impratio 10", {**_FIRM, "impratio": "10"}, 0.02, None),
    ("elliptic, impratio 100", _FIRM, 0.02, None),
    ("elliptic, impratio 100, 4 ms", _FIRM, 0.004, None),
    ("elliptic, impratio 100, 4 ms, impedance 0.99", _FIRM, 0.004, (0.99, 0.999)),
    ("elliptic, impratio 100, 4 ms, 3 noslip iterations", _NOSLIP, 0.004, None),
)
INTEGRATORS = ("implicitfast", "discrete")
# Settings of the hand with the paper's tips. Its steps are half as long: at 2 ms, implicitfast, the
# cube of 01-rest rattles between their light surfaces, at 1 ms it rests.
PAPER_TIPS = (MUJOCO[0], MUJOCO[3], MUJOCO[6])
# The default step, and smaller ones for the chart, s.
MUJOCO_STEPS = (0.002, 0.001, 0.0005)
# Drake's approximations of contact in steps of equal length. "lagged" is the default, and what the
# documentation of DiscreteContactApproximation prefers; the stiction tolerance is that of it and of
# "similar". MultibodyPlantConfig's page says that SAP may soften stiff contacts, and to try a
# near-rigid threshold of zero then: here the creep is the same to three digits.
DRAKE: tuple[tuple[str, dict[str, Any]], ...] = (
    ("lagged (default)", {"discrete_contact_approximation": "lagged"}),
    (
        "lagged, stiction tolerance 1e-6 m/s",
        {"discrete_contact_approximation": "lagged", "stiction_tolerance": 1e-6},
    ),
    ("similar", {"discrete_contact_approximation": "similar"}),
    ("sap", {"discrete_contact_approximation": "sap"}),
)
DRAKE_STEPS = (0.001, 0.00025)
# Drake's CENIC: accuracy, of which the second is the default of its simulator, and the longest
# step, s, of which 0.1 s is the default.
CENIC = ((1e-2, 0.1), (1e-4, 0.1), (1e-6, 0.1), (1e-4, 0.001))
# How often it is asked whether the object is lost, s.
_CHECK = 0.05


@dataclass(frozen=True)
class Grip:
    """What a problem does to the hand.

    Attributes:
        share: Weight by what friction carries.
        acceleration: Of the hand at times (n,), (n, 2), m/s^2.
        changes: Until when it changes, s; it is zero, or constant, from then on.
        duration: s.
        creep: Instants between which creep is measured, s.
    """

    share: float
    acceleration: Callable[[Any], Any]
    changes: float
    duration: float
    creep: tuple[float, float]

    @property
    def force(self) -> float:
        """With which each finger presses, N."""
        return MASS * GRAVITY / (2 * FRICTION * self.share)


@dataclass(frozen=True)
class Held:
    """What became of a grip.

    Attributes:
        creep: By which the object moved along the tips, m; NaN where it was lost.
        lost: When, s, or None.
        spent: Processor time, s.
    """

    creep: float
    lost: float | None
    spent: float


def _resting(times: Any) -> Any:
    return np.zeros((len(times), 2))


def _ramp(share: float, times: Any) -> Any:
    """The hand's acceleration that loads the cube as `definitions.loaded` does."""
    up = GRAVITY * (share / 0.5 - 1) * np.clip((times - 0.1) / 0.5, 0.0, 1.0)
    return np.column_stack([np.zeros_like(up), up])


def _moved(motion: sp.HandMotion, times: Any) -> Any:
    return motion.at(times).acceleration


def grips(motion: sp.HandMotion) -> dict[str, Grip]:
    """By the name of the problem; `motion` is that of the last one."""
    return {
        "01-rest": Grip(0.1, _resting, 0.0, 100.0, (1.0, 100.0)),
        "02-rest-half": Grip(0.5, _resting, 0.0, 100.0, (1.0, 100.0)),
        "03-held": Grip(0.5, partial(_ramp, 0.9), 0.6, 20.0, (2.0, 20.0)),
        "04-lost": Grip(0.5, partial(_ramp, 1.1), 0.6, 2.0, (0.0, 2.0)),
        "20-carried-in-jaws": Grip(0.2, partial(_moved, motion), 0.7, 1.0, (0.0, 1.0)),
    }


def hold(peer: Peer, grip: Grip, duration: float | None = None) -> Held:
    """Closes the fingers, waits until the weight has settled, and holds the object."""
    carry.close(peer, grip.force)
    if _lost_at_rest(peer, grip.force):
        return Held(math.nan, 0.0, 0.0)
    start = rest = peer.height()
    duration = grip.duration if duration is None else duration
    total, changing = round(duration / peer.step), round(grip.changes / peer.step)
    first = round(min(grip.creep[0], duration) / peer.step)
    accelerations = grip.acceleration(peer.step * np.arange(total + 1)).tolist()
    chunk, k = max(round(_CHECK / peer.step), 1), 0
    begin = time.process_time()
    while k < total:
        n = 1 if k < changing else min(chunk, total - k, first - k if k < first else total)
        peer.advance(*accelerations[k], n)
        k += n
        if k == first:
            start = peer.height()
        # A tip may let go for a moment; an object that nothing holds is off the faces soon.
        if (k % chunk == 0 or k == total) and abs(peer.height() - rest) > FACE / 2:
            return Held(math.nan, k * peer.step, time.process_time() - begin)
    return Held(abs(peer.height() - start), None, time.process_time() - begin)


def _lost_at_rest(peer: Peer, force: float) -> bool:
    """Lets the weight settle for 1 s, while the targets follow until the fingers press again."""
    rest, rounds = peer.height(), 10
    for k in range(rounds):
        peer.advance(0.0, 0.0, round(1.0 / rounds / peer.step))
        if abs(peer.height() - rest) > FACE / 2:
            return True
        pressing = peer.forces()
        if k < rounds - 1 and len(pressing) == 2:
            # A tip that the weight shears presses more.
            peer.press((force - sum(normal for normal, _ in pressing) / 2) / STIFFNESS)
    return False


def peers(missing: Mapping[str, str], step: int = 0) -> list[tuple[str, Callable[[], Peer]]]:
    """Name, and what makes a peer; `step` is the number of the step, of which 0 is the default."""
    found: list[tuple[str, Callable[[], Peer]]] = []
    make: Callable[[], Peer]
    if "MuJoCo" not in missing:
        for integrator in carry_peers.mujoco_integrators(INTEGRATORS):
            for name, options, constant, impedance in MUJOCO:
                settings = {"integrator": integrator, **options}
                make = partial(
                    carry_peers.MuJoCo,
                    settings,
                    constant,
                    MUJOCO_STEPS[step],
                    impedance=impedance,
                )
                found.append((f"MuJoCo {integrator}, {name}", make))
            for name, options, constant, _ in PAPER_TIPS:
                settings = {"integrator": integrator, **options}
                make = partial(tips.PaperTips, settings, constant, MUJOCO_STEPS[step] / 2)
                found.append((f"MuJoCo {integrator}, paper's tips, {name}", make))
    if "Drake" not in missing and step < len(DRAKE_STEPS):
        for name, config in DRAKE:
            found.append((f"Drake, {name}", partial(carry_peers.Drake, config, DRAKE_STEPS[step])))
        for accuracy, longest in CENIC if step == 0 else ():
            longer = "" if longest == 0.1 else f", steps up to {1e3 * longest:g} ms"
            make = partial(carry_peers.Drake, {}, 0.001, accuracy, longest)
            found.append((f"Drake, cenic, accuracy {accuracy:g}{longer}", make))
    return found
