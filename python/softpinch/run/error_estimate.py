"""A run's estimated error, from the same run with half and with a quarter of each step."""

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

# Quantity with an error estimate -> the entry of `record` that records it.
QUANTITIES = {"q": "state", "p": "state", "multipliers": "multipliers"}
# Scaled differences between runs up to this are round-off.
_ROUND_OFF = 1e-12
# Allowed deviation of the observed order, as a share of the method's order.
_MARGIN = 0.25
# Adaptive steps are long where the motion is slow, and stiff methods lose order there. The smallest
# trusted order: each halving then leaves at most a third of the error.
_LEAST_ORDER = 1.6
# Scaled errors from this on are too large: Richardson's estimate neglects higher orders of dt.
_LARGEST = 1e-2


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ErrorEstimate(Result):
    """The estimated error of a run, by comparison with runs of half and a quarter of its steps.

    Adaptive steps are halved and quartered one by one, so that the finer runs take two and four
    equal steps for each step of the run.

    Attributes:
        q: Estimated |error| of q at each recorded row, (n, 9), m and rad; None if the state was not
            recorded. It is inf in rows that the finer runs lack, such as the last row of a run
            that a violation ended. With adaptive steps it is also inf at the instants at which a
            contact changes, which differ between the runs.
        p: Estimated |error| of p, (n, 9), m/s and rad/s, or None.
        multipliers: Estimated |error| of lambda, (n, 4), N, or None.
        largest: "q", "p", "multipliers" -> the largest error over components and the rows that all
            runs have, each component scaled by its largest magnitude along the run. It is inf if
            the runs did not end alike.
        order: The observed power of the step with which the differences between the runs fall.
            It is inf if only round-off is left, and -inf if they grow from zero because a run
            failed, or if the estimate was interrupted.
        expected_order: The order of the method.
        asymptotic: Whether the estimate can be trusted: all three runs ended with the same status
            within a step of each other, every scaled error is below 1e-2, and the errors fall with
            the method's order or are round-off. Of adaptive steps, which may be too long for the
            method's full order, only order 1.6 is required.
        message: The estimate in words.
        interrupted: Whether Ctrl-C came before both finer runs were done. Then every error is inf.
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
        """Returns the message."""
        return self.message


def estimate(
    result: Mapping[str, Any],
    again: Callable[[int], Mapping[str, Any]],
    method: str,
    recorded: tuple[str, ...],
    usual: Mapping[str, Floats],
    scales: Mapping[str, Floats] | None = None,
    adaptive: bool = False,
) -> ErrorEstimate:
    """Estimates the error of a run by Richardson extrapolation from two finer runs.

    Args:
        result: The core's result of the run.
        again: Computes the run with each step divided into the given number, 2 or 4, and the same
            recorded instants.
        method: The integration method.
        recorded: The run's `record`.
        usual: Typical magnitudes for the scene, from `scaled_error.usual`.
        scales: Name -> magnitudes (k,) that scale the errors, for a run that is a part of a longer
            one; None takes them from the finest run.
    """
    half, quarter = again(2), again(4)
    rows = min(len(each["t"]) for each in (result, half, quarter))
    # The last row of a run that ended early is its last instant, which may differ between runs.
    while rows and not result["t"][rows - 1] == half["t"][rows - 1] == quarter["t"][rows - 1]:
        rows -= 1
    compared = np.ones(rows, dtype=bool)
    if adaptive:
        # Steps end at changes of contacts, and a finer run may have its own just before or after.
        changes = [change[0] for change in result["contact_changes"]]
        compared = ~np.isin(result["t"][:rows], changes)
    expected = _core.ORDERS[method]
    found: dict[str, Floats] = {}
    largest: dict[str, float] = {}
    orders: list[float] = []
    for name in (name for name, kind in QUANTITIES.items() if kind in recorded):
        coarse, middle, fine = (each[name][:rows][compared] for each in (result, half, quarter))
        scale = scaled_error.scales(name, fine, usual) if scales is None else scales[name]
        first = float(scaled_error.by_row(coarse, middle, scale).max(initial=0.0))
        second = float(scaled_error.by_row(middle, fine, scale).max(initial=0.0))
        order = _observed_order(first, second)
        round_off = first <= _ROUND_OFF
        orders.append(math.inf if round_off else order)
        # Richardson: with a quarter of the step, 4^-order of the error remains, so the difference
        # of the two runs is (1 - 4^-order) of it.
        left = 4.0 ** -float(np.clip(order, 0.5, expected)) if math.isfinite(order) else 0.0
        bars = np.full(result[name].shape, np.inf)
        apart = np.abs(coarse - fine) / (1.0 - left)
        bars[:rows][compared] = apart
        found[name] = bars
        bars.flags.writeable = False
        largest[name] = float(scaled_error.by_row(apart, 0.0, scale).max(initial=0.0))
    told = [order for order in orders if order != math.inf]
    order = max(told, key=lambda order: abs(order - expected), default=math.inf)
    # Runs that end at the same violation do so within a step of each other.
    step = np.diff(result["t"][-2:]).max(initial=0.0)
    late = max(abs(each["t"][-1] - result["t"][-1]) for each in (half, quarter))
    alike = len({each["status"] for each in (result, half, quarter)}) == 1
    # A single row may be the start, whose error is zero, unless the run completed.
    moved = rows > 1 or (result["status"] == "completed" and bool(compared.any()))
    alike = alike and moved and late <= step
    if not alike:
        largest = dict.fromkeys(largest, math.inf)
    if adaptive:
        falls = all(order >= _LEAST_ORDER for order in orders)
    else:
        margin = _MARGIN * expected
        falls = all(order == math.inf or abs(order - expected) <= margin for order in orders)
    asymptotic = alike and max(largest.values()) < _LARGEST and falls
    return ErrorEstimate(
        q=found.get("q"),
        p=found.get("p"),
        multipliers=found.get("multipliers"),
        largest=largest,
        order=order,
        expected_order=expected,
        asymptotic=asymptotic,
        message=_message(
            largest, (order, expected), asymptotic, (result, half, quarter), alike, adaptive
        ),
    )


def _observed_order(first: float, second: float) -> float:
    """The order by which the difference fell from `first` to `second` as steps were halved."""
    if second == 0.0:
        return math.inf
    if first == 0.0 or math.isinf(second):  # the finest run overflowed
        return -math.inf
    return math.log2(first / second)


def interrupted(
    result: Mapping[str, Any], method: str, recorded: tuple[str, ...], adaptive: bool = False
) -> ErrorEstimate:
    """Returns the estimate of a run whose finer runs Ctrl-C has stopped: every error is inf."""
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
        message="the error cannot be estimated: the runs with "
        + ("halves and quarters of the steps were" if adaptive else "dt/2 and dt/4 were")
        + " interrupted",
        interrupted=True,
    )


def _message(
    largest: dict[str, float],
    orders: tuple[float, int],
    asymptotic: bool,
    runs: tuple[Mapping[str, Any], ...],
    alike: bool,
    adaptive: bool,
) -> str:
    order, expected = orders
    setting, steps = ("tolerance", "its steps") if adaptive else ("dt", "dt")
    sizes = ", ".join(f"{name} {size:.1e}" for name, size in largest.items())
    if not alike:
        ends = [f"{run['status']} at t = {run['t'][-1]:.6g} s" for run in runs]
        how = (
            f"the run ended differently ({', '.join(ends)})"
            if len(set(ends)) > 1
            else f"the run ended before a second row ({ends[0]})"
        )
        halved = "its own steps, halves and quarters of them" if adaptive else "dt, dt/2 and dt/4"
        cut = runs[0]["status"] == "too_many_steps"
        remedy = "raise max_steps" if cut else f"take a smaller {setting}"
        return f"the error cannot be estimated: with {halved} {how}; {remedy}"
    text = f"estimated error of the run, relative to the largest size of each component: {sizes}"
    if order == math.inf:
        return f"{text}; only round-off is left"
    text += f"; it falls with the power {order:.1f} of {steps}; the method's order is {expected}"
    if asymptotic:
        return text
    long = "the steps are" if adaptive else "dt is"
    return (
        f"{text}; the estimate may be wrong, because {long} too long for its theory: take a "
        f"smaller {setting}"
    )
