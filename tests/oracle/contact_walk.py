"""The walk through a run with unilateral contact, from event to event.

Nothing is stabilised: what closes, opens or starts to stick is put on its constraints exactly, and
the tolerance of the integrator keeps it there until the next event.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from softpinch.accuracy.segments import Driven, Inputs

from .contact_modes import (
    BORDER,
    FREE,
    GRAZE,
    ORDER,
    SLIP_DOWN,
    SLIP_UP,
    STICK,
    combinations,
    impact,
    margins,
    orientation,
)
from .contact_system import QUADRATURES, TOGETHER, Contact, ContactSystem, Event
from .contact_terms import Floats
from .lagrangian import SIDES

# Choices on a border are told apart by a step of this length, s.
_TRIAL = 1e-8
# Velocities below this are rounding, m/s.
_STILL = 1e-12
# Two contacts that open each other in turn come to both being closed, by ever smaller collisions.
# One that opens with less, in m/s, is back before its gap can be told from rounding: it stays.
_SETTLED = 1e-6
# More events than this within this time, s, are chattering.
_MOST_EVENTS, _WINDOW = 64, 1e-3
# A gap at the start below this is none, m.
_TOUCHING = 1e-12
_ENDS = {"crushed": "crushed", "folded": "folded", "lost": "lost", "corner": "lost"}


class Change(NamedTuple):
    """One finger's change of mode.

    Attributes:
        time: s.
        finger: "right" or "left".
        before: Mode: "stick", "slip+", "slip-", "graze" or "free".
        after: Mode.
    """

    time: float
    finger: str
    before: str
    after: str


class Row(NamedTuple):
    """One instant of a run; see `UnilateralReference`."""

    t: float
    q: Floats
    p: Floats
    multipliers: Floats
    modes: tuple[str, str]


@dataclass(frozen=True, eq=False)
class UnilateralReference:
    """A reference trajectory with unilateral contact.

    Attributes:
        t: Wanted instants that were reached (n,), s.
        q: (n, 9).
        p: (n, 9); at an impulse just before it.
        multipliers: (n, 4), N, just after an event or a jump; at an impulse they are of no use.
        changes: Every change of mode.
        ledger: J. Works of "torque", "external", "viscous" (negative) and "impulse"; losses
            "friction", "impact" and "stop" (positive); gains "graze" and "relaxation", of either
            sign.
        status: "completed", "crushed", "folded", "lost", "chattering", "no_mode", "not_finite".
        end: The last instant.
    """

    t: Floats
    q: Floats
    p: Floats
    multipliers: Floats
    changes: list[Change]
    ledger: dict[str, float]
    status: str
    end: Row

    @property
    def holds(self) -> bool:
        """Whether the run is completed and no finger is free at its end."""
        return self.status == "completed" and FREE not in self.end.modes


@dataclass
class Walk:
    """The way through one run.

    Attributes:
        tau: Time since `left`, the break before it, s.
        asked: The inputs at that time.
    """

    system: ContactSystem
    inputs: Inputs
    start: Floats
    changes: list[Change] = field(default_factory=list)
    status: str = ""

    def __post_init__(self) -> None:
        self.y = np.zeros(self.system.states)
        self.y[: len(self.start)] = self.start
        self.left, self.tau = self.inputs.edges[0], 0.0
        self._driven: Driven
        self._events: deque[float] = deque()
        self._booked = dict.fromkeys(("impulse", "impact", "stop", "relaxation"), 0.0)
        self.contact = Contact([FREE, FREE], self._tilts(), [False, False])

    # The run as a whole

    def through(self, wanted: Sequence[float]) -> dict[float, Row]:
        """Rows by wanted instant, as far as the run goes."""
        rows: dict[float, Row] = {}
        edges = self.inputs.edges
        self._driven = self.inputs.between(edges[0], edges[1])
        self._classify_start()
        for left, right in pairwise(edges):
            self.left, self.tau = left, 0.0
            self._driven = self.inputs.between(left, right)
            before = self.y.copy()
            if left in self.inputs.impulses:
                self._kick(self.inputs.impulses[left])
            elif left > edges[0]:
                self._choose()
            if left in wanted:
                rows[left] = self._row(before)
            stops = wanted[bisect_right(wanted, left) : bisect_left(wanted, right)]
            for stop in [*stops, right]:
                if not self.status:
                    self._advance(stop)
                if not self.status and stop < right:
                    rows[stop] = self._row(self.y)
                    if self.system.implicit:
                        self._onto_constraints()
            if self.status:
                break
        else:
            self.status = "completed"
        self.last = self._row(self.y)
        if self.status == "completed" and edges[-1] in wanted:
            rows[edges[-1]] = self.last
        self.ledger = dict(zip(QUADRATURES, self.y[20:25].tolist(), strict=True)) | self._booked
        return rows

    def _row(self, y: Floats) -> Row:
        """Positions and velocities of `y`, and forces and modes as they are now."""
        found = self.system.at(self.y, self._driven(self.time), self.contact)[2]
        right, left = self.contact.modes
        q, p = y[:9].copy(), y[9:18].copy()
        return Row(self.time, q, p, np.array(found.multipliers), (right, left))

    @property
    def time(self) -> float:
        return self.left + self.tau

    def _tilts(self) -> list[float]:
        """The tilts of both tips as they are."""
        return self.system.mechanics.tilts(self.y[:20].tolist())

    def _energy(self) -> float:
        state = self.y[:20].tolist()
        tilts = self.contact.tilts(self._tilts())
        return sum(self.system.mechanics.energies(state, tilts))

    def _terms(self) -> Any:
        return self.system.terms(self.y, self._driven(self.time), self.contact)

    def _advance(self, stop: float) -> None:
        """Goes to `stop`, through all events before it, or to the end of the run."""
        first = 0.0
        while not self.status:
            try:
                self.tau, self.y, events, first = self.system.go(
                    self.tau,
                    stop - self.left,
                    self.y,
                    lambda tau: self._driven(self.left + tau),
                    self.contact,
                    first,
                )
            except ArithmeticError:
                self.status = "not_finite"
                return
            if not events:
                return
            self._handle(events)

    def _onto_constraints(self) -> None:
        """Undoes the drift of a long rest."""
        terms = self._terms()
        for i, mode in enumerate(self.contact.modes):
            self._enter(i, mode, mode, mode != FREE, terms)

    # Events

    def _handle(self, events: Sequence[Event]) -> None:
        """Does what the events demand, and chooses the modes after them."""
        self._events.append(self.time)
        while self._events[0] < self.time - _WINDOW:
            self._events.popleft()
        if len(self._events) > _MOST_EVENTS:
            self.status = "chattering"
            return
        modes, terms = self.contact.modes, self._terms()
        before = list(modes)
        left: list[set[str]] = [set(), set()]
        hits = []
        for kind, i, _ in events:
            if kind in _ENDS:
                self.status = _ENDS[kind]
                return
            if kind == "gap":
                hits.append(i)
            elif kind == "stop":
                self._stop(i)
            elif kind == "stopped":
                left[i] = {modes[i]}
                self.y[16 + i] -= terms.phi[2 + i] @ self.y[9:18]
            else:
                left[i] = {modes[i], STICK} if kind == "unloaded" else {modes[i]}
        # A finger that comes to the face within the same instant collides with it, too.
        for i, mode in enumerate(modes):
            beside = abs(terms.heights[i]) < self.system.halves[i]
            if hits and mode == FREE and beside and i not in hits:
                approach = float(terms.phi[i] @ self.y[9:18])
                if approach < 0 and abs(terms.gaps[i]) <= -approach * TOGETHER:
                    hits.append(i)
        if hits:
            self._collide(hits)
        self._choose(before, left)

    def _stop(self, i: int) -> None:
        """The surface comes to rest at d = 0; what was closed is free."""
        masses = self.system.mechanics.masses
        for k in (5 + i, 7 + i):
            self._booked["stop"] += masses[k] * self.y[9 + k] ** 2 / 2
            self.y[k] = self.y[9 + k] = 0.0
        if self.contact.modes[i] != FREE:
            self.contact.frozen[i] = self._tilts()[i]
            self.contact.modes[i] = FREE
        self.contact.stopped[i] = True

    def _collide(self, hits: Sequence[int]) -> None:
        """Tips come to the face: P takes the tilt they have now, and the velocities jump."""
        energy = self._energy()
        phi = self._terms().phi
        for i in hits:
            self.contact.modes[i] = STICK
            self.contact.stopped[i] = False
        self._booked["relaxation"] += self._energy() - energy
        for i in hits:
            opening = float(phi[i] @ self.y[9:18])
            if opening >= 0:
                # Let go with a velocity that is lost in rounding: it never opened.
                self.y[14 + i] -= opening
        self._strike(None)

    def _strike(self, impulse: Floats | None) -> None:
        """Applies the law of impact to all that is closed; leaves the class of motion in modes."""
        system, phi = self.system, self._terms().phi
        before = self.y[9:18].copy()
        closed = self.contact.closed
        done = impact(phi, before, closed, system.friction, system.inverse, impulse)
        mean = (before + done.p) / 2
        if system.driven:
            # What turns the fingers holds them against the impact.
            self.y[20] -= float(done.impulses @ phi[:, 3:5] @ done.p[3:5])
        self._booked["impact"] -= float(done.impulses @ phi @ mean)
        if impulse is not None:
            self._booked["impulse"] += float(impulse @ mean)
        self.y[9:18] = done.p
        for i in range(2):
            if not closed[i]:
                continue
            slip, opening = float(phi[2 + i] @ done.p), float(phi[i] @ done.p)
            if done.modes[i] == FREE and opening > _SETTLED:
                self._release(i)
                continue
            mass, speed = system.mechanics.masses[5 + i], self.y[14 + i]
            self.y[14 + i] -= opening
            self._booked["impact"] += mass * opening * (speed - opening / 2)
            if abs(slip) <= _STILL:
                self.contact.modes[i] = STICK
            else:
                self.contact.modes[i] = SLIP_UP if slip > 0 else SLIP_DOWN

    def _kick(self, impulse: Sequence[float]) -> None:
        """An ideal impulse on the object."""
        before = list(self.contact.modes)
        self._strike(np.array([*impulse, *[0.0] * 6]))
        self._choose(before)

    def _release(self, i: int) -> None:
        self.contact.frozen[i] = self._tilts()[i]
        self.contact.modes[i] = FREE

    # The choice of modes

    def _classify_start(self) -> None:
        """Free where there is a gap, else closed; then the first choice, which is no change."""
        terms = self._terms()
        for i in range(2):
            if terms.gaps[i] <= _TOUCHING:
                if terms.gaps[i] < -_TOUCHING:
                    raise ValueError("initial: a tip is inside the object")
                slip = float(terms.phi[2 + i] @ self.y[9:18])
                approach = float(terms.phi[i] @ self.y[9:18])
                if approach > _STILL:
                    continue
                moving = SLIP_UP if slip > 0 else SLIP_DOWN
                self.contact.modes[i] = STICK if abs(slip) <= _STILL else moving
        if any(self.contact.closed):
            self._strike(None)
        self._choose()
        self.changes.clear()

    def _choose(
        self,
        before: Sequence[str] | None = None,
        left: Sequence[set[str]] = (set(), set()),
        again: bool = False,
    ) -> None:
        """Chooses the modes from here on, and puts what changed on its constraints.

        Args:
            before: Modes before the event; the contact's own may be classes of motion since.
            left: Modes that may not be chosen, by finger.
            again: Whether the law of impact has been tried already.
        """
        system, contact = self.system, self.contact
        before = list(contact.modes) if before is None else before
        terms = self._terms()
        closed, still, candidates = contact.closed, [], []
        for i, mode in enumerate(contact.modes):
            slip = float(terms.phi[2 + i] @ self.y[9:18])
            rests = mode == STICK or abs(slip) <= _STILL
            still.append(rests)
            if not closed[i]:
                candidates.append([FREE])
                continue
            moving = SLIP_UP if slip > 0 or system.friction[i] == 0 else SLIP_DOWN
            if system.friction[i] == 0:
                own = [moving, GRAZE, FREE]
            else:
                own = list(ORDER) if rests else [moving, GRAZE, FREE]
            candidates.append([m for m in own if m not in left[i]])
        chosen, border = None, None
        for modes in combinations(before, candidates):
            found = system.motion(terms, modes, self._driven(self.time))
            if not found.solved:
                continue
            margin = margins(terms, modes, found, system.friction, system.inverse, still, closed)
            if margin < -BORDER:
                continue
            if orientation(terms, modes, system.friction, system.inverse) <= BORDER**2:
                continue
            if margin > BORDER or self._holds_a_moment_later(modes, still, closed):
                chosen = modes
                break
            border = border or modes
        chosen = chosen or border
        if chosen is None and not again:
            # Painleve: a tangential impact without collision stops the slip.
            self._strike(None)
            self._choose(before, left, again=True)
            return
        if chosen is None:
            self.status = "no_mode"
            return
        for i, mode in enumerate(chosen):
            self._enter(i, mode, before[i], closed[i], terms)
            if mode != before[i]:
                self.changes.append(Change(self.time, SIDES[i][0], before[i], mode))

    def _enter(self, i: int, mode: str, before: str, closed: bool, terms: Any) -> None:
        """Takes a mode, with its residuals put into d_n and the rates of d_n and d_t."""
        contact = self.contact
        opening = float(terms.phi[i] @ self.y[9:18])
        if closed:
            self.y[5 + i] -= terms.gaps[i]
            self.y[14 + i] -= opening
        elif before != FREE and not contact.stopped[i]:
            self.y[5 + i] -= terms.gaps[i]
        if mode == STICK:
            self.y[16 + i] -= terms.phi[2 + i] @ self.y[9:18]
        if mode == FREE and closed:
            self._release(i)
        contact.modes[i] = mode

    def _holds_a_moment_later(
        self, modes: tuple[str, str], still: Sequence[bool], closed: Sequence[bool]
    ) -> bool:
        """Whether modes on their border are admissible after the trial step, too."""
        live, frozen = self._tilts(), list(self.contact.frozen)
        for i in range(2):
            if closed[i]:
                frozen[i] = live[i]
        trial = Contact(list(modes), frozen, [False, False])
        system = self.system
        y = self.y + _TRIAL * system.rates(self.y, self._driven(self.time), trial)
        _, terms, found = system.at(y, self._driven(self.time + _TRIAL), trial)
        limits = system.friction, system.inverse
        return margins(terms, modes, found, *limits, still, closed) >= 0
