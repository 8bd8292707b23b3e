"""The energy of a carried hand in fixed axes, beside the work of the arm that carries it.

Vectors of the plane are complex numbers, x + i y. Momenta and energies of the bodies are written by
hand, from the recorded coordinates and the motion of the frame. No force of inertia is among them,
and the ledger's `kinetic`, `external_work` and `motion_work` are not used.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from core.test_moving_oracle import UNLIKE

TRAPEZOID, WAY = sp.HandMotion.trapezoid, [[0.1, 0.2], [0.13, 0.22]]
LOAD = sp.Step(force=(1.0, -2.0), time=0.01, moment=0.01)
LINKS = replace(UNLIKE, disturbances=[LOAD])
JAW = LINKS.with_({"hand.right": sp.Jaw(height=0.075, direction=0.2, mass=0.11),
                   "control": (sp.Pid(kp=2000.0, kd=20.0), sp.Pid()),
                   "schedule": sp.Schedule.steps([0.0], [[0.02, 0.12]])})  # fmt: skip
GRASP = LINKS.with_({"contact": "unilateral", "friction": (0.4, 0.6), "grasped.height": 0.049,
                     "schedule": sp.Schedule.steps([0.0], [[0.105, 0.105]])})  # fmt: skip
SCENES = {
    "minimum jerk": (LINKS, sp.HandMotion.minimum_jerk([-0.01, 0.07], WAY, [0.3, 0.9])),
    "sine": (LINKS, sp.HandMotion.sine(0.3, 10.0, "tilt", phase=0.3, tilt=0.1)),
    "jaw": (JAW, TRAPEZOID([0.0033, 0.0533], WAY, 80.0, [0.2, 0.8])),
    "slip": (replace(GRASP, friction=0.2), TRAPEZOID([0.0053, 0.0553], WAY, 150.0, [0.2, 0.8])),
    "impact": (GRASP, TRAPEZOID([0.0093, 0.0433], WAY, 400.0, [0.2, 1.2])),
}
# Gauss's rule on a panel from -1/2 to 1/2; over many panels its error has the order 6.
NODES, WEIGHTS = (x / 2 for x in np.polynomial.legendre.leggauss(3))


def product(a: Any, b: Any) -> Any:
    return np.conj(a) * b  # the scalar product, and i times the cross product


def simulated(name: str, refined: int) -> tuple[sp.Run, Any]:
    """A run with rows at the ends of panels and at three nodes within, and the panels' widths."""
    still, motion = SCENES[name]
    scene = replace(still, motion=motion)
    how: dict[str, Any] = {"tolerance": 1e-12, "method": "dop853"}
    changes = [change.time for change in sp.simulate(scene, **how).contact_changes]
    jumps = [*scene.schedule.times, LOAD.time, *motion.breakpoints(0.0, scene.duration), *changes]
    ends = np.zeros(1)
    for a, b in pairwise(np.unique([0.0, *jumps, scene.duration])):
        if b - a > 1e-9:  # else they are the same but for round-off
            panels = refined * int(np.ceil((b - a) / 2e-3))
            ends = np.append(ends, np.linspace(a, b, panels + 1)[1:])
    inner = (ends[1:] + ends[:-1]) / 2 + np.multiply.outer(NODES, np.diff(ends))
    how |= {"times": np.sort([*ends, *inner.flat]), "record": ("state", "energy", "multipliers")}
    run = sp.simulate(scene, **how)
    assert run.status == "completed" and len(run.t) == 4 * len(ends) - 3
    return run, np.diff(ends)


def bodies(run: sp.Run) -> Any:
    """Masses, inertias, places, rates and spins in the hand: of object, right and left finger."""
    q, p, grasped, hand = run.q.T, run.p.T, run.scene.grasped, run.scene.hand
    found = [(grasped.mass, grasped.inertia, q[0] + 1j * q[1], p[0] + 1j * p[1], p[2])]
    for z, w, s, finger in zip(q[3:5], p[3:5], (-1, 1), (hand.right, hand.left), strict=True):
        if isinstance(finger, sp.Jaw):
            way = s * np.cos(finger.direction) + 1j * np.sin(finger.direction)
            link = s * finger.half_thickness + 1j * finger.height + way * z
            turns, about = 0.0, 0.0
        else:
            link = 1j * finger.length * np.exp(-1j * s * z)
            way, turns, about = -1j * s * link, -s, finger.inertia - finger.mass * finger.length**2
        found.append((finger.mass, about, link - s * finger.root_offset, way * w, turns * w))
    return (np.stack([x + np.zeros(len(run.t)) for x in each]) for each in zip(*found, strict=True))


