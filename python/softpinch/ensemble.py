"""What many runs came to."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from . import _core, _record
from ._record import Floats, read_only
from .capsule import Capsule
from .run import Run

if TYPE_CHECKING:
    from .montecarlo import Study
    from .scene import Scene

# Runs that one thread has under way at a time, at most.
MOST_LANES = 8
# Messages are texts; NumPy keeps them as objects.
Texts = NDArray[np.object_]


def event(field: str, name: object, scene: Scene, varied: Iterable[str]) -> str:
    """A status or a violation that runs of a scene can have; `field` is what errors call it.

    Raises:
        ValueError: It is unknown, or "slipping" where no run has a coefficient of friction: that
            nothing was noted then would pass for a grasp that never slips.
        TypeError: It is no text.
    """
    name = _record.choice(field, name, (*_core.STATUSES, *_core.VIOLATIONS))
    if name == "slipping" and scene.friction is None and "friction" not in varied:
        raise ValueError(
            f'{field} = "slipping": is noted only where there is a coefficient of friction; give '
            'Scene.friction, or vary "friction"'
        )
    return name


class Estimate(NamedTuple):
    """A probability, estimated from independent runs.

    Points of Sobol or of a Latin hypercube are not independent: their interval is that of as many
    random draws, most often too wide, and nothing promises 95 %.

    Attributes:
        value: The share of the runs.
        low: Lower end of its interval (Wilson, "Probable inference", 1927).
        high: Upper end.
        happened: How many runs it happened in.
        runs: Out of how many.
        confidence: Of the interval.
    """

    value: float
    low: float
    high: float
    happened: int
    runs: int
    confidence: float

    @classmethod
    def of(cls, happened: NDArray[np.bool_], confidence: float = 0.95) -> Self:
        """From whether it happened in each run (runs,)."""
        return cls.counted(int(np.count_nonzero(happened)), len(happened), confidence)

    @classmethod
    def counted(cls, count: int, n: int, confidence: float = 0.95) -> Self:
        """From how many of `n` runs it happened in."""
        if n == 0:
            return cls(math.nan, 0.0, 1.0, 0, 0, confidence)
        z = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
        share, square = count / n, z * z
        middle = (share + square / (2 * n)) / (1 + square / n)
        reach = z / (1 + square / n) * math.sqrt(share * (1 - share) / n + square / (4 * n * n))
        low = 0.0 if count == 0 else max(0.0, middle - reach)
        high = 1.0 if count == n else min(1.0, middle + reach)
        return cls(share, low, high, count, n, confidence)

    @property
    def half_width(self) -> float:
        """Half the interval's width."""
        return 0.5 * (self.high - self.low)

    def __str__(self) -> str:
        """Share, interval and counts."""
        interval = f"{100 * self.confidence:g} %: {self.low:.5g} to {self.high:.5g}"
        return f"{self.value:.5g} ({interval}), {self.happened} of {self.runs} runs"

    def __float__(self) -> float:
        """The share."""
        return self.value


@dataclass(frozen=True, kw_only=True)
class Discretisation:
    """How far the steps put a summary off, beside what sampling leaves open.

    Over the runs that were computed again with smaller steps and gave finite numbers both times;
    of a summary with several columns each is (columns,). Standard errors are those of independent
    draws, also where the sampler is another: then those of a mean are most often too large.

    Attributes:
        bias: Mean of (value - value with smaller steps).
        bias_error: Standard error of that mean.
        worst: Largest |value - value with smaller steps|.
        sampling_error: Standard error of the summary's mean over all runs.
        runs: How many runs were compared.
    """

    bias: Any
    bias_error: Any
    worst: Any
    sampling_error: Any
    runs: int

    @classmethod
    def of(cls, coarse: Floats, fine: Floats, every: Floats) -> Self:
        """From the values of the same runs with larger and smaller steps, and of all runs."""
        with np.errstate(invalid="ignore"):
            difference = coarse - fine
        kept = _finite(difference)
        difference = difference[kept]
        every = every[_finite(every)]
        nothing = np.full(coarse.shape[1:], np.nan)
        return cls(
            bias=_plain(difference.mean(axis=0) if len(difference) else nothing),
            bias_error=_plain(_standard_error(difference)),
            worst=_plain(np.abs(difference).max(axis=0) if len(difference) else nothing),
            sampling_error=_plain(_standard_error(every)),
            runs=int(np.count_nonzero(kept)),
        )


