"""`work_precision` and `stabilization_sweep`: errors of runs relative to an independent reference.

Every setting is run once, and rows of each run are sampled. The reference is then computed at the
instants of all these rows.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run import Options, Request, Run, scaled_error
from ..run.measures import held_residuals
from ..scene import ESTIMATED, Scene, Stabilization, usual
from ..scene.contact import without_drift
from ..support import Floats, Formulation, Method, Report, checks, reporting
from .measurements import Measurement, Peer, StabilizationSweep, WorkPrecision
from .reference import Reference, of_any_contact
from .runs import accurate_run, cpu_times, pairs_of, repeated, timed_run
from .segments import Inputs

# The default steps: the longest as a multiple of the mean step that a stiff method takes at
# tolerance 1e-6, and the number of steps, each half of the one before.
_LONGEST, _HALVINGS = 16.0, 11
_TOLERANCES = 10.0 ** -np.arange(2.0, 12.0)
# Errors are computed at this many even rows, and 0, 1, 3, 7, ... steps after switches of inputs.
_ROWS = 48
# Share of the time from one switch to the next that counts as "at the switch".
_AT_SWITCH = 0.01
# Runs with more steps are recorded at every k-th step only.
_MOST_RECORDED = 200_000
# Lower bound of the time that a step takes, s.
_CHEAPEST_STEP = 1e-7
# Number of timed repetitions of a run, unless it is slow.
_REPEATS = 7
_EVERYTHING = ("state", "multipliers", "residuals", "energy", "contact")


def work_precision(
    scene: Scene,
    *,
    formulations: Formulation | Sequence[Formulation] | None = None,
    methods: Method | Sequence[Method] = _core.METHODS,
    dt: ArrayLike | None = None,
    tolerances: ArrayLike | None = None,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    peers: Iterable[Peer] = (),
    longest: float = 2.0,
    progress: bool | Report = True,
) -> WorkPrecision:
    """Measures error and run time of every pair of formulation and method over a sweep of steps.

    An error is the largest over components of |difference| from the reference, each component
    divided by its largest magnitude along the run; q, p and lambda have separate errors
    (docs/error-against-run-time.md, "The problem"). SciPy computes the reference from an
    independent statement of the equations, and a second method confirms it (`softpinch.reference`).
    In unilateral contact, which that statement lacks, the reference is a run of the core itself, by
    "dop853" at a tight tolerance, which another formulation confirms; there rows at the very
    instant of a change of a contact are not compared.

    Args:
        scene: The scene to simulate. The reference ignores violations, so a run that a violation
            ends counts as failed.
        formulations, methods: What to measure; None is all formulations that the contact allows.
        dt: Longest steps, s, (k,); None takes eleven, each half of the one before, starting at 16
            times the mean step that a stiff method takes at tolerance 1e-6.
        tolerances: Tolerances for the methods with adaptive steps, (k,); None takes 1e-2 to 1e-11;
            () measures no adaptive steps.
        stabilization: The gains of "csm".
        peers: External solvers to measure on this scene.
        longest: A setting expected to take longer is not run, s; `WorkPrecision.skipped` lists it.
        progress: As for `monte_carlo`.

    Raises:
        ValueError: The scene starts off the constraints.
        RuntimeError: The reference cannot be computed, usually because the grasp is lost.
    """
    checks.instance("scene", scene, Scene)
    pairs = pairs_of(scene, formulations, methods)
    longest = checks.positive("longest", longest)
    if dt is None:
        mean = scene.duration / max(accurate_run(scene, tolerance=1e-6).stats["steps"], 1)
        dt = np.minimum(_LONGEST * mean * 0.5 ** np.arange(_HALVINGS), scene.duration)
    steps = from_loose_to_tight("dt", dt)
    allowed = _TOLERANCES if tolerances is None else from_loose_to_tight("tolerances", tolerances)
    switches = switch_instants(scene)
    curves = []
    for formulation, method in pairs:
        how = {"formulation": formulation, "method": method, "stabilization": stabilization}
        request = Request(scene, Options.checked(record=_EVERYTHING, **how))
        curves.append((request, "dt", steps))
        if method in _core.ADAPTIVE_METHODS:
            curves.append((request, "tolerance", allowed))
    others = checks.several("peers", peers, "Peers")
    for each in others:
        checks.instance("peers", each, Peer)
    total = sum(len(values) for *_, values in curves) + sum(len(peer.values) for peer in others)
    skipped: list[str] = []
    rows: list[Measurement] = []
    usual.warn(scene)
    with reporting(progress, "measuring") as report:
        runs = [run for curve in curves for run in _curve(*curve, switches, longest)]
        exact = _reference(scene, runs)
        for run in runs:
            if run.row.status == "not_run":
                skipped.append(_too_long(run.row))
                rows.append(run.row)
            else:
                times = _summarized(cpu_times(run.request, _REPEATS))
                row = replace(run.row, **times, **run.errors(exact, switches))
                rows.append(_with_order(row, rows[-1]) if rows else row)
            report(len(rows), total)
        for peer in others:
            rows += _peer_rows(peer, scene, exact, longest, skipped)
            report(len(rows), total)
    assert exact.own_error is not None
    return WorkPrecision(
        scene=scene,
        rows=tuple(rows),
        reference=exact.method,
        floor=dict(exact.own_error),
        stabilization=stabilization,
        skipped=tuple(skipped),
    )


def from_loose_to_tight(name: str, values: ArrayLike) -> Floats:
    """Checks the values of `dt` or `tolerances`, and sorts them from loose to tight, (k,)."""
    given = checks.numbers(name, values)
    if given.size == 0 and name == "tolerances":
        return given.reshape(0)
    found = np.unique(checks.array(name, given, ("k",)))[::-1]
    if not (found > 0).all():
        raise ValueError(f"{name} = {found[-1]}: must be > 0")
    if name == "tolerances" and not (found[0] < 1.0 and found[-1] >= 1e-14):
        wrong = found[0] if found[0] >= 1.0 else found[-1]
        raise ValueError(f"tolerances = {wrong}: must be from 1e-14 to below 1")
    return found


def stabilization_sweep(
    scene: Scene, dt: float = 1e-4, method: Method = "rk4", products: ArrayLike | None = None
) -> StabilizationSweep:
    """Runs a scene with "csm" over a range of gains, and measures drift and error of the motion.

    A gain that removes drift may at the same time make the motion wrong. Errors are relative to the
    same reference as in `work_precision`. Drift is that of the constraints that contacts hold.

    Args:
        scene, dt, method: As for `simulate`.
        products: Values of alpha dt = beta dt, (k,); None takes 33 from 1e-4 to 10, by equal
            factors.

    Raises:
        ValueError, RuntimeError: As for `work_precision`.
    """
    checks.instance("scene", scene, Scene)
    dt = checks.positive("dt", dt)
    method = checks.choice("method", method, _core.METHODS)
    given = np.geomspace(1e-4, 10.0, 33)
    if products is not None:
        given = from_loose_to_tight("products", products)[::-1]
    switches = switch_instants(scene)

    def sampled(formulation: Formulation, gain: float) -> _Sampled:
        how = {"dt": dt, "method": method, "stabilization": Stabilization(alpha=gain, beta=gain)}
        options = Options.checked(record=_EVERYTHING, formulation=formulation, **how)
        return _sampled(Request(scene, options), switches)[0]

    usual.warn(scene)
    plain = sampled(without_drift(scene), 0.0)
    runs = [sampled("csm", product / dt) for product in given.tolist()]
    exact = _reference(scene, [plain, *runs])
    # With the start as the only switch, the smooth part is the whole run.
    own, *along = (run.errors(exact, exact.t[:1])["smooth"] for run in (plain, *runs))
    rows = [run.row for run in runs]
    completed = np.array([row.status == "completed" for row in rows])
    return StabilizationSweep(
        dt=dt,
        method=method,
        product=given,
        status=tuple(row.status for row in rows),
        holonomic=np.where(completed, [row.holonomic for row in rows], np.inf),
        nonholonomic=np.where(completed, [row.nonholonomic for row in rows], np.inf),
        error=np.array([max(each["q"], each["p"]) for each in along]),
        multipliers=np.array([each["multipliers"] for each in along]),
        without={
            "holonomic": plain.row.holonomic,
            "nonholonomic": plain.row.nonholonomic,
            "q and p": max(own["q"], own["p"]),
            "multipliers": own["multipliers"],
        },
    )


class _Sampled(NamedTuple):
    """A run that was computed once, and the rows of it that are compared with the reference."""

    request: Request
    row: Measurement  # its measurement, without errors and times
    t: Floats = np.zeros(0)  # instants of the rows (n,), s; none if the run would take too long
    values: Mapping[str, Floats] = {}  # quantity -> its values in these rows (n, k)

    def errors(self, exact: Reference, switches: Floats) -> dict[str, Any]:
        """The fields `end`, `smooth` and `at_switches` of a `Measurement`, by quantity."""
        nothing = dict.fromkeys(ESTIMATED, math.inf)
        if self.row.status != "completed":
            return {"end": nothing, "smooth": nothing, "at_switches": nothing}
        at = np.searchsorted(exact.t, self.t)
        stretch = np.append(np.diff(switches), exact.t[-1] - switches[-1])
        which = np.searchsorted(switches, self.t, side="right") - 1
        # The start is no switch: a run has no error there.
        near = (which > 0) & (self.t - switches[which] <= _AT_SWITCH * stretch[which])
        found: dict[str, dict[str, float]] = {"end": {}, "smooth": {}, "at_switches": {}}
        for name, values in self.values.items():
            rows = scaled_error.by_row(values, getattr(exact, name)[at], exact.scales[name])
            found["end"][name] = float(rows[-1])
            found["smooth"][name] = float(rows[~near].max(initial=0.0))
            if near.any():
                found["at_switches"][name] = float(rows[near].max())
        return found


def _sampled(request: Request, switches: Floats) -> tuple[_Sampled, float]:
    """Computes a run, and returns it with its CPU time, s."""
    run, spent = timed_run(request)
    residuals = held_residuals(run).max(axis=0)
    exchanged = run.energy.exchanged
    closure = float(np.abs(run.energy.closure).max())
    counts: Any = {k: run.stats[k] for k in ("evaluations", "factorisations", "steps")}
    row = replace(
        _row(request),
        status=run.status,
        holonomic=float(residuals[:2].max()),
        nonholonomic=float(residuals[2:].max()),
        closure=closure / exchanged if exchanged > 0.0 else closure,
        **counts,
    )
    rows = sampled_rows(run, switches)
    return _Sampled(request, row, run.t[rows], {n: getattr(run, n)[rows] for n in ESTIMATED}), spent


def _row(request: Request) -> Measurement:
    options = request.options
    equal = options.dt is not None
    return Measurement(
        solver=f"{options.formulation} {options.method}",
        formulation=options.formulation,
        method=options.method,
        setting="dt" if equal else "tolerance",
        value=options.dt or options.tolerance or math.nan,
        status="not_run",
        expected_order=_core.ORDERS[options.method] if equal else 0,
    )


def sampled_rows(run: Run, switches: Floats, count: int = _ROWS) -> NDArray[np.intp]:
    """Indices of rows spread over the run, of rows soon after each switch, and of the last row."""
    last = len(run) - 1
    even = np.linspace(0, last, count).round().astype(np.intp)
    after = 2 ** np.arange(0, max(last, 1).bit_length() + 1) - 1
    near = (np.searchsorted(run.t, switches)[:, None] + after[None, :6]).ravel()
    rows = np.unique(np.concatenate([even, near[near <= last], [last]]))
    # An event may come just before such a row or just after it; an event at a switch does not.
    events = np.setdiff1d([change.time for change in run.contact_changes], switches)
    return np.asarray(rows[~np.isin(run.t[rows], events) | (rows == last)])


def _reference(scene: Scene, runs: Sequence[_Sampled]) -> Reference:
    end = float(scene.start().time + scene.duration)
    return of_any_contact(scene, np.unique(np.concatenate([*(run.t for run in runs), [end]])))


def switch_instants(scene: Scene) -> Floats:
    """The start of a scene, and the instants at which an input jumps or bends (k,), s."""
    start = float(scene.start().time)
    return np.array(Inputs(scene, start, start + scene.duration).edges[:-1])


def _curve(
    request: Request, setting: str, values: Floats, switches: Floats, longest: float
) -> Iterator[_Sampled]:
    """Runs every value of a setting, from loose to tight, that takes less than `longest`, s."""
    spent, before, duration = 0.0, 0.0, request.scene.duration
    for value in values.tolist():
        # Time grows inversely with dt, and about with the fourth root of 1 / tolerance.
        if setting == "dt":
            every = max(1, math.ceil(duration / value / _MOST_RECORDED))
            wanted = request.with_(dt=value, every=every)
            expected = spent * before / value if before else _CHEAPEST_STEP * duration / value
        else:
            wanted = request.with_(dt=None, tolerance=value)
            expected = spent * (before / value) ** 0.25
        if expected > longest:
            yield _Sampled(wanted, _row(wanted))
            continue
        run, spent = _sampled(wanted, switches)
        yield run
        before = value


def _too_long(row: Measurement) -> str:
    return f"{row.solver}, {row.setting} = {row.value:.3g}: would take too long"


def _with_order(row: Measurement, longer: Measurement) -> Measurement:
    """Adds the order, if the measurement before is one with a longer step of the same pair."""
    errors = longer.along, row.along
    same = (longer.solver, longer.setting) == (row.solver, row.setting) and row.setting == "dt"
    if not same or not all(0.0 < error < math.inf for error in errors):
        return row
    return replace(row, order=math.log(errors[0] / errors[1]) / math.log(longer.value / row.value))


def _summarized(times: Sequence[float]) -> dict[str, Any]:
    low, high = np.quantile(times, [0.25, 0.75])
    return {"time": statistics.median(times), "quartiles": (float(low), float(high))}


def _peer_rows(
    peer: Peer, scene: Scene, exact: Reference, longest: float, skipped: list[str]
) -> list[Measurement]:
    """A timed measurement for each value of a peer's setting; adds failures to `skipped`."""
    try:
        solve = peer.prepare(scene)
    except (ValueError, TypeError, AssertionError, RuntimeError) as reason:
        skipped.append(f"{peer.name}: {reason}")
        return []
    rows: list[Measurement] = []
    spent = 0.0
    for value in peer.values:
        row = Measurement(
            solver=peer.name, setting=peer.setting, value=float(value), status="not_run"
        )
        if spent > longest:
            skipped.append(_too_long(row))
            rows.append(row)
            continue
        try:
            q, p = peer.ends(solve(value))
            times = repeated(partial(solve, value), _REPEATS)
        except (ArithmeticError, ValueError, RuntimeError) as reason:
            rows.append(replace(row, status="failed", end=dict.fromkeys(("q", "p"), math.inf)))
            skipped.append(f"{peer.name}, {peer.setting} = {value:.3g}: {reason}")
            continue
        spent = statistics.median(times)
        end = scaled_error.at_end({"q": q, "p": p}, exact, exact.scales)
        status = "completed" if all(map(math.isfinite, end.values())) else "not_finite"
        rows.append(replace(row, status=status, end=end, **_summarized(times)))
    return rows
