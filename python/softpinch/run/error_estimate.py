"""A run's estimated error, from the same run with half and with a quarter of each step.

Adaptive steps are taken again, each divided into equal parts. Integration goes from one instant at
which an input may jump to the next, and ends a step there. A force of zero that "jumps" at each end
of a step therefore makes equal steps out of the adaptive ones: as many between two of these ends as
the run is refined.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import _core
from ..scene import Sampled, Scene, fields
from ..support import Floats, Result, read_only
from . import scaled_error
from .request import Request

# Quantity with an error estimate -> the entry of `record` that records it.
QUANTITIES = {name: fields.QUANTITIES[name].record for name in fields.ESTIMATED}
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
    """The estimated error of a run, by comparison with runs of half and a quarter of each step.

    Attributes:
        q: Estimated |error| of q at each recorded row, (n, 9), m and rad; None if the state was not
            recorded. It is inf in rows that the finer runs lack, such as the last row of a run
            that a violation ended, and with adaptive steps the rows at which a contact changes.
        p: Likewise, (n, 9), m/s and rad/s; `multipliers` has that of lambda, (n, 4), N.
        largest: "q", "p", "multipliers" -> the largest error over components and the rows that have
            an estimate, each component scaled by its largest magnitude along the run. It is inf if
            the runs did not end alike. `message` names the component and its row, by time.
        order: The observed power of the step with which the differences between the runs fall; inf
            if only round-off is left, -inf if a finer run failed or was interrupted.
        expected_order: The order of the method.
        asymptotic: Whether the estimate can be trusted: all three runs ended with the same status
            within a step of each other, every row has an estimate, every scaled error is below
            1e-2, and errors fall with the method's order (of adaptive steps, 1.6) or are round-off.
        message: The estimate in words. It names the rows without an estimate.
        interrupted: Whether Ctrl-C came before both finer runs were done. Then every error is inf.
    """

    q: Floats | None = None
    p: Floats | None = None
    multipliers: Floats | None = None
    largest: dict[str, float]
    order: float
    expected_order: int
    asymptotic: bool
    message: str
    interrupted: bool = False

    def __str__(self) -> str:
        return self.message


def estimate(request: Request, result: Mapping[str, Any]) -> ErrorEstimate:
    """Estimates the error of a run's result by Richardson extrapolation from two finer runs."""
    adaptive = request.options.tolerance is not None
    expected = _core.ORDERS[request.options.method]
    names = [name for name, kind in QUANTITIES.items() if kind in request.options.record]
    try:
        runs = result, half, quarter = result, *_finer_runs(request, result)
    except KeyboardInterrupt:
        nowhere: Any = {name: np.full(result[name].shape, np.inf) for name in names}
        finer = "halves and quarters of the steps were" if adaptive else "dt/2 and dt/4 were"
        return ErrorEstimate(
            **nowhere,
            largest=dict.fromkeys(names, math.inf),
            order=-math.inf,
            expected_order=expected,
            asymptotic=False,
            message=f"the error cannot be estimated: the runs with {finer} interrupted",
            interrupted=True,
        )
    t = result["t"]
    n = min(len(each["t"]) for each in runs)
    # A finer run may lack the last row of a run that ended early, and rows at changes of contacts.
    compared = np.flatnonzero((t[:n] == half["t"][:n]) & (t[:n] == quarter["t"][:n]))
    usual = scaled_error.usual(request.scene)
    found: dict[str, Any] = {}
    largest: dict[str, float] = {}
    worst: dict[str, str] = {}
    orders: list[float] = []
    for name in names:
        coarse, middle, fine = (each[name][compared] for each in runs)
        scale = scaled_error.scales(name, fine, usual)
        first = float(scaled_error.by_row(coarse, middle, scale).max(initial=0.0))
        second = float(scaled_error.by_row(middle, fine, scale).max(initial=0.0))
        order = _observed_order(first, second)
        orders.append(math.inf if first <= _ROUND_OFF else order)
        # Richardson: with a quarter of the step, 4^-order of the error remains, so the difference
        # of the two runs is (1 - 4^-order) of it.
        left = 4.0 ** -float(np.clip(order, 0.5, expected)) if math.isfinite(order) else 0.0
        apart = np.abs(coarse - fine) / (1.0 - left)
        bars = np.full(result[name].shape, np.inf)
        bars[compared] = apart
        found[name] = read_only(bars)
        errors = scaled_error.by_row(apart, 0.0, scale)
        largest[name] = float(errors.max(initial=0.0))
        if largest[name] > 0.0:
            row = int(errors.argmax())
            column = fields.QUANTITIES[name].columns[int(np.argmax(apart[row] / scale))]
            worst[name] = f" ({column} at t = {t[compared[row]]:.6g} s)"
    finite = [order for order in orders if order != math.inf]
    order = max(finite, key=lambda order: abs(order - expected), default=math.inf)
    # Runs that end at the same violation do so within a step of each other.
    step = np.diff(t[-2:]).max(initial=0.0)
    late = max(abs(each["t"][-1] - t[-1]) for each in (half, quarter))
    same_status = len({each["status"] for each in runs}) == 1
    # A single row may be the start, whose error is zero, unless the run completed.
    moved = len(compared) > (result["status"] != "completed")
    alike = bool(same_status and moved and late <= step)
    if not alike:
        largest = dict.fromkeys(largest, math.inf)
    if adaptive:
        falls = all(order >= _LEAST_ORDER for order in orders)
    else:
        margin = _MARGIN * expected
        falls = all(order == math.inf or abs(order - expected) <= margin for order in orders)
    reliable = alike and max(largest.values()) < _LARGEST and falls
    missing = t[~np.isfinite(np.hstack(list(found.values()))).all(axis=1)]
    if alike:
        sizes = ", ".join(f"{k} {size:.1e}{worst.get(k, '')}" for k, size in largest.items())
        message = _sizes(sizes, order, expected, reliable, adaptive)
        if len(missing):
            some = ", ".join(f"{instant:.6g}" for instant in missing[:3])
            more = ", ..." if len(missing) > 3 else ""
            why = "because a contact changes or the run ends there"
            missed = f"{len(missing)} of {len(t)} rows have no estimate, {why}"
            message += f"; {missed}: t = {some}{more} s"
    else:
        message = _not_alike(runs, adaptive)
    return ErrorEstimate(
        **found,
        largest=largest,
        order=order,
        expected_order=expected,
        asymptotic=reliable and not len(missing),
        message=message,
    )