def _finite(values: Floats) -> NDArray[np.bool_]:
    """Which rows are finite throughout; there may be no row."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))), dtype=bool)


def _standard_error(values: Floats) -> Floats:
    if len(values) < 2:
        return np.full(values.shape[1:], np.nan)
    error: Floats = values.std(axis=0, ddof=1) / math.sqrt(len(values))
    return error


def _plain(value: Any) -> Any:
    return float(value) if np.ndim(value) == 0 else read_only(np.asarray(value))


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of runs, column by column: what the core gives."""

    run: NDArray[np.uint64]
    status: NDArray[np.str_]
    message: Texts
    t: Floats
    steps: NDArray[np.uint64]
    final_state: Floats
    violations: dict[str, Floats]
    summaries: dict[str, Floats]
    interrupted: bool = False

    @classmethod
    def of(cls, result: Mapping[str, Any], numbers: NDArray[np.uint64]) -> Self:
        """The runs of a batch that were done; `numbers` are those of all its runs.

        Threads take them in their order. So what Ctrl-C leaves out are the few under way, one a
        lane, and those never begun, which no length of theirs has chosen.
        """
        return cls(
            run=numbers[result["run"]],
            status=np.array(_core.STATUSES)[result["status"]],
            # Most runs end with the same words: they are kept once.
            message=np.array(result["messages"], dtype=object)[result["message"]],
            t=result["t"],
            steps=result["steps"],
            final_state=result["final_state"],
            violations=dict(result["violations"]),
            summaries=dict(result["summaries"]),
            interrupted=bool(result["interrupted"]),
        )

    @classmethod
    def joined(cls, tables: Sequence[Self], interrupted: bool = False) -> Self:
        """Several behind each other."""

        def together(*parts: Any) -> Any:
            if isinstance(parts[0], dict):
                return {name: together(*(part[name] for part in parts)) for name in parts[0]}
            return np.concatenate(parts) if len(parts) > 1 else parts[0]

        if not tables:
            tables = (cls._empty(),)
        columns = [f for f in cls.__dataclass_fields__ if f != "interrupted"]
        return cls(
            **{name: together(*(getattr(table, name) for table in tables)) for name in columns},
            interrupted=interrupted or any(table.interrupted for table in tables),
        )

    @classmethod
    def _empty(cls) -> Self:
        nothing = np.empty(0)
        return cls(
            run=np.empty(0, np.uint64),
            status=np.array(_core.STATUSES)[:0],
            message=np.empty(0, object),
            t=nothing,
            steps=np.empty(0, np.uint64),
            final_state=np.empty((0, 18)),
            violations=dict.fromkeys(_core.VIOLATIONS, nothing),
            summaries=dict.fromkeys(_core.SUMMARIES, nothing),
        )

    def at(self, rows: NDArray[np.intp]) -> Self:
        """Some of the rows."""

        def some(value: Any) -> Any:
            if isinstance(value, dict):
                return {name: some(part) for name, part in value.items()}
            return value[rows] if isinstance(value, np.ndarray) else value

        return type(self)(**{name: some(getattr(self, name)) for name in self.__dataclass_fields__})

    def summary(self, name: str) -> Floats:
        """A summary by its name."""
        return self.final_state if name == "final_state" else self.summaries[name]

    def happened(self, name: str) -> NDArray[np.bool_]:
        """Whether a run has this status, or saw this violation, (runs,)."""
        seen = self.status == name
        if name in self.violations:
            seen = seen | ~np.isnan(self.violations[name])
        return np.asarray(seen, dtype=bool)


