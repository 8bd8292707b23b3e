"""Unilateral contact in a hand that moves, in inertial coordinates, as `moving` has them.

Between two events SciPy integrates absolute places and angles, whose roots are driven; the masses
and the forces of motion and weight are those that SymPy derives there. Events, modes and impacts
are seen from the hand's frame, in which faces and tips are: the law of impact is about jumps of
velocity, and these are the same along the axes of any frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import Any

import numpy as np

from softpinch.accuracy.segments import Driven, Inputs

from .contact_modes import FREE, GRAZE, Motion, conditions, contact_forces
from .contact_system import Contact, ContactSystem, Event
from .contact_terms import Floats, Terms
from .moving import Bodies, Inertial, frames

# Where `MovingInputs` has the frame.
_FRAME = slice(5, 14)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    return x * cos(angle) - y * sin(angle), x * sin(angle) + y * cos(angle)


class MovingInputs(Inputs):
    """Inputs that end with the nine numbers of the frame; the motion's jumps are edges, too.

    The forces are along fixed axes, the impulses along those of the hand.
    """

    def __init__(self, scene: Any, begin: float, end: float) -> None:
        """As `Inputs`."""
        self._motion = scene.motion
        super().__init__(scene.with_({"motion": None}), begin, end)
        for t in self._motion.breakpoints(begin, end).tolist():
            if all(abs(t - edge) > self._near for edge in self.edges):
                self.edges.append(t)
        self.edges.sort()
        for t, (x, y, moment) in self.impulses.items():
            phi = frames(self._motion, t, self.edges[self.edges.index(t) + 1])(t)[0, 2]
            self.impulses[t] = (*_turned(x, y, -phi), moment)

    def between(self, left: float, right: float) -> Driven:
        """As `Inputs.between`, with nine more values."""
        usual, frame = super().between(left, right), frames(self._motion, left, right)
        return lambda t: (*usual(t), *frame(t).ravel().tolist())


@dataclass(frozen=True, eq=False)
class MovingTerms:
    """`Terms` without weight, and the same system in inertial coordinates."""

    own: Terms
    inertial: Inertial

    def __getattr__(self, name: str) -> Any:
        return getattr(self.own, name)


class MovingMechanics:
    """`Mechanics` or `PartsMechanics` of a hand that moves: the weight is part of `Inertial`.

    Attributes:
        bodies: Of the scene.
    """

    def __init__(self, scene: Any, weightless: Any) -> None:
        """Takes the mechanics of the same scene without a motion and without gravity."""
        self.bodies, self._weightless = Bodies.of(scene), weightless

    def __getattr__(self, name: str) -> Any:
        return getattr(self._weightless, name)

    def terms(self, state: Sequence[float], asked: Sequence[float], tilts: Sequence[float]) -> Any:
        """The terms at a state in the hand's frame."""
        frame = np.array(asked[_FRAME]).reshape(3, 3)
        w, v = self.bodies.absolute(np.array(state[:9]), np.array(state[9:18]), frame)
        return self.of(state, asked, tilts, self.bodies.at(w, v, frame))

    def of(
        self,
        state: Sequence[float],
        asked: Sequence[float],
        tilts: Sequence[float],
        inertial: Inertial,
    ) -> Any:
        """The terms at a state that is known in both frames."""
        (*target, fx, fy, moment), phi = asked[:5], asked[7]
        load = (*_turned(fx, fy, -phi), moment)
        return MovingTerms(self._weightless.terms(state, (*target, *load), tilts), inertial)


class MovingSystem(ContactSystem):
    """`ContactSystem` whose accelerations are those of absolute coordinates."""

    mechanics: Any  # MovingMechanics
    rtol = 1e-12

    def motion(self, terms: Any, modes: Sequence[str], asked: Sequence[float]) -> Motion:
        """The motion in given modes, in the hand's frame."""
        return self.accelerations(terms, modes)[1]

    def accelerations(self, terms: Any, modes: Sequence[str]) -> tuple[Floats, Motion]:
        """The rates of the absolute velocities, and the motion that this is in the hand's frame."""
        system: Inertial = terms.inertial
        force = terms.force
        for i, mode in enumerate(modes):
            if mode not in (FREE, GRAZE):
                force = force + terms.couple_column(i)
        rows, columns = conditions(terms.phi, modes, self.friction, terms)
        n = len(rows)
        k = np.array(columns).reshape(n, 9).T
        phi = terms.phi[rows]
        whole = np.zeros((9 + n, 9 + n))
        whole[:9, :9] = system.mass
        whole[:9, 9:] = -system.jacobian.T @ k
        whole[9:, :9] = phi @ system.jacobian
        right = [system.force + system.jacobian.T @ force, -terms.b[rows] - phi @ system.bias]
        try:
            found = np.linalg.solve(whole, np.concatenate(right))
        except np.linalg.LinAlgError:
            return np.zeros(9), Motion(np.zeros(9), [0.0] * 4, [0.0, 0.0], force, False)
        multipliers, psi = contact_forces(found[9:], modes, self.friction)
        p_rate = system.jacobian @ found[:9] + system.bias
        return found[:9], Motion(p_rate, multipliers.tolist(), psi, force + k @ found[9:], True)

    def go(
        self, begin: float, end: float, y: Floats, driven: Driven, contact: Contact, first: float
    ) -> tuple[float, Floats, list[Event], float]:
        """As `ContactSystem.go`, in absolute coordinates."""
        flight = _Flight(self)
        frame = np.array(driven(begin)[_FRAME]).reshape(3, 3)
        placed = self.mechanics.bodies.absolute(y[:9], y[9:18], frame)
        start = np.concatenate([*placed, y[18:]])
        t, y, events, step = flight.go(begin, end, start, driven, contact, first)
        return t, flight.relative(y, driven(t))[0], events, step


class _Flight(ContactSystem):
    """The states of a system in absolute coordinates (25,), between two events."""

    def __init__(self, system: MovingSystem) -> None:
        self.__dict__.update(vars(system))
        self._system = system

    def relative(self, y: Floats, asked: Sequence[float]) -> tuple[Floats, Inertial]:
        """The states in the hand's frame (25,)."""
        frame = np.array(asked[_FRAME]).reshape(3, 3)
        found = self._system.mechanics.bodies.at(y[:9], y[9:18], frame)
        return np.concatenate([found.q, found.p, y[18:]]), found

    def watch(self, y: Floats, asked: Sequence[float], contact: Contact) -> list[Event]:
        return self._system.watch(self.relative(y, asked)[0], asked, contact)

    def rates(self, y: Floats, asked: Sequence[float], contact: Contact) -> Floats:
        """The rates of the states."""
        seen, inertial = self.relative(y, asked)
        state = seen[:20].tolist()
        mechanics = self._system.mechanics
        tilts = contact.tilts(mechanics.tilts(state))
        terms = mechanics.of(state, asked, tilts, inertial)
        acceleration, found = self._system.accelerations(terms, contact.modes)
        result = self.rates_of(seen, terms, found, asked, contact)
        result[:9], result[9:18] = y[9:18], acceleration
        return result