def _observed_order(first: float, second: float) -> float:
    """The order by which the difference fell from `first` to `second` as steps were halved."""
    if second == 0.0:
        return math.inf
    if first == 0.0 or math.isinf(second):  # the finest run overflowed
        return -math.inf
    return math.log2(first / second)


def _not_alike(runs: Sequence[Mapping[str, Any]], adaptive: bool) -> str:
    ends = [f"{run['status']} at t = {run['t'][-1]:.6g} s" for run in runs]
    if len(set(ends)) > 1:
        how = f"the run ended differently ({', '.join(ends)})"
    else:
        how = f"the run ended before a second row ({ends[0]})"
    halved = "its own steps, halves and quarters of them" if adaptive else "dt, dt/2 and dt/4"
    remedy = f"take a smaller {'tolerance' if adaptive else 'dt'}"
    if runs[0]["status"] == "too_many_steps":
        remedy = "raise max_steps"
    return f"the error cannot be estimated: with {halved} {how}; {remedy}"


def _sizes(sizes: str, order: float, expected: int, reliable: bool, adaptive: bool) -> str:
    """Says how large the errors are, and whether they fall as expected."""
    text = f"estimated error of the run, relative to the largest size of each component: {sizes}"
    if order == math.inf:
        return f"{text}; only round-off is left"
    setting, steps, long = (
        ("tolerance", "its steps", "the steps are") if adaptive else ("dt", "dt", "dt is")
    )
    text += f"; it falls with the power {order:.1f} of {steps}; the method's order is {expected}"
    if reliable:
        return text
    why = f"because {long} too long for its theory: take a smaller {setting}"
    return f"{text}; the estimate may be wrong, {why}"


def _finer_runs(
    request: Request, result: Mapping[str, Any]
) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Computes the run with half and with a quarter of each step, with the same recorded instants.

    Adaptive steps come from another run, unless the run recorded every step.
    """
    record = tuple(kind for kind in request.options.record if kind in QUANTITIES.values())
    request = request.with_(record=record)
    options = request.options
    if options.tolerance is None:
        return request.run_to_end(2), request.run_to_end(4)
    t = result["t"]
    if options.times is not None or options.every != 1:
        t = np.union1d(t, request.with_(record=(), times=None, every=1).run_to_end()["t"])
    t = ends_of_steps(t, [change[0] for change in result["contact_changes"]])
    if len(t) < 2:
        return result, result
    # Finer runs end one step later if the duration allows, as they may meet a violation later.
    scene, start, over = request.scene, request.scene.start(), 2.0 * t[-1] - t[-2]
    duration = min(scene.duration, over - start.time)
    initial = scene.initial if start.grid is None else replace(start, grid=None)
    longer = replace(ending_at(scene, np.append(t, over)), duration=duration, initial=initial)
    finer = request.with_(longer, dt=duration, tolerance=None, times=None, every=1)
    half, quarter = (_at_rows(finer.run_to_end(refine), result["t"]) for refine in (2, 4))
    return half, quarter


def ending_at(scene: Scene, t: Floats) -> Scene:
    """Returns the scene with steps that end at increasing instants (n,), s."""
    zero = Sampled(times=t, force=np.zeros((len(t), 2)))
    return replace(scene, disturbances=[*scene.disturbances, zero])


def ends_of_steps(t: Floats, changes: Sequence[float]) -> Floats:
    """Returns the instants among `t`, increasing, at which the steps of finer runs end.

    These find changes of contacts of their own: a step that ended at those of the run would repeat
    its errors. Instants within round-off of another are left out, because the core does not count
    steps without length.
    """
    kept = ~np.isin(t, changes)
    kept[[0, -1]] = True
    t = t[kept]
    return t[np.diff(t, prepend=-np.inf) > _close(t)]


def _at_rows(result: Mapping[str, Any], t: Floats) -> Mapping[str, Any]:
    """Keeps the rows at the instants `t` up to round-off, else the next ones, and the last row."""
    own = result["t"]
    n, close = len(own), _close(t)
    rows = np.minimum(np.searchsorted(own, t - close), n - 1)
    t = np.where(np.abs(own[rows] - t) <= close, t, own[rows])
    if rows[-1] != n - 1:
        rows, t = np.append(rows, n - 1), np.append(t, own[-1])
    kept = {
        name: value[rows] if isinstance(value, np.ndarray) and len(value) == n else value
        for name, value in result.items()
    }
    return {**kept, "t": t}


def _close(t: Floats) -> Floats:
    """The round-off within which two instants are one end of a step, which may be quartered."""
    return 8.0 * np.spacing(np.abs(t))