class Ensemble:
    """The result of `monte_carlo`: arrays with a row for each run, read-only.

    Attributes:
        runs: How many rows there are.
        run: (runs,), their numbers.
        requested: How many were asked for; more than `runs` where Ctrl-C or `stop_when` ended it.
        interrupted: Whether Ctrl-C did, or cut short `discretisation` or `trajectories`.
        interruption: The same in words; empty without it.
        scene: What all runs share.
        seed: Of the draws and of held noise.
        sampler: How numbers were drawn: "random", "sobol" or "latin_hypercube".
        parameters: Path -> (runs, ...), what each run had of its own.
        status: (runs,), how each ended: see `Run.status`.
        message: (runs,), the same in words.
        end_time: (runs,), s, the last instant of each run on the clock of the scene.
        failure_time: (runs,), s, the same of those that did not complete; NaN for the others.
        violations: Name -> (runs,), s, when each was first seen; NaN for never.
        steps: (runs,), counted.
        summaries: Name -> (runs, ...), those asked for, of the ends of steps (and, where steps are
            free, of instants inside a step at which a tip seemed to leave and to come back). NaN
            where a run ended before `summaries_after`. `ensemble["peak_rotation"]` is the same.
            final_state: (runs, 18), q then p at the last instant.
            peak_rotation: The largest |theta|, rad.
            min_compression: The least d_n of both tips, m.
            peak_friction_angle: The largest atan2(|lambda^N|, lambda^H) of both contacts, rad:
                above 90 degrees where a tip pulls.
            settling_time: How long after `summaries_after` (or the start) the faces of the object
                went on moving faster than `settling_band`, s: the root mean square of both faces'
                middles. Infinite where they still did at the end, or the run did not complete.
            max_residual: The largest |C| of the four constraints, C^H in m and C^N in m/s.
            energy_closure: The largest error of the energy ledger, J.
            peak_torque: The largest torque on either finger, N m: of the PID, or what drives it.
        trajectories: Number -> `Run`, those kept.
        discretisation: Summary, or "completed" -> `Discretisation`; None without `check_dt`.
    """

    def __init__(
        self,
        study: Study,
        table: Table,
        *,
        requested: int,
        trajectories: Mapping[int, Run],
        discretisation: Mapping[str, Discretisation] | None,
    ) -> None:
        """Users get ensembles from `monte_carlo`."""
        self._study = study
        self._table = table
        self.requested = requested
        self.trajectories = dict(trajectories)
        self.discretisation = None if discretisation is None else dict(discretisation)
        self.interrupted = table.interrupted
        self.scene = study.scene
        self.seed = study.seed
        self.sampler: str = study.sampling["sampler"]
        self.run = read_only(table.run)
        self.status: NDArray[np.str_] = read_only(table.status)
        self.message: Texts = read_only(table.message)
        self.end_time = read_only(table.t)
        completed = self.status == "completed"
        self.failure_time = read_only(np.where(completed, np.nan, table.t))
        self.violations = {name: read_only(times) for name, times in table.violations.items()}
        self.steps = read_only(table.steps)
        self.summaries = {name: read_only(table.summary(name)) for name in study.summaries}

    @property
    def runs(self) -> int:
        """How many rows there are."""
        return len(self.run)

    def __len__(self) -> int:
        """How many rows there are."""
        return len(self.run)

    @property
    def interruption(self) -> str:
        """What Ctrl-C left, in words; empty where it did not come."""
        if not self.interrupted:
            return ""
        kept = f"interrupted: {self.runs} of {self.requested} runs are kept"
        if self.runs == self.requested:
            return f"{kept}; what was to follow them is not complete"
        return (
            f"{kept}; those under way, at most {MOST_LANES} a thread, are missing, and long runs "
            "are more often among these than short ones"
        )

    @cached_property
    def parameters(self) -> dict[str, Floats]:
        """Path -> (runs, ...), what each run had of its own."""
        return {path: read_only(value[self.run]) for path, value in self._study.values.items()}

    def __getitem__(self, name: str) -> Floats:
        """A summary, or the values of a path, (runs, ...).

        Raises:
            KeyError: It is neither; the message says how to ask for a summary.
        """
        if name in self.summaries:
            return self.summaries[name]
        if name in self.parameters:
            return self.parameters[name]
        if name in ("final_state", *_core.SUMMARIES):
            wanted = (*self._study.summaries, name)
            raise KeyError(f"{name} was not computed: pass summaries={wanted!r}")
        known = _record.quoted((*self.summaries, *self.parameters))
        raise KeyError(f"{name!r}: must be one of {known}")

    def happened(self, what: str) -> NDArray[np.bool_]:
        """Whether each run has this status, or saw this violation at any time, (runs,).

        Raises:
            ValueError: The name is unknown, or "slipping" and no run has a coefficient of friction.
        """
        return self._table.happened(event("what", what, self.scene, self.parameters))

    def probability(
        self,
        what: str | NDArray[np.bool_] | Callable[[Self], Any] = "completed",
        confidence: float = 0.95,
    ) -> Estimate:
        """How likely something is, with Wilson's interval for independent draws (see `Estimate`).

        Violations are noted over the whole run, whatever `summaries_after` is. With that, whether a
        tip slips or pulls later is in "peak_friction_angle": `ensemble.probability(
        ensemble["peak_friction_angle"] > math.atan(mu))`, and pi/2 for pulling.

        Args:
            what: A status ("completed"), a violation ("pulling": seen at any time), whether it
                happened in each run (runs,), or a function of the ensemble that says so.
            confidence: Of the interval.

        Raises:
            ValueError: The name is unknown, the array has another length, or it is "slipping" and
                no run has a coefficient of friction.
        """
        confidence = _record.finite("confidence", confidence)
        if not 0 < confidence < 1:
            raise ValueError(f"confidence = {confidence}: must be above 0 and below 1")
        if isinstance(what, str):
            return Estimate.of(self.happened(what), confidence)
        happened = np.asarray(what(self) if callable(what) else what)
        if happened.dtype != bool or happened.shape != (self.runs,):
            raise ValueError(
                f"what: must be a status, a violation or booleans ({self.runs},), not "
                f"{happened.dtype} {happened.shape}"
            )
        return Estimate.of(happened, confidence)

    def _row(self, run: int) -> int:
        run = _record.integer("run", run, 0)
        row = int(np.searchsorted(self.run, np.uint64(run)))
        if row == self.runs or self.run[row] != run:
            raise IndexError(f"run {run} is not among the {self.runs} runs of this ensemble")
        return row

    def replay(
        self,
        run: int,
        record: str | Sequence[str] = _core.RECORDABLE,
        every: int = 1,
    ) -> Run:
        """One run again, in full, to the same bits.

        Args:
            run: Its number.
            record: As for `simulate`.
            every: As for `simulate`.

        Raises:
            IndexError: There is no such run.
        """
        self._row(run)
        return self._study.replay(int(run), (record,) if isinstance(record, str) else record, every)

    def scene_of(self, run: int) -> Scene:
        """The scene of one run, as `simulate` takes it.

        Raises:
            IndexError: There is no such run.
        """
        self._row(run)
        return self._study.at(int(run))

    def failures(self) -> list[Capsule]:
        """The runs that did not complete, each with all that replays it alone."""
        return list(self._failures())

    def _failures(self) -> Iterator[Capsule]:
        varied, options = self._study.varied(), self._study.options
        for row in np.flatnonzero(self.status != "completed"):
            yield Capsule(
                run=int(self.run[row]),
                status=str(self.status[row]),
                time=float(self.failure_time[row]),
                message=str(self.message[row]),
                parameters={path: _plain(value[row]) for path, value in self.parameters.items()},
                varied=varied,
                options=options,
            )

    def counts(self) -> dict[str, int]:
        """Status -> how many runs have it, the most frequent first."""
        found, counts = np.unique(self.status, return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return {str(found[k]): int(counts[k]) for k in order}

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """Every column by its name, each (runs, ...).

        They are run, status, message, end_time, failure_time, steps, the parameters by their paths,
        the violations as first_pulling, ..., and the summaries by their names.
        """
        return {
            "run": self.run,
            "status": self.status,
            "message": self.message,
            "end_time": self.end_time,
            "failure_time": self.failure_time,
            "steps": self.steps,
            **self.parameters,
            **{f"first_{name}": times for name, times in self.violations.items()},
            **self.summaries,
        }

    def provenance(self) -> dict[str, Any]:
        """What made this ensemble, as plain data."""
        study, options = self._study, self._study.options
        return {
            "softpinch": _core.__version__,
            "results_version": _core.RESULTS_VERSION,
            "numpy": np.__version__,
            "simd": _core.simd_level(),
            "scene": study.scene.to_dict(),
            "seed": study.seed,
            "sampling": study.sampling,
            "runs": self.runs,
            "requested": self.requested,
            "interrupted": self.interrupted,
            "dt": options.dt,
            "tolerance": options.tolerance,
            "method": options.method,
            "formulation": options.formulation,
            "stabilization": options.stabilization.to_dict(),
            "stop_on": list(options.stop_on),
            "max_steps": None if options.tolerance is None else options.max_steps,
            "summaries": list(study.summaries),
            "summaries_after": study.after if math.isfinite(study.after) else None,
            "settling_band": study.band,
        }

    def to_pandas(self) -> Any:
        """A pandas DataFrame with a row for each run; needs the extra `study`.

        A field or summary of several numbers has a column for each. `attrs` has "units" (column ->
        unit) and "provenance".
        """
        from ._export import to_pandas

        return to_pandas(self)

    def to_xarray(self) -> Any:
        """An xarray Dataset over the runs; needs the extra `study`.

        Every variable has its unit in `attrs`; the dataset's `attrs` have the provenance.
        """
        from ._export import to_xarray

        return to_xarray(self)

    def __reduce__(self) -> tuple[Any, ...]:
        """Through the constructor: unpickled arrays would be writable."""
        return _rebuild, (
            self._study,
            self._table,
            self.requested,
            self.trajectories,
            self.discretisation,
        )

    def __repr__(self) -> str:
        """Counts of the statuses, and what was computed."""
        counts = ", ".join(f"{count} {name}" for name, count in self.counts().items()) or "no runs"
        cut = f" of {self.requested} requested" if self.requested != self.runs else ""
        stopped = ", interrupted" if self.interrupted else ""
        return (
            f"<Ensemble of {self.runs} runs{cut}: {counts}{stopped}; "
            f"{', '.join(self.summaries) or 'no summaries'}>"
        )


def _rebuild(
    study: Study, table: Table, requested: int, kept: Any, discretisation: Any
) -> Ensemble:
    return Ensemble(
        study, table, requested=requested, trajectories=kept, discretisation=discretisation
    )
