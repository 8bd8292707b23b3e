"""What an evaluation and a step take: the table of operations that the core's tests count."""

from __future__ import annotations

from dataclasses import dataclass

from .operations import COSTS, EQUATIONS, FRICTION, KINDS, SINE

# The methods whose steps are counted, in the order of the table: others solve equations.
_METHODS = ("rk4", "dop853")
# Sines that the table has; each further one adds what the last of these adds.
_SINES = 2


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What equations take.

    Attributes:
        degrees: Velocities that the equations are solved for.
        states: Numbers that a step advances.
        operations: Name -> how many an evaluation has.
        flops: Floating-point operations of these.
        step: The floating-point operations and the latency of a step; None of methods that solve
            equations.
    """

    degrees: int
    states: int
    operations: dict[str, int]
    flops: int
    step: tuple[int, int] | None


def cost(
    formulation: str,
    method: str,
    fingers: str,
    *,
    ledger: bool,
    degree: int,
    sines: int,
    friction: bool,
) -> Cost:
    """Looks up what equations take.

    Args:
        formulation: How the constraints are kept.
        method: How time is stepped.
        fingers: "pid" or "driven".
        ledger: Whether the works are integrated.
        degree: Of the polynomials of schedule and forces.
        sines: How many act.
        friction: Whether it is limited.
    """
    degrees, states, chains = EQUATIONS[formulation, fingers, ledger]
    tabled = min(sines, _SINES)
    counts, steps = COSTS[formulation, fingers, ledger, degree, tabled]
    fewer_counts, fewer_steps = COSTS[formulation, fingers, ledger, degree, max(tabled - 1, 0)]
    further = sines - tabled
    each = (now + further * (now - less) for now, less in zip(counts, fewer_counts, strict=True))
    operations = dict(zip(KINDS, each, strict=True))
    step = None
    if method in _METHODS:
        place = _METHODS.index(method)
        flops, latency = steps[2 * place], steps[2 * place + 1]
        flops += further * (flops - fewer_steps[2 * place]) + FRICTION * friction
        if sines:
            latency = max(latency, chains[place] + SINE * sines)
        step = (flops, latency)
    return Cost(
        degrees=degrees,
        states=states,
        operations=operations,
        flops=sum(KINDS[name] * count for name, count in operations.items()),
        step=step,
    )
