"""The cost of an evaluation and a step, looked up in the table that the core's tests verify."""

from __future__ import annotations

from dataclasses import dataclass

from .operations import COSTS, EQUATIONS, FRICTION, KINDS, SINE

# Methods with a fixed cost per step, in the order of the table. Implicit methods iterate.
_METHODS = ("rk4", "dop853")
# The largest number of sines in the table; each further sine costs as much as the last of these.
_SINES = 2


@dataclass(frozen=True, kw_only=True)
class Cost:
    """The size of the equations and the cost of evaluating and stepping them.

    Attributes:
        degrees: Number of velocities that the equations are solved for.
        states: Number of values that a step advances.
        operations: Kind of operation -> its number in one evaluation.
        flops: Number of floating-point operations in one evaluation.
        step: (floating-point operations, latency in cycles) of a step; None for methods that
            solve equations.
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
    """Looks up the cost of a scene's equations.

    Args:
        formulation: How the constraints are enforced.
        method: The integration method.
        fingers: "pid", "torque" or "driven".
        ledger: Whether the works of the energy ledger are integrated.
        degree: Highest degree of the polynomials of schedule and forces.
        sines: Number of sines that act.
        friction: Whether the friction is limited.
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
