"""`rare_event`: the probability of an event that plain runs hardly ever show, with its interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from . import _core
from .run.options import Options, names
from .scene import usual
from .scene.control import SampledController
from .scene.disturbance import Noise, Sampled
from .scene.scene import Scene, State
from .study.capsule import Capsule
from .study.distributions import LogNormal, Normal
from .study.engine import how_many_threads, on_threads
from .study.estimates import number_or_array
from .study.results import Ensemble
from .study.rows import Rows
from .study.sources import Key
from .study.spec import SUMMARIES, StudySpec
from .study.subset import Found, Level, estimate
from .support import checks
from .support.arrays import Floats
from .support.choices import Summary
from .support.errors import StabilityWarning, StoreError, warn
from .support.extras import require
from .support.progress import Report, reporting
from .support.result import Result, same

RareMethod: TypeAlias = Literal["auto", "subset", "splitting", "importance"]
Event: TypeAlias = str | tuple[str, str, float] | Callable[[Ensemble], Any]

_OPTIONS = "dt tolerance max_steps integrator formulation stabilization stop_on summaries_after"
# Values beyond so many standard deviations from the medians are not drawn.
_FARTHEST = 7.0
# A `Noise` with more samples stays random in each run.
_MOST_SAMPLES = 4000


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RareEvent(Result):
    """The probability of a rare event, from `rare_event`.

    Attributes:
        probability: The estimate; 0 if the levels did not reach the event.
        interval: Its 95 % confidence interval, log-normal with `cov` and 15 % more. If the
            probability is 0, the upper end is a bound that holds if the levels lead to the event.
        cov: Coefficient of variation of the estimate, with the correlation of the chains.
        levels: The levels on the way to the event, `Level`.
        runs: Number of computed runs.
        method: "subset", "splitting" or "importance".
        warnings: Reasons to doubt the estimate, in words.
        design_point: Path -> value in the computed run with the event whose parameters are the
            likeliest, measured in the standard normal space.
        importance: Column -> its share of the way from the medians to the event; together 1.
        sensitivity: The derivative of ln(probability) by each parameter of a `Normal` or
            `LogNormal`, such as "friction.mean"; NaN where its deviation is 0.
        events: The computed runs with the event, as an ensemble.
        interrupted: Whether Ctrl-C ended the computation; finished levels are kept.
    """

    probability: float
    interval: tuple[float, float]
    cov: float
    levels: tuple[Level, ...]
    runs: int
    method: str
    warnings: tuple[str, ...]
    design_point: dict[str, Any]
    importance: dict[str, float]
    sensitivity: dict[str, Any]
    events: Ensemble
    interrupted: bool

    def __eq__(self, other: object) -> bool:
        # An ensemble equals itself only, and the other numbers follow from its runs.
        if not isinstance(other, RareEvent):
            return NotImplemented
        return same(*({**one._values(), "events": None} for one in (self, other)))

    __hash__ = Result.__hash__

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.probability:.4g} (95 %: {low:.3g} to {high:.3g}), {self.runs} runs"

    @property
    def plain_runs(self) -> float:
        """The number of plain runs with the same coefficient of variation; inf for 0."""
        if self.probability == 1.0:
            return float(self.runs)
        return (1.0 / self.probability - 1.0) / self.cov**2 if self.probability else math.inf

    def failures(self) -> list[Capsule]:
        """The computed runs with the event, as capsules, each of which can be replayed alone."""
        return self.events._capsules(self.events._rows)


def rare_event(
    scene: Scene,
    vary: Mapping[Key, Any],
    event: Event = "lost",
    runs: int = 30_000,
    seed: int = 0,
    method: RareMethod = "auto",
    *,
    summaries: Summary | Sequence[Summary] = (),
    threads: int | None = None,
    progress: bool | Report = True,
    store: str | Path | None = None,
    **options: Any,
) -> RareEvent:
    """The probability of a rare event in runs of a scene, such as the loss of the object.

    The same arguments give the same bits, for any number of threads. Ctrl-C keeps finished levels.

    Args:
        scene: The scene that all runs share. Forces and moments of a `Noise` are drawn as the other
            random numbers are. A `Noise` that shakes the hand stays random in each run.
        vary: Path -> distribution, as for `monte_carlo`; it must have quantiles (`ppf`).
        event: "lost" is `margin` <= 0; (column, ">" or "<", threshold) is about a summary or a
            component of one, such as ("peak_rotation", ">", 0.3); or a function from an `Ensemble`
            to numbers (runs,), continuous if possible, which are at most 0 where the event happens.
            A run with NaN counts as a run with the event.
        runs: The largest number of runs, at least 1000.
        seed: Seed of all random numbers.
        method: "subset" simulation by levels; "splitting", in which half of the steps draw the
            `Noise` anew from a random instant on; "importance", which weights independent runs
            about the runs with the event that subset simulation found. "auto" is "importance" for
            up to 12 random numbers, else the better one of both, or "subset" below 100 runs each.
        summaries: Summaries to compute for an `event` that is a function.
        threads: Number of threads; None takes as many as the process may use.
        progress: As for `monte_carlo`, with the largest number of runs; the bar names the level.
        store: A folder for the runs, as Parquet files. A repeated call reads those that it has, and
            computes the others. These runs are no independent draws.
        options: `dt`, `tolerance`, `formulation`, `stabilization`, `stop_on`, `max_steps` and
            `summaries_after` as for `monte_carlo`, and `integrator`, which is `method` there.

    Raises:
        ValueError: An argument breaks its rule, or a value within 7 standard deviations from the
            medians that of its field. Errors come before anything is computed.
        TypeError: An argument is of the wrong kind.
        ImportError: SciPy is not installed, or what a `store` needs (extra `study`).
        StoreError: `store` cannot be written, or holds other runs.
    """
    checks.instance("scene", scene, Scene)
    for name in options.keys() - {*_OPTIONS.split()}:
        raise TypeError(f"rare_event: {name} is unknown: give options out of {_OPTIONS}")
    integrator = checks.choice("integrator", options.pop("integrator", "rk4"), _core.METHODS)
    checked = Options.checked(method=integrator, **options)
    method = checks.choice("method", method, get_args(RareMethod))
    runs = checks.integer("runs", runs, 1000, 10**9)
    checks.instance("vary", vary, Mapping, "a mapping from paths to distributions")
    for key, value in vary.items():
        if not hasattr(value, "ppf"):
            rule = "must be a distribution with quantiles, such as sp.Normal(1.0, 0.1)"
            raise TypeError(f"vary[{checks.shown(key)}] = {checks.shown(value)}: {rule}")
    distance, column = _distance(event)
    asked = names("summaries", summaries, SUMMARIES)
    asked += tuple(name for name in SUMMARIES if name == column.split(".")[0])
    sampled, drawn, instants = _with_samples(scene, vary)
    spec = StudySpec.checked(sampled, checked, runs=runs, seed=seed, vary=drawn, summaries=asked)
    if column:
        spec.schema.locate(column, "event[0]")
    runner = _Runner(spec, distance, how_many_threads(threads), instants)
    if not runner.dimensions:
        raise ValueError("vary is empty: must have a distribution, or the scene a Noise of forces")
    if method == "splitting" and runner.times is None:
        raise ValueError('method = "splitting": needs a Noise of forces in Scene.disturbances')
    if _own_randomness(sampled):
        if method == "importance":
            rule = "needs runs without a noise, lost samples or jitter that stay random"
            raise ValueError(f'method = "importance": {rule}; take "subset"')
        method = "subset" if method == "auto" else method
    usual.warn(scene)
    runner.check()
    with runner.keeping(store), reporting(progress, lambda: runner.stages[-1]) as runner.report:
        return runner.result(method)


def _distance(event: Event) -> tuple[Callable[[Ensemble], Any], str]:
    """The function that gives the distances of runs to the event, and its column or ""."""
    if callable(event):
        return event, ""
    lost = isinstance(event, str) and event == "lost"
    event = ("margin", "<", 0.0) if lost else event
    if not isinstance(event, tuple) or len(event) != 3 or not isinstance(event[0], str):
        rule = 'must be "lost", a function, or such as ("peak_rotation", ">", 0.3)'
        raise TypeError(f"event = {checks.shown(event)}: {rule}")
    name, threshold = event[0], checks.finite("event[2]", event[2])
    sign = 1.0 if checks.choice("event[1]", event[1], ("<", ">")) == "<" else -1.0

    def distance(some: Ensemble) -> Any:
        found = sign * (some._numbers(name) - threshold)
        # Equality is no event, but where the object is lost.
        return found if lost else np.where(found == 0.0, np.finfo(float).tiny, found)

    return distance, name


def _own_randomness(scene: Scene) -> bool:
    """Whether a run has random numbers of its own, beside those of its point."""
    if any(isinstance(one, Noise) for one in scene.disturbances):
        return True
    if not isinstance(scene.control, SampledController):
        return False
    blocks = (block for _, block in scene.control.blocks())
    return any(np.any(one.measure_noise) or one.loss or one.jitter for one in blocks)


def _with_samples(
    scene: Scene, vary: Mapping[Key, Any]
) -> tuple[Scene, dict[Key, Any], dict[Key, Floats]]:
    """Makes each `Noise` of forces a `Sampled` whose samples `vary`; path -> their instants."""
    paths = [path for key in vary for path in ((key,) if isinstance(key, str) else key)]
    drawn, loads = dict(vary), list(scene.disturbances)
    instants: dict[Key, Floats] = {}
    end = scene.duration + (scene.initial.time if isinstance(scene.initial, State) else 0.0)
    for k, one in enumerate(scene.disturbances):
        place = f"disturbances.{k}"
        fixed = not any(path == "duration" or path.startswith(place) for path in paths)
        if type(one) is not Noise or np.any(one.acceleration_std) or not fixed:
            continue
        stop = end if one.duration is None else min(end, one.time + one.duration)
        # A sample at the end, but for round-off, is none.
        count = math.ceil((stop - one.time) * one.rate_hz * (1.0 - 1e-12))
        if not 0 < count <= _MOST_SAMPLES:
            continue
        # A noise that ends before the run leaves no force.
        times = np.append(one.time + np.arange(count) / one.rate_hz, [stop] if stop < end else [])
        acts = (np.arange(len(times)) < count).astype(float)
        loads[k] = Sampled(times=times, force=np.zeros((len(times), 2)))
        if np.any(one.force_std):
            drawn[f"{place}.force"] = Normal(
                0.0, np.multiply.outer(acts, one.force_std * np.ones(2))
            )
            instants[f"{place}.force"] = np.repeat(times, 2)
        if one.moment_std:
            drawn[f"{place}.moment"] = Normal(0.0, one.moment_std * acts)
            instants[f"{place}.moment"] = times
    return replace(scene, disturbances=tuple(loads)), drawn, instants


class _Runner:
    """Computes runs at points of the standard normal space, and estimates the probability."""

    def __init__(
        self,
        spec: StudySpec,
        distance: Callable[[Ensemble], Any],
        threads: int,
        instants: Mapping[Key, Floats],
    ) -> None:
        self._normal = require("scipy.special", extra="study", purpose="rare_event (SciPy)").ndtr
        self._spec, self._distance, self._threads = spec, distance, threads
        self._instants = instants
        self.report: Report
        self.stages = ["rare event"]  # named by the bar
        self._writer: Any = None
        self._kept: list[Rows] = []  # from the folder, of the next calls
        self._columns: dict[Key, slice] = {}  # of the points (n, d)
        self.dimensions = self._done = self._broken = 0
        times = [np.empty(0)]
        for key, source in spec.draws.sources.items():
            size = source.dimensions("rare_event")
            self._columns[key] = slice(self.dimensions, self.dimensions + size)
            self.dimensions += size
            times.append(instants.get(key, np.full(size, np.nan)))
        self.times = np.concatenate(times) if instants else None
        # The runs with the event, and their points.
        nowhere = np.empty((0, self.dimensions))
        nothing = Rows(columns=spec.empty().columns | self._block(nowhere).columns)
        self._rows, self._points = [nothing], [nowhere]

    def _block(self, points: Floats) -> Rows:
        """The next runs, at points (n, d)."""
        uniform = self._normal(np.clip(points, -_FARTHEST, _FARTHEST))
        numbers = np.arange(self._done, self._done + len(points), dtype=np.uint64)
        columns: dict[str, Any] = {"run": numbers}
        for key, source in self._spec.draws.sources.items():
            columns |= source.split(source.from_points(uniform[:, self._columns[key]], 0))
        return Rows(columns=columns)

    def check(self) -> None:
        """Refuses distributions whose tails break the rules of their fields."""
        some = slice(None) if self.times is None else np.isnan(self.times)
        ends = _FARTHEST * np.eye(self.dimensions)[some]
        block = self._block(np.concatenate([np.zeros((1, self.dimensions)), ends, -ends]))
        advice = "; take a distribution without such a tail, as LogNormal or TruncatedNormal"
        with checks.reworded(f"vary: {_FARTHEST:g} standard deviations off, ", advice):
            self._spec.varied.check(self._spec.values(block), block.run)
            batch = self._spec.batch(block)
        if batch.warning:
            warn(batch.warning, StabilityWarning)

    @contextmanager
    def keeping(self, store: str | Path | None) -> Iterator[None]:
        """Reads the runs in a folder, and writes others there, a part for each call."""
        if store is None:
            yield
            return
        from .store import files, folder, manifest  # need this package

        path = Path(checks.path("store", store, "the path of a folder"))
        files.arrow()
        if (path / files.MANIFEST).exists():
            raise StoreError(f"{path}: holds a study: give another folder")
        described = manifest.describe(self._spec, self._spec.draws.describe()["vary"])
        lock = folder.locked(path)
        try:
            there = folder.Folder(path, self._spec, manifest.identity(described))
            self._kept = [there.rows(part) for part in there.parts]
            self._writer = folder.Writer(there, lock)
            yield
        finally:
            lock.release()

    def __call__(self, points: Floats) -> Floats:
        """Computes runs at points (n, d) in lanes, and returns their distances to the event."""
        block, done, most = self._block(points), self._done, self._spec.draws.runs
        found = [self._kept.pop(0)] if self._kept else []
        for name, drawn in block.columns.items() if found else ():
            if found[0].columns[name].tobytes() != drawn.tobytes():
                rule = "has the runs of another call: give its arguments, or another folder"
                raise StoreError(f"store: the folder {rule}")

        def accept(rows: Rows) -> bool:
            found.append(rows)
            return False

        def report(new: int, total: int) -> None:
            self.report(done + new, most)

        if not found:
            if on_threads(self._spec, [block], len(points), self._threads, report, accept):
                raise KeyboardInterrupt
            if self._writer:
                self._writer.add(found[0])
                self._writer.flush()
        rows = found[0].in_order()
        self._done += len(rows)
        values = checks.numbers("event", self._distance(Ensemble(self._spec, rows, requested=0)))
        if values.shape != (len(rows),):
            raise ValueError(f"event: gave shape {values.shape}, must give ({len(rows)},)")
        self._broken += int(np.isnan(values).sum())
        values = np.where(np.isnan(values), -np.inf, values)
        self._rows.append(rows.select(values <= 0.0))
        self._points.append(points[values <= 0.0])
        return values

    def result(self, method: str) -> RareEvent:
        """Computes the runs, and estimates the probability."""
        most, times = self._spec.draws.runs, self.times if method == "splitting" else None
        rng = np.random.Generator(np.random.Philox(self._spec.draws.seed))
        found, method = estimate(
            self, self.dimensions, most, rng, method, times, self.stages.append
        )
        warnings, value = [*found.warnings], found.probability if found.found else 0.0
        low, high = (found.end(-1.0), found.end(1.0)) if value else (0.0, found.end(1.0))
        if not value:
            # The rule of three, for the independent runs of the first level.
            high = min(high, 3.0 / found.levels[0].runs) if found.levels else 1.0
            warnings.append("not found: the upper bound holds if the levels lead to the event")
        if self._broken:
            warnings.append(f"{self._broken} runs give NaN, and count as runs with the event")
        rows, points = Rows.joined(self._rows), np.concatenate(self._points)
        nearest = np.argsort((points**2).sum(axis=1), kind="stable")[:1].tolist()
        shapes = self._spec.shapes
        importance, sensitivity = self._scores(found) if value else ({}, {})
        return RareEvent(
            probability=value,
            interval=(low, min(high, 1.0)),
            cov=found.cov if value else math.inf,
            levels=tuple(found.levels),
            runs=self._done,
            method=method,
            warnings=tuple(warnings),
            design_point={p: number_or_array(rows.columns[p][k]) for k in nearest for p in shapes},
            importance=importance,
            sensitivity=sensitivity,
            events=Ensemble(self._spec, rows, requested=len(rows)),
            interrupted=found.interrupted,
        )

    def _scores(self, found: Found) -> tuple[dict[str, float], dict[str, Any]]:
        """`RareEvent.importance`, and the mean scores d ln(density) / d parameter of the event."""
        shares: dict[str, float] = {}
        slopes: dict[str, Any] = {}
        for key, source in self._spec.draws.sources.items():
            u, value = found.points[:, self._columns[key]], source.value
            first, second = (np.average(x, 0, found.weights) for x in (u, u**2 - 1.0))
            # A choice in the middle has neither a mean nor a far tail.
            part = np.maximum(np.abs(second), first**2)
            entries = [self._spec.schema.entries[path] for path in source.paths]
            names = [n for one in entries for n in one.columns]
            # One random number may select several values.
            names, part = (
                (names, part) if len(names) == len(part) else (names[:1], part.sum()[None])
            )
            shares |= dict(zip(names, part.tolist(), strict=True))
            if not isinstance(value, Normal | LogNormal) or key in self._instants:
                continue
            unit = value.median if isinstance(value, LogNormal) else 1.0
            (centre, _), (width, std) = value._values().items()
            for name, score, scale in ((centre, first, unit), (width, second, 1.0)):
                with np.errstate(divide="ignore", invalid="ignore"):
                    mean = score.reshape(-1, *value.shape).sum(axis=0) / np.multiply(scale, std)
                    mean = np.where(np.equal(std, 0.0), np.nan, mean)
                # All components may share a parameter.
                alone = np.ndim(getattr(value, name)) == 0
                slopes[f"{', '.join(source.paths)}.{name}"] = number_or_array(
                    mean.sum() if alone else mean
                )
        total = sum(shares.values()) or 1.0
        return {n: shares[n] / total for n in sorted(shares, key=lambda n: -shares[n])}, slopes