def by_tips(run: sp.Run) -> tuple[Any, Any]:
    """Force along fixed axes and moment (n,) of the tips on the object, without impulses."""
    stuck, found = replace(run.scene, contact="bilateral"), []
    for t, q, p, forces in zip(run.t, run.q, run.p, run.multipliers, strict=True):
        at = sp.evaluate(stuck, float(t), q, p)
        found.append((at.forces.elastic + at.constraint_matrix.T @ forces)[:3])
    x, y, moment = np.transpose(found)
    return (x + 1j * y) * np.exp(1j * run.hand.tilt), moment


def gaps(run: sp.Run, width: Any) -> Any:
    """The largest errors of the energy, as shares of the arm's largest work, found in two ways.

    The arm accelerates bodies of momentum P, whose moment about the frame's origin is H, and bears
    their weight. At the frame's rates V and omega, the power of dP/dt and dH/dt + V x P is the rate
    of P V + H omega, less P dV/dt + H domega/dt - omega V x P: so neither accelerations nor the
    impulses of impacts are needed. First the object is one of these bodies, and its load is borne
    as well. Then the fingers alone are, and the arm bears what the tips exert on the object: there
    a force on the object that is wrong shows even if it has no power in the hand, as Coriolis's.
    """
    scene, hand, ledger, late = run.scene, run.hand, run.energy, run.t > LOAD.time
    load, twist, omega = complex(*LOAD.force) * late, LOAD.moment * late, hand.tilt_rate
    at, v, a = (x @ [1, 1j] for x in (hand.position, hand.velocity, hand.acceleration))
    mass, inertia, place, rate, spin = bodies(run)
    away, spin = place * np.exp(1j * hand.tilt), spin + omega
    velocity = v + (rate + 1j * omega * place) * np.exp(1j * hand.tilt)
    linear, angular = mass * velocity, product(away, mass * velocity).imag + inertia * spin
    # Torques, pressure, viscosity and friction act between bodies of the same frame, equal and
    # opposite. So their works are by relative rates alone: they are the ledger's in any frame.
    energy = ledger.elastic + ledger.viscous_loss + ledger.friction_loss + ledger.impact_loss
    energy -= ledger.controller_work + ledger.constraint_work + ledger.relaxation_work
    energy += (mass * abs(velocity) ** 2 / 2 + inertia * spin**2 / 2).sum(axis=0)
    energy += (mass * scene.gravity * (at + away).imag).sum(axis=0)
    # The tips' masses, here the object's, are those of internal coordinates (14): no momentum.
    energy += scene.grasped.mass * (run.p[:, 5:] ** 2).sum(axis=1) / 2

    def integral(power: Any) -> Any:
        return np.cumsum(WEIGHTS @ np.stack([power[k::4] for k in (1, 2, 3)]) * width)

    given, errors = integral(product(load, velocity[0]).real + twist * spin[0]), []
    for first, push, couple in ((0, -load, -twist), (1, *by_tips(run))):
        p, h = linear[first:].sum(axis=0), angular[first:].sum(axis=0)
        power = omega * product(v, p).imag - product(p, a).real - h * hand.tilt_acceleration
        power += (scene.gravity * mass * (v + 1j * omega * away).imag)[first:].sum(axis=0)
        power += product(push, v).real + omega * (product(away[0], push).imag + couple)
        moved = product(p, v).real + h * omega
        arm = (moved - moved[0])[4::4] + integral(power)
        errors.append(np.abs((energy - energy[0])[4::4] - arm - given).max() / np.abs(arm).max())
    return np.array(errors)


@pytest.mark.parametrize("name", SCENES)
def test_the_energy_in_fixed_axes_is_what_arm_motors_and_load_give(name: str) -> None:
    """Panels half as wide leave a 64th of the gap, that of Gauss's rule: no work is missing."""
    coarse, fine = (simulated(name, refined) for refined in (2, 4))
    assert (fine[0].energy.friction_loss[-1] > 1e-3) == (name in ("slip", "impact"))
    assert (fine[0].energy.impact_loss[-1] > 1e-3) == (name == "impact")
    ways = 1 if name == "impact" else 2  # the tips' forces are without their impulses
    wide, narrow = gaps(*coarse)[:ways], gaps(*fine)[:ways]
    assert np.all(narrow < 1e-8) and np.all(narrow < wide / 32), (wide, narrow)
