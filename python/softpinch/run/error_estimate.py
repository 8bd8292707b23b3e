"""A run's own error bar: the same run with its steps halved, and halved again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _core
from ..support.arrays import Floats, read_only
from ..support.result import Result
from . import scaled_error

# What has an error of its own, and what brings it into a recording.
QUANTITIES = {"q": "state", "p": "state", "multipliers": "multipliers"}
# Differences between runs below this are what round-off leaves of them.
_ROUND_OFF = 1e-12
# How far the observed order may be from the method's, as a share of that.
_MARGIN = 0.25
# Nor is a larger error than this a small one, whose next order can be left out.
_LARGEST = 1e-2


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorEstimate(Result):
    """How wrong a run is, by comparison with the same run in half and in a quarter of its steps.

    Attributes:
        q: Estimated |error| of q at each recorded row, (n, 9), m and rad; None where the state was
            not recorded. Rows that the finer runs do not have, such as the last one of a run that
            a violation ended, have inf.
        p: Of p, (n, 9), m/s and rad/s, or None.
        multipliers: Of lambda, (n, 4), N, or None.
        largest: "q", "p", "multipliers" -> the largest over the other rows and components, each
            component against its largest size along the run.
        order: With which power of the step these fall, as observed; inf where only round-off is
            left, and -inf where they do not fall because a run failed.
        expected_order: The method's.
        asymptotic: Whether the estimate can be trusted: all three runs ended with one status, and
            the error falls as the method's order has it, or is round-off.
        message: The same in words.
        interrupted: Whether Ctrl-C came before both finer runs were done: nothing is known then,
            every error is inf, and the order -inf.
    """

    q: Floats | None
    p: Floats | None
    multipliers: Floats | None
    largest: dict[str, float]
    order: float
    expected_order: int
    asymptotic: bool
    message: str
    interrupted: bool = False

    def __str__(self) -> str:
        """What it says."""
        return self.message


def estimate(
    result: Mapping[str, Any],
    again: Callable[[int], Mapping[str, Any]],
    method: str,
    recorded: tuple[str, ...],
    usual: Mapping[str, Floats],
    scales: Mapping[str, Floats] | None = None,
) -> ErrorEstimate:
    """Compares a run with what `again(2)` and `again(4)` give: the same rows from shorter steps.

    `usual` is what is usual for the scene; `scales` stand for the sizes along the run, where it is
    a part of a longer one.
    """
    half, quarter = again(2), again(4)
    rows = min(len(each["t"]) for each in (result, half, quarter))
    # A run that ended inside has its last instant as a row, which others need not share.
    while rows and not result["t"][rows - 1] == half["t"][rows - 1] == quarter["t"][rows - 1]:
        rows -= 1
    expected = _core.ORDERS[method]
    found: dict[str, Floats] = {}
    largest: dict[str, float] = {}
    orders: list[float] = []
    for name in (name for name, kind in QUANTITIES.items() if kind in recorded):
        coarse, middle, fine = (each[name][:rows] for each in (result, half, quarter))
        scale = scaled_error.scales(name, fine, usual) if scales is None else scales[name]
        first = float(scaled_error.by_row(coarse, middle, scale).max(initial=0.0))
        second = float(scaled_error.by_row(middle, fine, scale).max(initial=0.0))
        order = math.inf if second == 0.0 else math.log2(first / second) if first else -math.inf
        round_off = first <= _ROUND_OFF
        orders.append(math.inf if round_off else order)
        # Richardson's: what is left of the error in a quarter of the step is 4^-order of it.
        left = 4.0 ** -float(np.clip(order, 0.5, expected)) if math.isfinite(order) else 0.0
        bars = np.full(result[name].shape, np.inf)
        bars[:rows] = np.abs(coarse - fine) / (1.0 - left)
        found[name] = bars
        bars.flags.writeable = False
        largest[name] = float(scaled_error.by_row(bars[:rows], 0.0, scale).max(initial=0.0))
    told = [order for order in orders if order != math.inf]
    order = max(told, key=lambda order: abs(order - expected), default=math.inf)
    # Runs that a violation ends do so within a step of each other, or it is another violation.
    step = np.diff(result["t"][-2:]).max(initial=0.0)
    late = max(abs(each["t"][-1] - result["t"][-1]) for each in (half, quarter))
    alike = len({each["status"] for each in (result, half, quarter)}) == 1
    alike = alike and rows > 1 and late <= step
    if not alike:
        largest = dict.fromkeys(largest, math.inf)
    margin = _MARGIN * expected
    asymptotic = (
        alike
        and max(largest.values()) < _LARGEST
        and all(order == math.inf or abs(order - expected) <= margin for order in orders)
    )
    return ErrorEstimate(
        q=found.get("q"),
        p=found.get("p"),
        multipliers=found.get("multipliers"),
        largest=largest,
        order=order,
        expected_order=expected,
        asymptotic=asymptotic,
        message=_message(largest, order, expected, asymptotic, (result, half, quarter), alike),
    )


def interrupted(result: Mapping[str, Any], method: str, recorded: tuple[str, ...]) -> ErrorEstimate:
    """What is known of a run whose finer runs Ctrl-C has stopped: nothing."""
    named = [name for name, kind in QUANTITIES.items() if kind in recorded]
    found = {name: read_only(np.full(result[name].shape, np.inf)) for name in named}
    return ErrorEstimate(
        q=found.get("q"),
        p=found.get("p"),
        multipliers=found.get("multipliers"),
        largest=dict.fromkeys(named, math.inf),
        order=-math.inf,
        expected_order=_core.ORDERS[method],
        asymptotic=False,
        message="no error can be told: interrupted before the runs with dt/2 and dt/4 were done",
        interrupted=True,
    )


def _message(
    largest: dict[str, float],
    order: float,
    expected: int,
    asymptotic: bool,
    runs: tuple[Mapping[str, Any], ...],
    alike: bool,
) -> str:
    sizes = ", ".join(f"{name} {size:.1e}" for name, size in largest.items())
    if not alike:
        ends = [f"{run['status']} at t = {run['t'][-1]:.6g} s" for run in runs]
        how = (
            f"the run ended differently ({', '.join(ends)})"
            if len(set(ends)) > 1
            else f"the run ended before a second row ({ends[0]})"
        )
        return f"no error can be told: with dt, dt/2 and dt/4 {how}; take a smaller dt"
    text = f"estimated error of the run, each component against its largest size: {sizes}"
    if order == math.inf:
        return f"{text}; nothing but round-off is left"
    text += f"; it falls with the power {order:.1f} of dt, the method's order is {expected}"
    if asymptotic:
        return text
    return (
        f"{text}: dt is not in the range where theory holds, and the estimate may be wrong; take a "
        "smaller dt"
    )
