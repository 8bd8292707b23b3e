"""Modes of contact: the accelerations in given modes, their conditions, and the law of impact.

A mode is "stick", "slip+", "slip-", "graze" or "free"; the sign is that of the slip velocity v, of
the object's face up along (-S, C) over the tip's surface. Fingers are numbered 0 (right), 1 (left).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv

from .contact_terms import Floats, Terms

Pair: TypeAlias = tuple[str, str]

STICK, SLIP_UP, SLIP_DOWN, GRAZE, FREE = "stick", "slip+", "slip-", "graze", "free"
# In the order in which they are preferred, where as many fingers change.
ORDER = (STICK, SLIP_UP, SLIP_DOWN, GRAZE, FREE)
SIGN = {SLIP_UP: 1.0, SLIP_DOWN: -1.0}
SLIPS = tuple(SIGN)
# How much a condition may be off, as a share of the terms behind it, and still be on its border.
BORDER = 1e-9
_ROUNDING = 1e-12


class Motion(NamedTuple):
    """Accelerations and contact forces at one state in given modes.

    Attributes:
        p_rate: (9,).
        multipliers: lambda^H of both, lambda^N of both.
        couples: The share psi of each tip's couple that acts: 1 in stick and slip, 0 when free.
        force: All generalised forces but the torques of driven fingers (9,).
        solved: False where the equations are singular, and then nothing else counts.
    """

    p_rate: Floats
    multipliers: list[float]
    couples: list[float]
    force: Floats
    solved: bool


def conditions(
    phi: Floats, modes: Sequence[str], friction: Sequence[float], terms: Terms | None = None
) -> tuple[list[int], list[Floats]]:
    """The rows of Phi that modes hold, and the directions of the forces that hold them.

    Those of tips that graze are in the `terms`.
    """
    rows: list[int] = []
    columns: list[Floats] = []
    for i, mode in enumerate(modes):
        normal, tangent = phi[i], phi[2 + i]
        if mode == FREE:
            continue
        rows.append(i)
        if mode == STICK:
            rows.append(2 + i)
            columns += [normal, tangent]
        elif mode == GRAZE:
            assert terms is not None
            columns.append(terms.couple_column(i))
        else:
            columns.append(normal - SIGN[mode] * friction[i] * tangent)
    return rows, columns


def contact_forces(
    unknown: Floats, modes: Sequence[str], friction: Sequence[float]
) -> tuple[Floats, list[float]]:
    """The multipliers or impulses (4,), and the shares psi of the couples (2,)."""
    forces, psi, at = np.zeros(4), [0.0, 0.0], 0
    for i, mode in enumerate(modes):
        if mode == FREE:
            continue
        psi[i] = 1.0
        if mode == GRAZE:
            psi[i] = float(unknown[at])
        else:
            forces[i] = unknown[at]
            if mode == STICK:
                at += 1
                forces[2 + i] = unknown[at]
            else:
                forces[2 + i] = -SIGN[mode] * friction[i] * forces[i]
        at += 1
    return forces, psi


def motion(
    terms: Terms,
    modes: Sequence[str],
    friction: Sequence[float],
    inverse: Floats,
    driven: Sequence[float] = (),
) -> Motion:
    """Solves the equations of motion in given modes.

    Args:
        terms: At the state.
        modes: Of both fingers.
        friction: mu of both.
        inverse: The inverse of the masses (9,), zero for driven fingers.
        driven: The accelerations of both fingers where they are driven.
    """
    force, given = terms.force, np.zeros(9)
    if driven:
        given[3:5] = driven
    for i, mode in enumerate(modes):
        if mode not in (FREE, GRAZE):
            force = force + terms.couple_column(i)
    rows, columns = conditions(terms.phi, modes, friction, terms)
    if not rows:
        return Motion(inverse * force + given, [0.0] * 4, [0.0, 0.0], force, True)
    weighted = terms.phi[rows] * inverse
    k = np.array(columns).T
    matrix = weighted @ k
    _, _, unknown, singular = dgesv(
        matrix, -terms.b[rows] - weighted @ force - terms.phi[rows] @ given
    )
    if singular:
        return Motion(inverse * force + given, [0.0] * 4, [0.0, 0.0], force, False)
    multipliers, psi = contact_forces(unknown, modes, friction)
    force = force + k @ unknown
    return Motion(inverse * force + given, multipliers.tolist(), psi, force, True)


def orientation(
    terms: Terms, modes: Sequence[str], friction: Sequence[float], inverse: Floats
) -> float:
    """det(R M^-1 K), divided by the sizes of the columns' and rows' entries; 1 without contact."""
    rows, columns = conditions(terms.phi, modes, friction, terms)
    if not rows:
        return 1.0
    root = np.sqrt(inverse)
    left, right = terms.phi[rows] * root, np.array(columns) * root
    sizes = np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=1)
    if not sizes.all():
        return 0.0
    return float(np.linalg.det(left @ right.T) / sizes.prod())


def margins(
    terms: Terms,
    modes: Sequence[str],
    found: Motion,
    friction: Sequence[float],
    inverse: Floats,
    still: Sequence[bool],
    closed: Sequence[bool],
) -> float:
    """The distance of the tightest condition from its border, as a share of the terms behind it.

    Args:
        terms: At the state.
        modes: A combination.
        found: Its motion.
        friction: mu of both.
        inverse: The inverse of the masses (9,).
        still: Whether v = 0.
        closed: Whether a finger is closed now; one that is free stays so unconditionally.
    """
    worst = np.inf
    load = float(np.abs(terms.force).max()) + max(map(abs, found.multipliers))
    for i, mode in enumerate(modes):
        normal, tangential = found.multipliers[i], found.multipliers[2 + i]
        if mode == STICK:
            worst = min(worst, (friction[i] * normal - abs(tangential)) / load)
        elif mode in SLIPS:
            worst = min(worst, normal / load)
            if still[i] and friction[i] > 0:
                slip = SIGN[mode] * _relative(terms.phi[2 + i], found.p_rate, terms.b[2 + i])
                worst = min(worst, slip)
        elif mode == GRAZE:
            # A couple may be small beside what it balances; its share is as much less certain.
            turned = abs(float(terms.phi[i] @ (inverse * terms.couple_column(i))))
            size = _size(terms.phi[i], found.p_rate, terms.b[i])
            worst = min(worst, min(found.couples[i], 1 - found.couples[i]) * turned / size)
        elif closed[i]:
            worst = min(worst, _relative(terms.phi[i], found.p_rate, terms.b[i]))
    return float(worst)


def _relative(row: Floats, p_rate: Floats, b: float) -> float:
    return float(row @ p_rate + b) / _size(row, p_rate, b)


def _size(row: Floats, p_rate: Floats, b: float) -> float:
    return float(np.abs(row * p_rate).sum() + abs(b)) or 1.0


def combinations(
    before: Sequence[str], candidates: Sequence[Sequence[str]]
) -> Iterator[tuple[str, str]]:
    """All combinations, fewest fingers changed first, then in the order of `ORDER`."""

    def rank(modes: Pair) -> tuple[int, list[int]]:
        changed = sum(a != b for a, b in zip(modes, before, strict=True))
        return changed, [ORDER.index(mode) for mode in modes]

    right, left = candidates
    yield from sorted(product(right, left), key=rank)


class Impact(NamedTuple):
    """The state after an impact or an impulse.

    Attributes:
        p: Velocities after it (9,).
        impulses: Lambda (4,), in the order of the multipliers.
        modes: How each finger went through it; "free" is one that opens or was open.
    """

    p: Floats
    impulses: NDArray[np.float64]
    modes: Pair


def impact(
    phi: Floats,
    p: Floats,
    closed: Sequence[bool],
    friction: Sequence[float],
    inverse: Floats,
    impulse: Floats | None = None,
) -> Impact:
    """Moreau's law with e = 0 for all closed contacts at once, by enumeration.

    Args:
        phi: (4, 9).
        p: Velocities before it (9,).
        closed: Which fingers touch, the colliding one too.
        friction: mu of both.
        inverse: The inverse of the masses (9,).
        impulse: J (9,).
    """
    start = p if impulse is None else p + inverse * impulse
    speed = float(np.abs(phi).max(axis=1) @ np.full(4, np.abs(start).max())) + 1e-300
    choices = [(STICK, SLIP_UP, SLIP_DOWN, FREE) if c else (FREE,) for c in closed]
    best, least = None, -np.inf
    for modes in product(*choices):
        rows, columns = conditions(phi, modes, friction)
        after, impulses, size = start, np.zeros(4), 0.0
        if rows:
            k = np.array(columns).T
            _, _, unknown, singular = dgesv((phi[rows] * inverse) @ k, -phi[rows] @ start)
            if singular:
                continue
            after = start + inverse * (k @ unknown)
            size = float(np.abs(unknown).max())
            impulses, _ = contact_forces(unknown, modes, friction)
        rates = phi @ after
        worst = 0.0
        for i, mode in enumerate(modes):
            if mode == STICK:
                margin = friction[i] * impulses[i] - abs(impulses[2 + i])
                worst = min(worst, margin / (size or 1.0))
            elif mode in SLIPS:
                worst = min(worst, impulses[i] / (size or 1.0))
                if friction[i] > 0:
                    worst = min(worst, SIGN[mode] * rates[2 + i] / speed)
            elif closed[i]:
                worst = min(worst, rates[i] / speed)
        if worst > least:
            best, least = Impact(after, impulses, (modes[0], modes[1])), worst
        if worst >= -_ROUNDING:
            break
    if best is None or least < -BORDER:
        raise RuntimeError(f"impact: no combination solves it, the best is off by {-least}")
    return best
