"""The equations in given modes as SciPy takes them, what ends a mode, and the instant of that.

States (25,): q, p, the two integrals of (39), and five quadratures of the energy ledger: work of
the torques, of the external force and of the viscosity (negative), loss by friction, and what the
couples that graze leave out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.integrate
from scipy.optimize import brentq

from softpinch.accuracy.segments import Driven

from .contact_modes import FREE, GRAZE, SIGN, SLIPS, STICK, Motion, motion, orientation
from .contact_terms import Floats, Mechanics, Terms

STATES = 25
QUADRATURES = ("torque", "external", "viscous", "friction", "graze")
# How often each step is looked at: a mode may end and be fine again within a step. Fingers that are
# free or graze are so for a short time, and move fast.
_LOOKS, _MORE_LOOKS = 4, 8
# An event that starts at zero may be this much below it by rounding: m, and m/s for the slip.
_FLOOR = {"gap": 1e-13, "corner": 1e-13, "stopped": 1e-12}
# An event that counts where it comes to zero from above, and only while the next one, or the one
# before it, is negative: a tip meets the face beside it, or the end of the object from beyond.
_PARTNER = {"gap": 1, "corner": -1}
# The longest step of an explicit method, s. Radau's are long only where nothing happens.
_MAX_STEP = 2e-3
# Events within this time are one, s.
TOGETHER = 1e-12


class Event(NamedTuple):
    """The end of a mode: "cone", "stopped", "unloaded", "empty", "full", "gap", "stop", ..."""

    kind: str
    finger: int
    value: float = 0.0


@dataclass
class Contact:
    """The modes of a moment, with what belongs to them.

    Attributes:
        modes: Of both fingers.
        frozen: theta_p* of both; counts where a finger is free.
        stopped: Whether a free surface is at rest at d = 0.
    """

    modes: list[str]
    frozen: list[float]
    stopped: list[bool]

    def tilts(self, live: Sequence[float]) -> list[float]:
        """The tilts in P, of which the `live` ones are given: frozen where a finger is free."""
        return [self.frozen[i] if self.modes[i] == FREE else live[i] for i in range(2)]

    @property
    def closed(self) -> list[bool]:
        """Which fingers touch."""
        return [mode != FREE for mode in self.modes]


class ContactSystem:
    """One scene's equations of motion between events.

    Attributes:
        mechanics: Its terms.
        friction: mu of both.
        inverse: Of the masses (9,), zero for driven fingers.
        halves: Half the lengths of both sides, m; infinite where they are endless.
        driven: Whether the fingers are.
        rtol: Relative tolerance of the method.
        states: How many there are.
        implicit: Whether the method is, for long rests.
    """

    rtol = 1e-11
    states = STATES

    def __init__(
        self,
        mechanics: Mechanics,
        friction: tuple[float, float],
        halves: Sequence[float],
        *,
        length: float,
        driven: bool,
        method: str = "DOP853",
    ) -> None:
        """Computes nothing yet.

        `length` is the size of lengths, for the absolute tolerance; `method` is one of SciPy's.
        """
        self._method, self.implicit = getattr(scipy.integrate, method), method == "Radau"
        self.mechanics, self.friction = mechanics, friction
        self.inverse = 1 / mechanics.masses
        self.driven = driven
        if driven:
            self.inverse[3:5] = 0.0
        self.halves = halves
        sizes = np.ones(self.states)
        lengths = list(mechanics.lengths)
        sizes[lengths] = length
        sizes[[9 + k for k in lengths]] = length
        # Nothing depends on the quadratures.
        self._inner = [k for k in range(self.states) if not 20 <= k < STATES]
        self._increments = 1e-7 * sizes
        tolerances = 0.01 * self.rtol * sizes
        if self.implicit:
            # At rest Newton's iterations see no more than the rounding of what is stiff.
            tolerances *= 1e2
            tolerances[9:18] *= 1e2
        longest = math.inf if self.implicit else _MAX_STEP
        self._options = {"rtol": self.rtol, "atol": tolerances, "max_step": longest}

    def at(
        self, y: Floats, asked: Sequence[float], contact: Contact
    ) -> tuple[list[float], Terms, Motion]:
        """The state as floats, its terms and its motion."""
        terms = self.terms(y, asked, contact)
        return y[:20].tolist(), terms, self.motion(terms, contact.modes, asked)

    def terms(self, y: Floats, asked: Sequence[float], contact: Contact) -> Terms:
        """The terms of the mechanics, with the tilts that belong to the modes."""
        state: list[float] = y[:20].tolist()
        return self.mechanics.terms(state, asked, contact.tilts(self.mechanics.tilts(state)))

    def motion(self, terms: Terms, modes: Sequence[str], asked: Sequence[float]) -> Motion:
        """The motion in given modes; `asked` ends with the accelerations of driven fingers."""
        return motion(terms, modes, self.friction, self.inverse, asked[5:])

    def rates(self, y: Floats, asked: Sequence[float], contact: Contact) -> Floats:
        """The rates of the states (25,)."""
        _, terms, found = self.at(y, asked, contact)
        return self.rates_of(y, terms, found, asked, contact)

    def rates_of(
        self, y: Floats, terms: Terms, found: Motion, asked: Sequence[float], contact: Contact
    ) -> Floats:
        """The rates of the states at which terms and motion are known already."""
        friction = graze = 0.0
        for i, mode in enumerate(contact.modes):
            if mode in SLIPS:
                friction -= found.multipliers[2 + i] * float(terms.phi[2 + i] @ y[9:18])
            elif mode == GRAZE:
                turning = float(terms.turning[i] @ y[9:18])
                graze += (1 - found.couples[i]) * terms.couples[i] * turning
        result = np.zeros(self.states)
        result[:9] = y[9:18]
        result[9:18] = found.p_rate
        result[18:20] = y[3] - asked[0], y[4] - asked[1]
        result[20:25] = (*terms.powers, friction, graze)
        if self.driven:
            torques = self.mechanics.masses[3:5] * asked[5:] - found.force[3:5]
            result[20] = torques @ y[12:14]
        return result

    def watch(self, y: Floats, asked: Sequence[float], contact: Contact) -> list[Event]:
        """All event functions of the modes; each is positive while its mode may go on."""
        state, terms, found = self.at(y, asked, contact)
        tilts, events = self.mechanics.tilts(state), []
        # How far within the ends of their sides the contacts are.
        inside = [half - abs(at) for half, at in zip(self.halves, terms.heights, strict=True)]
        for i, mode in enumerate(contact.modes):
            depth = state[5 + i]
            normal = found.multipliers[i]
            if not contact.stopped[i]:
                events.append(Event("stop", i, depth))
            if mode == FREE:
                events.append(Event("gap", i, terms.gaps[i]))
                events.append(Event("corner", i, -inside[i]))
                continue
            if mode == STICK:
                margin = self.friction[i] * normal - abs(found.multipliers[2 + i])
                events.append(Event("cone", i, margin))
            elif mode == GRAZE:
                # The share has a pole where the determinant is zero; these products have none.
                sound = orientation(terms, contact.modes, self.friction, self.inverse)
                events.append(Event("empty", i, found.couples[i] * sound))
                events.append(Event("full", i, (1 - found.couples[i]) * sound))
            else:
                events.append(Event("unloaded", i, normal))
                if self.friction[i] > 0:
                    slip = float(terms.phi[2 + i] @ y[9:18])
                    events.append(Event("stopped", i, SIGN[mode] * slip))
            events.append(Event("crushed", i, self.mechanics.radii[i] - depth))
            events.append(Event("folded", i, math.pi / 2 - abs(tilts[i])))
            events.append(Event("lost", i, inside[i]))
        if not any(contact.closed):
            events.append(Event("lost", 0, max(inside)))
        return events

    def go(
        self, begin: float, end: float, y: Floats, driven: Driven, contact: Contact, first: float
    ) -> tuple[float, Floats, list[Event], float]:
        """Goes on in the same modes to `end` or to the first event, with `first` as first step.

        Returns time, states and the events there (none at `end`), and a step to try next.
        """

        def slope(t: float, y: Floats) -> Floats:
            try:
                return self.rates(y, driven(t), contact)
            except (ArithmeticError, ValueError):
                return np.full(self.states, np.nan)

        def watched(t: float, y: Floats) -> list[Event]:
            return self.watch(y, driven(t), contact)

        def jacobian(t: float, y: Floats) -> Floats:
            # SciPy's own increments grow without bound where nothing depends on a state.
            base, found = slope(t, y), np.zeros((self.states, self.states))
            for k in self._inner:
                moved = y.copy()
                moved[k] += self._increments[k]
                found[:, k] = (slope(t, moved) - base) / self._increments[k]
            return found

        options = {"jac": jacobian, **self._options} if self.implicit else self._options

        def solver(t: float, y: Floats, bound: float, first: float | None) -> Any:
            return self._method(slope, t, y, bound, first_step=first, **options)

        run = solver(begin, y, end, min(first, end - begin) or None)
        taken, seen = [first], watched(begin, y)
        while run.status == "running":
            t_left, y_left = run.t, run.y
            run.step()
            if run.status == "failed" or not np.isfinite(run.y).all():
                raise ArithmeticError("the motion is not finite")
            taken.append(run.t - t_left)
            looks = _MORE_LOOKS if {FREE, GRAZE} & set(contact.modes) else _LOOKS
            located, seen = self._first(solver, watched, t_left, y_left, run, seen, looks)
            if located is not None:
                return (*located, 0.0)
        # The last step was cut short at the end, and says little about the next one.
        return end, run.y, [], max(taken[-2:])

    def _first(
        self,
        solver: Callable[..., Any],
        watched: Callable[[float, Floats], list[Event]],
        t_left: float,
        y_left: Floats,
        run: Any,
        before: list[Event],
        looks: int,
    ) -> tuple[tuple[float, Floats, list[Event]] | None, list[Event]]:
        """Time, states and events of the first instant within a step at which a mode ends, or None.

        The step begins at `t_left` with the event functions `before`; `run` is the solver after it.
        The event functions at the step's end are returned too.
        """
        reached: dict[float, Floats] = {t_left: y_left, run.t: run.y}

        def exact(t: float) -> Floats:
            """The states by one step of the method itself: its dense output is less accurate."""
            if t not in reached:
                short = solver(t_left, y_left, t, t - t_left)
                while short.status == "running":
                    short.step()
                reached[t] = short.y
            return reached[t]

        step = run.t - t_left
        dense = run.dense_output()
        low = t_left
        for look in range(1, looks + 1):
            high = run.t if look == looks else t_left + look / looks * step
            events = watched(high, run.y if look == looks else dense(high))
            roots = {}
            for k, (event, earlier) in enumerate(zip(events, before, strict=True)):
                floor = -_FLOOR.get(event.kind, 0.0)
                if event.value >= floor or (event.kind in _PARTNER and earlier.value < floor):
                    continue

                def value(t: float, k: int = k) -> float:
                    # At its start a mode holds, though its event may be zero there, but for
                    # rounding: that root is not the one to find.
                    return watched(t, exact(t))[k].value if t > t_left else math.inf

                if value(high) >= 0:
                    # Only the dense output is below zero, by its own error.
                    continue
                root = _root(value, low, high)
                if event.kind in _PARTNER:
                    partner = watched(root, exact(root))[k + _PARTNER[event.kind]]
                    if partner.value >= 0:
                        continue
                roots[k] = root
            if roots:
                first = min(roots.values())
                last = max(t for t in roots.values() if t <= first + TOGETHER)
                fired = [events[k] for k, t in roots.items() if t <= last]
                return (last, exact(last), fired), events
            low, before = high, events
        return None, before


def _root(value: Callable[[float], float], low: float, high: float) -> float:
    """The zero of `value`, s: positive at `low`, but for rounding, negative at `high`."""
    positive = value(low)
    if not 0 < positive < math.inf:
        positive = -value(high)
    return float(
        brentq(lambda t: value(t) if t > low else positive, low, high, xtol=1e-15, rtol=8.9e-16)
    )
