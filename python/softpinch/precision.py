"""Error against run time: every pair over a sweep of steps, beside an independent reference."""

from __future__ import annotations

import csv
import math
import statistics
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core, _error, _record, reference
from ._progress import Report, reporting
from .run import Run
from .scene import Scene, Stabilization
from .simulate import StabilityWarning, names, simulate
from .stability import trusted_run

Floats = NDArray[np.float64]
_EVERYTHING = ("state", "multipliers", "residuals", "energy")
QUANTITIES = ("q", "p", "multipliers")

# The default sweep: halvings from so many times the mean step of a stiff run to 1e-6.
_LONGEST, _HALVINGS = 16.0, 11
_TOLERANCES = 10.0 ** -np.arange(2.0, 12.0)
# Errors are looked at in so many rows of a run, evenly, and at 1, 2, 4, ... steps after a switch.
_ROWS = 48
# The first hundredth of what follows a switch counts as at the switch.
_AT_SWITCH = 0.01
# More steps are not recorded in full.
_MOST_RECORDED = 200_000
# Of a slow run fewer repetitions are timed.
_REPEATS, _SLOW_REPEATS, _SLOW = 7, 3, 0.3


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One solver at one setting.

    Attributes:
        solver: "nullspace rk4", or the name of a peer.
        formulation: How the constraints are kept; "" of a peer.
        method: How time is stepped; "" of a peer.
        setting: "dt", "tolerance", or what a peer's number is.
        value: Its value; of dt in s.
        status: How the run ended; "not_run" where it would have taken too long.
        end: "q", "p", "multipliers" -> error at the end; inf of a run that did not complete. Peers
            say nothing of lambda.
        smooth: The same, the largest along the run away from switches; empty of a peer.
        at_switches: The same at the switches and in the first hundredth of what follows each;
            empty of a peer, and where there is none.
        holonomic: Largest |C^H|, m; nan of a peer, as what follows.
        nonholonomic: Largest |C^N|, m/s.
        closure: Largest error of the energy ledger, as a share of what was exchanged.
        time: CPU time of a warm run that keeps its end, s: the median.
        quartiles: The quarters of these times, s.
        evaluations: Of the right-hand side; -1 where a peer does not say, as what follows.
        factorisations: Decompositions of a matrix.
        steps: Taken.
        order: With which power of the step the error at the end (q and p) fell from the longer
            step before; nan where there was none, or a run failed.
        expected_order: The method's; 0 where steps are free.
    """

    solver: str
    formulation: str = ""
    method: str = ""
    setting: str
    value: float
    status: str
    end: Mapping[str, float] = field(default_factory=dict)
    smooth: Mapping[str, float] = field(default_factory=dict)
    at_switches: Mapping[str, float] = field(default_factory=dict)
    holonomic: float = math.nan
    nonholonomic: float = math.nan
    closure: float = math.nan
    time: float = math.nan
    quartiles: tuple[float, float] = (math.nan, math.nan)
    evaluations: int = -1
    factorisations: int = -1
    steps: int = -1
    order: float = math.nan
    expected_order: int = 0

    @property
    def error(self) -> float:
        """At the end, the larger of q's and p's: what every solver has."""
        return max(self.end.get("q", math.inf), self.end.get("p", math.inf))


@dataclass(frozen=True, kw_only=True)
class Peer:
    """Another solver of the same motion.

    Attributes:
        name: In tables and legends.
        setting: What its numbers are: "rtol", "steps".
        values: From loose to tight.
        prepare: Scene -> function of a value, which solves (this is timed) and returns something.
        ends: Of that something, (q, p) at the end, (9,) each.
    """

    name: str
    setting: str
    values: Sequence[float]
    prepare: Callable[[Scene], Callable[[Any], Any]]
    ends: Callable[[Any], tuple[Floats, Floats]]


@dataclass(frozen=True, kw_only=True)
class WorkPrecision:
    """What `work_precision` measured.

    Attributes:
        scene: On what.
        rows: Every solver at every setting.
        reference: How the reference was computed, and confirmed.
        floor: "q", "p", "multipliers" -> the reference's own error: nothing below it is known.
        stabilization: The gains of "csm".
        skipped: What was left out, and why, a line each.
    """

    scene: Scene
    rows: tuple[Measurement, ...]
    reference: str
    floor: Mapping[str, float]
    stabilization: Stabilization
    skipped: tuple[str, ...]

    def cheapest(self, error: float) -> tuple[Measurement, ...]:
        """Of each solver and kind of setting the quickest with an error at the end below this.

        The quickest comes first. One that meets it by chance, and misses it at the next tighter
        setting, is left out.
        """
        found = []
        for rows in self.curves().values():
            good = [row.error <= error for row in rows]
            kept = [
                row
                for k, row in enumerate(rows)
                if good[k] and (k + 1 == len(rows) or good[k + 1])
            ]
            found += sorted(kept, key=lambda row: row.time)[:1]
        return tuple(sorted(found, key=lambda row: row.time))

    def curves(self) -> dict[tuple[str, str], list[Measurement]]:
        """(solver, setting) -> its rows that were run, from loose to tight."""
        found: dict[tuple[str, str], list[Measurement]] = {}
        for row in self.rows:
            if row.status != "not_run":
                found.setdefault((row.solver, row.setting), []).append(row)
        return found

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The rows as columns, each (rows,); errors as "end.q", "smooth.p" and so on."""
        columns: dict[str, list[Any]] = {}
        for row in self.rows:
            for name, value in _flat(row).items():
                columns.setdefault(name, []).append(value)
        return {name: np.array(values) for name, values in columns.items()}

    def save(self, path: str | Path) -> Path:
        """Writes the rows as .csv, units in the header.

        Raises:
            ValueError: The suffix is another.
            OSError: The file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() != ".csv":
            raise ValueError(f"path = {str(path)!r}: must end in .csv")
        columns = self.to_dict()
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([name + _COLUMN_UNITS.get(name, "") for name in columns])
            writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
        return path

    def to_pandas(self) -> Any:
        """The rows as a pandas DataFrame; needs the extra `study`.

        Raises:
            ImportError: pandas is not installed.
        """
        from ._extras import require

        pandas = require("pandas", extra="study", purpose="to_pandas")
        return pandas.DataFrame(self.to_dict())


_COLUMN_UNITS = {
    "holonomic": " [m]",
    "nonholonomic": " [m/s]",
    "time": " [s]",
    "lower_quartile": " [s]",
    "upper_quartile": " [s]",
}


def _flat(row: Measurement) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for each in fields(row):
        value = getattr(row, each.name)
        if isinstance(value, Mapping):
            found |= {f"{each.name}.{name}": value.get(name, math.nan) for name in QUANTITIES}
        elif each.name == "quartiles":
            found |= dict(zip(("lower_quartile", "upper_quartile"), value, strict=True))
        else:
            found[each.name] = value
    return found


def work_precision(
    scene: Scene,
    *,
    formulations: str | Sequence[str] = _core.FORMULATIONS,
    methods: str | Sequence[str] = _core.METHODS,
    dt: ArrayLike | None = None,
    tolerances: ArrayLike | None = None,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    peers: Iterable[Peer] = (),
    longest: float = 2.0,
    progress: bool | Report = True,
) -> WorkPrecision:
    """Measures error and run time of every pair of formulation and method over a sweep of steps.

    Errors are those of design.md: the largest over components of |difference| to the reference,
    each against its largest size along the run; q, p and lambda apart. The reference is SciPy's, on
    equations of its own, confirmed by a second method (`softpinch.reference`).

    Args:
        scene: On what. The reference is not monitored: a run that a violation ends is a failure.
        formulations: How the constraints are kept.
        methods: How time is stepped.
        dt: Longest steps, s, (k,); None takes eleven halvings about what a stiff method takes.
        tolerances: For the methods with free steps, (k,); None takes 1e-2 to 1e-11; () none.
        stabilization: The gains of "csm".
        peers: Other solvers, on the same scene.
        longest: A setting that would take longer, s, is left out, and said so.
        progress: As for `monte_carlo`.

    Raises:
        ValueError: An argument breaks its rule, or the scene starts off the constraints.
        TypeError: An argument is of the wrong kind.
        RuntimeError: The reference cannot be computed: the grasp is lost, most often.
        ImportError: SciPy is not installed.
    """
    _record.instance("scene", scene, Scene)
    _record.instance("stabilization", stabilization, Stabilization)
    kept = names("formulations", formulations, _core.FORMULATIONS)
    stepped = names("methods", methods, _core.METHODS)
    longest = _record.positive("longest", longest)
    steps = _default_steps(scene) if dt is None else _ladder("dt", dt)
    allowed = _TOLERANCES if tolerances is None else _ladder("tolerances", tolerances)
    ours = [
        _Curve(scene, (formulation, method), setting, values, stabilization)
        for formulation in kept
        for method in stepped
        for setting, values in (("dt", steps), ("tolerance", allowed))
        if setting == "dt" or method in _core.ADAPTIVE_METHODS
    ]
    others = list(peers)
    total = sum(len(curve.values) for curve in ours) + sum(len(peer.values) for peer in others)
    skipped: list[str] = []
    rows: list[Measurement] = []
    with reporting(progress, "measuring") as report, warnings.catch_warnings():
        warnings.simplefilter("ignore", StabilityWarning)
        instants = np.unique(np.concatenate([curve.look(longest) for curve in ours]))
        exact = reference.confirmed(scene, np.union1d(instants, [_end(scene)]))
        for curve in ours:
            rows += curve.measured(exact, skipped)
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


def _ladder(name: str, values: ArrayLike) -> Floats:
    """From loose to tight, checked."""
    given = np.asarray(values, dtype=np.float64)
    if given.size == 0 and name == "tolerances":
        return given.reshape(0)
    ladder = np.sort(_record.array(name, values, ("k",)))[::-1]
    if not (ladder > 0).all():
        raise ValueError(f"{name} = {ladder[-1]}: must be > 0")
    return ladder


def _default_steps(scene: Scene) -> Floats:
    stiff = trusted_run(scene, tolerance=1e-6)
    mean = scene.duration / max(stiff.stats["steps"], 1)
    steps = _LONGEST * mean * 0.5 ** np.arange(_HALVINGS)
    return np.unique(np.minimum(steps, scene.duration))[::-1]


def _end(scene: Scene) -> float:
    return float(scene.start().time + scene.duration)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Look:
    """What is kept of a run until the reference is there: some rows, and its largest residuals."""

    status: str
    stats: Mapping[str, int]
    t: Floats
    q: Floats
    p: Floats
    multipliers: Floats
    holonomic: float
    nonholonomic: float
    closure: float


def _look(run: Run) -> _Look:
    rows = _chosen(run)
    residuals = np.abs(run.residuals).max(axis=0)
    exchanged = run.energy.exchanged
    closure = float(np.abs(run.energy.closure).max())
    return _Look(
        status=run.status,
        stats=run.stats,
        t=run.t[rows],
        q=run.q[rows],
        p=run.p[rows],
        multipliers=run.multipliers[rows],
        holonomic=float(residuals[:2].max()),
        nonholonomic=float(residuals[2:].max()),
        closure=closure / exchanged if exchanged > 0.0 else closure,
    )


def _chosen(run: Run) -> NDArray[np.intp]:
    """Rows spread over the run, and 0, 1, 2, 4, ... steps after each switch; the last one."""
    last = len(run) - 1
    even = np.linspace(0, last, _ROWS).round().astype(np.intp)
    after = 2 ** np.arange(0, max(last, 1).bit_length() + 1) - 1
    switches = np.searchsorted(run.t, switching(run.scene))
    near = (switches[:, None] + after[None, :6]).ravel()
    return np.unique(np.concatenate([even, near[near <= last], [last]]))


def switching(scene: Scene) -> Floats:
    """The instants at which an input of the scene jumps or kinks, its start first, s."""
    begin, end = float(scene.start().time), _end(scene)
    breaks = reference.breaks(scene)
    inside = [t for t in breaks if begin < t < end]
    return np.unique(np.array([begin, *inside]))


class _Curve:
    """One pair over one kind of setting: looked at first, measured when the reference is there."""

    def __init__(
        self, scene: Scene, pair: tuple[str, str], setting: str, values: Floats, gains: Stabilization
    ) -> None:
        self.scene, self.setting, self.values, self.gains = scene, setting, values, gains
        self.formulation, self.method = pair
        self.looks: list[_Look | None] = []

    def simulate(self, value: float, record: Sequence[str], every: int) -> Run:
        how: dict[str, Any] = {self.setting: value}
        return simulate(
            self.scene,
            method=self.method,
            formulation=self.formulation,
            stabilization=self.gains,
            record=record,
            every=every,
            stop_on=(),
            **how,
        )

    def look(self, longest: float) -> Floats:
        """Runs every setting once; the instants of the rows that are kept."""
        spent, before = 0.0, 0.0
        for value in self.values:
            # Work grows as steps shrink; with a tenth of a tolerance by no more than that.
            if before and spent * before / value > longest:
                self.looks.append(None)
                continue
            every = 1
            if self.setting == "dt":
                every = max(1, math.ceil(self.scene.duration / value / _MOST_RECORDED))
            begin = time.process_time()
            self.looks.append(_look(self.simulate(float(value), _EVERYTHING, every)))
            spent, before = time.process_time() - begin, value
        return np.concatenate([[], *(look.t for look in self.looks if look is not None)])

    def measured(self, exact: reference.Reference, skipped: list[str]) -> list[Measurement]:
        solver = f"{self.formulation} {self.method}"
        fixed = self.setting == "dt"
        rows: list[Measurement] = []
        for value, look in zip(self.values.tolist(), self.looks, strict=True):
            row = Measurement(
                solver=solver,
                formulation=self.formulation,
                method=self.method,
                setting=self.setting,
                value=value,
                status="not_run",
                expected_order=_core.ORDERS[self.method] if fixed else 0,
            )
            if look is None:
                skipped.append(f"{solver}, {self.setting} = {value:.3g}: would take too long")
                rows.append(row)
                continue
            times = clock(partial(self.simulate, value, (), 2**62))
            row = replace(
                row,
                status=look.status,
                holonomic=look.holonomic,
                nonholonomic=look.nonholonomic,
                closure=look.closure,
                time=statistics.median(times),
                quartiles=_quartiles(times),
                evaluations=look.stats["evaluations"],
                factorisations=look.stats["factorisations"],
                steps=look.stats["steps"],
                **_errors(look, exact, switching(self.scene)),
            )
            rows.append(_with_order(row, rows[-1]) if rows and fixed else row)
        return rows


def _errors(look: _Look, exact: reference.Reference, switches: Floats) -> dict[str, Any]:
    """Of the end, and the largest at and away from switches, by quantity."""
    nothing = dict.fromkeys(QUANTITIES, math.inf)
    if look.status != "completed":
        return {"end": nothing, "smooth": nothing, "at_switches": nothing}
    at = np.searchsorted(exact.t, look.t)
    stretch = np.append(np.diff(switches), exact.t[-1] - switches[-1])
    which = np.searchsorted(switches, look.t, side="right") - 1
    # At the start nothing is wrong yet, and what follows it is no different from the rest.
    near = (which > 0) & (look.t - switches[which] <= _AT_SWITCH * stretch[which])
    found: dict[str, dict[str, float]] = {"end": {}, "smooth": {}, "at_switches": {}}
    for name in QUANTITIES:
        rows = _error.by_row(getattr(look, name), getattr(exact, name)[at], exact.scales[name])
        found["end"][name] = float(rows[-1])
        found["smooth"][name] = float(rows[~near].max(initial=0.0))
        if near.any():
            found["at_switches"][name] = float(rows[near].max())
    return found


def _with_order(row: Measurement, longer: Measurement) -> Measurement:
    errors = longer.error, row.error
    if not all(0.0 < error < math.inf for error in errors):
        return row
    return replace(row, order=math.log(errors[0] / errors[1]) / math.log(longer.value / row.value))


def clock(work: Callable[[], object]) -> list[float]:
    """CPU times of a work, warm, s."""
    work()
    times: list[float] = []
    while len(times) < (_REPEATS if not times or times[0] < _SLOW else _SLOW_REPEATS):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return times


def _quartiles(times: Sequence[float]) -> tuple[float, float]:
    low, high = np.quantile(times, [0.25, 0.75])
    return float(low), float(high)


def _peer_rows(
    peer: Peer, scene: Scene, exact: reference.Reference, longest: float, skipped: list[str]
) -> list[Measurement]:
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
            skipped.append(f"{peer.name}, {peer.setting} = {value:.3g}: would take too long")
            rows.append(row)
            continue
        try:
            q, p = peer.ends(solve(value))
            times = clock(partial(solve, value))
        except (ArithmeticError, ValueError, RuntimeError) as reason:
            rows.append(replace(row, status="failed", end=dict.fromkeys(("q", "p"), math.inf)))
            skipped.append(f"{peer.name}, {peer.setting} = {value:.3g}: {reason}")
            continue
        spent = statistics.median(times)
        end = {
            name: float(
                _error.by_row(rows_[None], getattr(exact, name)[-1:], exact.scales[name])[0]
            )
            for name, rows_ in (("q", q), ("p", p))
        }
        status = "completed" if all(map(math.isfinite, end.values())) else "not_finite"
        rows.append(
            replace(row, status=status, end=end, time=spent, quartiles=_quartiles(times))
        )
    return rows


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilizationSweep:
    """What the gains of (19, 20) do at one step: drift, and error of the motion.

    Attributes:
        dt: The step, s.
        method: How time is stepped.
        product: alpha dt = beta dt, (k,).
        status: Of each run.
        holonomic: Largest |C^H| along the run, m; inf of a run that did not complete.
        nonholonomic: Largest |C^N|, m/s.
        error: Largest error of q, p along the run, each component against its largest size.
        multipliers: The same of lambda.
        without: The same errors of "nullspace", which has no gains: "q and p", "multipliers".
    """

    dt: float
    method: str
    product: Floats
    status: tuple[str, ...]
    holonomic: Floats
    nonholonomic: Floats
    error: Floats
    multipliers: Floats
    without: Mapping[str, float]


def stabilization_sweep(
    scene: Scene,
    dt: float = 1e-4,
    method: str = "rk4",
    products: ArrayLike | None = None,
) -> StabilizationSweep:
    """Sweeps alpha dt = beta dt: a gain that hides drift can spoil the motion.

    Args:
        scene: On what.
        dt: The longest step, s.
        method: How time is stepped.
        products: alpha dt, (k,); None takes 33 from 1e-4 to 10.

    Raises:
        ValueError: An argument breaks its rule, or the scene starts off the constraints.
        TypeError: An argument is of the wrong kind.
        RuntimeError: The reference cannot be computed.
        ImportError: SciPy is not installed.
    """
    _record.instance("scene", scene, Scene)
    dt = _record.positive("dt", dt)
    method = _record.choice("method", method, _core.METHODS)
    given = np.geomspace(1e-4, 10.0, 33) if products is None else _ladder("products", products)[::-1]

    def look(formulation: str, gain: float) -> _Look:
        run = simulate(
            scene,
            dt=dt,
            method=method,
            formulation=formulation,
            stabilization=Stabilization(alpha=gain, beta=gain),
            record=_EVERYTHING,
            stop_on=(),
        )
        return _look(run)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StabilityWarning)
        plain, *looks = [look("nullspace", 0.0), *(look("csm", x / dt) for x in given.tolist())]
    instants = np.unique(np.concatenate([each.t for each in (plain, *looks)]))
    exact = reference.confirmed(scene, np.union1d(instants, [_end(scene)]))
    along = [_along(each, exact) for each in looks]
    own = _along(plain, exact)
    finite = np.array([each.status == "completed" for each in looks])
    return StabilizationSweep(
        dt=dt,
        method=method,
        product=given,
        status=tuple(each.status for each in looks),
        holonomic=np.where(finite, [each.holonomic for each in looks], np.inf),
        nonholonomic=np.where(finite, [each.nonholonomic for each in looks], np.inf),
        error=np.array([max(each["q"], each["p"]) for each in along]),
        multipliers=np.array([each["multipliers"] for each in along]),
        without={"q and p": max(own["q"], own["p"]), "multipliers": own["multipliers"]},
    )


def _along(look: _Look, exact: reference.Reference) -> dict[str, float]:
    """The largest errors over all rows."""
    found = _errors(look, exact, exact.t[:1])
    return {name: float(size) for name, size in found["smooth"].items()}
