"""The results of many runs: `Results` for any storage, and `Ensemble` in memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run import Options, Request, Run
from ..scene.scene import Scene
from ..support import Floats, NotRecordedError, Recordable, checks, plain, read_only
from ..support.display import Shown, ShownTable
from . import tables
from .capsule import Capsule
from .engine import Lost
from .estimates import Discretisation, Estimate, Mean, number_or_array
from .gradients import Gradients
from .rows import HOLDS, Numbers, Rows, Spans, checked_event, event_columns, happened, is_friction
from .spec import StudySpec

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

# Messages differ in length, so NumPy stores them as objects.
Texts = NDArray[np.object_]

# A notebook shows the distributions of so many runs at most; a study of more would have to be read.
_SHOWN_RUNS = 200_000
# Largest number of components that a notebook shows of an entry.
_SHOWN_COLUMNS = 4


class Results(Shown, ABC):
    """The results of many runs, with one row for each run, and statistics of them.

    Arrays are read-only, and their rows are sorted by the numbers of the runs. `results["name"]` is
    an entry of `to_dict`: a summary, a varied path, or another one. For a study on disk,
    probabilities and counts need no more memory than one part of it. Means and quantiles read one
    column and need up to 40 bytes for each run, 4 GB for 10^8 runs.

    Attributes:
        requested: The number of requested runs.
        interrupted: Whether Ctrl-C stopped the runs, or the work on `discretisation`,
            `trajectories` or `gradients`.
        lost: Runs that an executor's workers failed to compute.
        trajectories: Run number -> `Run`, the recorded trajectories.
        discretisation: Summary, "completed" or "holds" -> `Discretisation`; None without
            `check_dt`.
        scene: The scene that all runs share, apart from the varied values.
        seed: Seed of the draws and of held noise.
        sampler: How numbers were drawn: "random", "sobol" or "latin_hypercube".
    """

    requested: int
    interrupted: bool = False
    # The number of unfinished runs that Ctrl-C discards, in words.
    _under_way: str = ""
    # The runs that have a row.
    _computed: Spans
    lost: tuple[Lost, ...] = ()
    trajectories: Mapping[int, Run]
    discretisation: dict[str, Discretisation] | None

    def __init__(self, spec: StudySpec) -> None:
        """For internal use: users get results from `monte_carlo`."""
        # Without the sources, which may be large arrays and functions that cannot be pickled.
        self._spec = spec.described()
        self.scene: Scene = spec.scene
        self.seed = spec.draws.seed
        self.sampler: str = spec.draws.sampler

    @abstractmethod
    def _read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Returns entries of `to_dict` by their names, each (runs, ...)."""

    def _read_by_part(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        """Yields entries of `to_dict` for some rows at a time, in any order of the rows."""
        yield self._read(names)

    @abstractmethod
    def _rows_of(self, runs: Numbers) -> Rows:
        """Returns the rows of some runs: increasing numbers, all in the table."""

    @abstractmethod
    def _add_trajectory(self, run: int, path: Run) -> None:
        """Adds the trajectory `path` of a run to `trajectories`."""

    @abstractmethod
    def chunks(self) -> Iterator[Ensemble]:
        """Yields all rows as ensembles; a study on disk gives one ensemble for each part."""

    @abstractmethod
    def failures(self) -> Sequence[Capsule]:
        """The runs that did not complete, as capsules, each of which can be replayed alone."""

    @property
    def runs(self) -> int:
        """The number of rows."""
        return self._computed.count

    def has(self, run: int) -> bool:
        """Whether there is a row of this run."""
        return self._computed.has(checks.integer("run", run))

    def _capsules(self, rows: Rows) -> list[Capsule]:
        return [
            Capsule(
                run=int(rows.run[k]),
                status=str(rows.columns["status"][k]),
                time=float(rows.columns["end_time"][k]),
                message=str(rows.columns["message"][k]),
                parameters={p: number_or_array(rows.columns[p][k]) for p in self._spec.shapes},
                varied=self._spec.varied,
                options=self._spec.options,
            )
            for k in range(len(rows))
        ]

    def _column(self, name: str) -> NDArray[Any]:
        return self._read((name,))[name]

    def __len__(self) -> int:
        return self.runs

    @property
    def run(self) -> NDArray[np.uint64]:
        """The numbers of the runs (runs,)."""
        return self._column("run")

    @property
    def status(self) -> NDArray[np.str_]:
        """The final status of each run (runs,); see `Run.status`."""
        return self._column("status")

    @property
    def message(self) -> Texts:
        """The status of each run in words, with numbers (runs,)."""
        return self._column("message")

    @property
    def holds(self) -> NDArray[np.bool_]:
        """Whether each run's grasp held (runs,); see `Run.holds`."""
        return self._column(HOLDS)

    @property
    def end_time(self) -> Floats:
        """The last instant of each run (runs,), s, on the clock of the scene."""
        return self._column("end_time")

    @property
    def failure_time(self) -> Floats:
        """The last instant of each run that did not complete (runs,), s; NaN for completed runs."""
        return self._column("failure_time")

    @property
    def steps(self) -> NDArray[np.uint64]:
        """The number of steps of each run (runs,)."""
        return self._column("steps")

    @property
    def violations(self) -> dict[str, Floats]:
        """Violation -> the time at which each run first had it (runs,), s; NaN for never."""
        found = self._read([f"first_{name}" for name in _core.VIOLATIONS])
        return {name.removeprefix("first_"): times for name, times in found.items()}

    @property
    def parameters(self) -> dict[str, Floats]:
        """Path -> the varied values of each run (runs, ...)."""
        return self._read(tuple(self._spec.shapes))

    @property
    def summaries(self) -> dict[str, Floats]:
        """Name -> (runs, ...), the computed summaries.

        Summaries use the states at the ends of steps. With `tolerance` they also use instants
        inside a step at which a tip seemed to separate and return. They are NaN if the run ended
        before `summaries_after`, except `margin`.

        - final_state: q, then p, at the last instant (runs, 18).
        - peak_rotation: The largest |theta|, rad.
        - min_compression: The smallest d_n of both tips, m.
        - peak_friction_angle: The largest atan2(|lambda^N|, lambda^H) of both contacts, rad; above
          90 degrees if a tip pulls.
        - peak_friction_ratio: The largest |lambda^N| / lambda^H of both contacts, which is the
          coefficient of friction that the grasp needs; inf if a tip pulls, or if lambda^H is zero
          and lambda^N is not.
        - pulling_time: The total time during which a tip pulls, s. A step counts in full if a tip
          pulls at both of its ends, and by half if at one end. Zero in unilateral contact.
        - slip_distance: The distance that the faces slide over the tips, both contacts together, m.
          Zero in bilateral contact.
        - free_time: The total time during which a tip is free, s. Zero in bilateral contact.
        - margin: How far the grasp was from its loss, without unit; `margin > 0` is `holds`. For a
          completed run the smallest distance to all that makes `holds` false, which counts forces
          in E a^2 of the tip, lengths in its radius a, and tilts in 90 degrees; docs/ensembles.md
          lists these distances. A run that ended early has minus the share of its duration that was
          missing, plus the smallest distance if that is negative.
        - settling_time: The time from `summaries_after`, or from the start, until the speed of the
          object's faces stays below `settling_band`, s. The speed is the root mean square of both
          faces' middles. It is inf if the speed is above the band at the end, or if the run did not
          complete.
        - max_residual: The largest |C| of the four constraints, C^H in m and C^N in m/s.
        - energy_closure: The largest error of the energy ledger, J.
        - peak_torque: The largest torque on either finger, N m: of the PID, or one that drives it.
        """
        return self._read(self._spec.summaries)

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name in self._spec.schema.entries:
            return self._column(name)
        if name in ("final_state", *_core.SUMMARIES):
            wanted = (*self._spec.summaries, name)
            raise KeyError(f"{name} was not computed: pass summaries={wanted!r}")
        known = checks.quoted((*self._spec.summaries, *self._spec.shapes))
        raise KeyError(f"{checks.shown(name)}: must be one of {known}")

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """All entries by their names, each (runs, ...).

        The entries are run, status, message, end_time, failure_time, steps, holds, the varied
        values by their paths, the violations as first_pulling, ..., and the summaries.
        """
        return self._read(tuple(self._spec.schema.entries))

    def happened(self, what: str) -> NDArray[np.bool_]:
        """Whether an event happened in each run (runs,); names and errors as of `probability`."""
        what = checked_event("what", what, self.scene, self._spec.shapes)
        return read_only(happened(self._read(event_columns(what)), what))

    def _tables(self) -> Iterator[ShownTable]:
        if not self.runs:
            return
        shares = {name: self._estimate(n) for name, n in self.counts().items()}
        yield tables.probabilities({**shares, HOLDS: self.probability(HOLDS)})
        entries = self._spec.schema.entries
        columns = [entries[name].columns for name in (*self._spec.shapes, *self._spec.summaries)]
        few = [units for units in columns if len(units) <= _SHOWN_COLUMNS]
        if few and self.runs <= _SHOWN_RUNS:
            units = {name: unit for one in few for name, unit in one.items()}
            yield tables.distributions(self, units)

    @property
    def interruption(self) -> str:
        """The effect of Ctrl-C in words; empty if the results were not interrupted."""
        if not self.interrupted:
            return ""
        kept = f"interrupted: {self.runs} of {self.requested} runs are kept"
        if self.runs == self.requested:
            return f"{kept}; the work after the runs is not complete"
        bias = "a long run is more likely to be missing than a short one"
        return f"{kept}; unfinished runs ({self._under_way}) are missing, and {bias}"

    def probability(
        self,
        what: str | NDArray[np.bool_] | Callable[[Any], Any] = "completed",
        confidence: float = 0.95,
    ) -> Estimate:
        """The probability of an event, with its confidence interval (see `Estimate`).

        The interval is Wilson's; in a study with `stop_when`, it is one of a confidence sequence,
        and `Estimate.interval` says so.

        "completed" means that the run reached its end. In bilateral contact, whose tips pull and
        never slip, a completed run need not be a held grasp: that is "holds", see `Run.holds`.
        `model` describes the contact and the friction. Violations count over the whole run,
        regardless of `summaries_after`. In bilateral contact the probability for another
        coefficient of friction needs no new runs:
        `study.probability(lambda some: some["peak_friction_ratio"] <= mu)`.

        Args:
            what: The event: "holds", a status ("completed"), a violation at any time ("pulling"),
                booleans (runs,), or a function from an ensemble to such booleans, which a study on
                disk calls once for each part.
            confidence: The confidence level of the interval.

        Raises:
            ValueError: The name is unknown, the array has the wrong length, the name is "slipping"
                and no run has a coefficient of friction, or it is "opened" or "lost" in bilateral
                contact.
        """
        confidence = checks.share("confidence", confidence)
        if isinstance(what, str):
            what = checked_event("what", what, self.scene, self._spec.shapes)
            found = [happened(part, what) for part in self._read_by_part(event_columns(what))]
        elif callable(what):
            found = [tables.booleans("what", what(some), len(some)) for some in self.chunks()]
        else:
            found = [tables.booleans("what", what, self.runs)]
        count = sum(int(np.count_nonzero(part)) for part in found)
        return self._estimate(count, confidence)

    def _estimate(self, count: int, confidence: float = 0.95) -> Estimate:
        """The probability of an event that happened in `count` runs."""
        of = Estimate.at_every_look if self._spec.stop_when else Estimate.counted
        missing = max(0, self.requested - self.runs)
        return of(count, self.runs, confidence)._replace(missing=missing)

    def counts(self) -> dict[str, int]:
        """Status -> the number of runs with this status, the most frequent status first."""
        total: Counter[str] = Counter()
        for part in self._read_by_part(("status",)):
            total.update(part["status"].tolist())
        return dict(sorted(total.items(), key=lambda item: (-item[1], item[0])))

    @property
    def model(self) -> str:
        """Contact and friction in words, such as "unilateral contact, friction 0.5"."""
        friction = self.scene.friction
        if any(map(is_friction, self._spec.shapes)):
            words = "varied friction"
        elif friction is None:
            words = "any friction"
        elif isinstance(friction, tuple):
            words = f"friction {friction[0]:g} right and {friction[1]:g} left"
        else:
            words = f"friction {friction:g}"
        return f"{self.scene.contact} contact, {words}"

    def mean(self, name: str | NDArray[np.bool_]) -> Mean:
        """The mean of a column over the runs in which it is finite, with its standard error.

        Args:
            name: A summary or varied value ("peak_rotation"); one number of an entry with several
                ("final_state.theta", "disturbances.0.force.1"); or "holds" or booleans (runs,),
                whose mean is the share of true values.

        Raises:
            ValueError: The name is unknown, has several numbers, or is a summary that was not
                computed; the message lists the computed columns.
        """
        if not isinstance(name, str):
            return Mean.of(tables.booleans("name", name, self.runs).astype(np.float64))
        return Mean.of(self._numbers(name))

    def quantile(self, name: str, q: float | Sequence[float]) -> Any:
        """Quantiles of a column, as named for `mean`, over the runs in which it is finite.

        For one probability `q`, from 0 to 1, it is a float, for several an array (len(q),), by
        `numpy.quantile`; NaN if the column is finite in no run.
        """
        wanted = checks.array("q", np.atleast_1d(checks.numbers("q", q)), ("k",))
        if ((wanted < 0) | (wanted > 1)).any():
            raise ValueError(f"q = {checks.shown(q)}: must be from 0 to 1")
        values = self._numbers(name)
        # Adding 0.0 turns -0.0 into 0.0, because the order of the rows would decide between them.
        kept = values[np.isfinite(values)] + 0.0
        found = np.full(len(wanted), np.nan)
        if len(kept):
            # Interpolation overflows if two neighbours differ by more than the largest double.
            with np.errstate(over="ignore", invalid="ignore"):
                found = np.quantile(kept, wanted)
        return float(found[0]) if np.ndim(q) == 0 else read_only(found)

    def _numbers(self, name: str) -> Floats:
        """The numbers of a column (runs,), in any order."""
        entry, place = self._spec.schema.locate(name)
        values = self._column(entry)
        return values.reshape(len(values), -1)[:, place].astype(np.float64)

    def replay(
        self,
        run: int,
        record: Recordable | Sequence[Recordable] = _core.RECORDABLE,
        every: int = 1,
        times: ArrayLike | None = None,
    ) -> Run:
        """Simulates one run again with the same bits; the arguments are those of `simulate`.

        Instants of `times` outside the run's duration are left out.
        """
        scene, own = self.scene_of(run), self._spec.options
        if times is not None:
            times, start = checks.times("times", times), scene.start().time
            inside = times[(times >= start) & (times <= start + scene.duration)]
            # The end of the run, if none is inside.
            times = inside if len(inside) else [start + scene.duration]
        how = own.numerics() | {"record": record, "every": every, "times": times}
        options = Options.checked(**how, summaries_after=own.summaries_after)
        return Run(scene, options, Request(scene, options).compute())

    def scene_of(self, run: int) -> Scene:
        """The scene of one run with its varied values, for `simulate`."""
        run = checks.integer("run", run, 0)
        if not self.has(run):
            raise IndexError(f"run {checks.shown(run)} is not among the {self.runs} runs computed")
        found = self._rows_of(np.array([run], np.uint64)).columns
        return self._spec.varied.at({path: found[path][0] for path in self._spec.shapes}, run)

    def provenance(self) -> dict[str, Any]:
        """The settings and software versions behind these results, as plain data."""
        spec = self._spec
        return {
            "softpinch": _core.__version__,
            "results_version": _core.RESULTS_VERSION,
            "numpy": np.__version__,
            "simd": _core.simd_level(),
            "scene": self.scene.to_dict(),
            "seed": self.seed,
            "sampling": spec.draws.describe(),
            "runs": self.runs,
            "requested": self.requested,
            "interrupted": self.interrupted,
            **{name: plain(value) for name, value in spec.options.numerics().items()},
            "summaries": list(spec.summaries),
            "summaries_after": spec.options.summaries_after,
            "settling_band": spec.band,
        }

    def to_pandas(self) -> DataFrame:
        """A pandas DataFrame with a row for each run; needs the extra `study`.

        The index is the run's number. An entry with several numbers has one column for each number.
        `attrs` has "units" (column -> unit; "1" for numbers without a unit, "" for text) and
        "provenance".
        """
        return tables.to_pandas(self)

    def to_xarray(self) -> Dataset:
        """An xarray Dataset over the dimension `run`, a variable for each entry; needs `study`.

        Labelled axes, such as the 18 numbers of a state, are dimensions with labels; the others of
        an entry are "<entry>.index", "<entry>.index_2" and so on. Every variable has its unit in
        `attrs["units"]`. If the numbers of an entry have different units, an extra coordinate has
        the units, such as `state_unit` for the axis `state`. The attributes of the dataset are
        numbers and text that every netCDF format supports; `provenance` is JSON.
        """
        return tables.to_xarray(self)


class Ensemble(Results):
    """The result of `monte_carlo` in memory; fewer rows than `requested` if it ended early."""

    _gradients: Gradients | None = None

    def __init__(self, spec: StudySpec, rows: Rows, *, requested: int) -> None:
        """For internal use: users get ensembles from `monte_carlo`."""
        super().__init__(spec)
        self._rows = rows
        self.requested = requested
        self.trajectories: dict[int, Run] = {}
        self.discretisation = None
        self._computed = Spans.of(rows.run)
        columns = rows.entries()
        self._columns = {name: read_only(columns[name]) for name in spec.schema.entries}

    @property
    def gradients(self) -> Gradients:
        """Summary -> path -> the derivatives (runs, ...), if `monte_carlo` had `gradients`."""
        if self._gradients is None:
            advice = "pass gradients=(summary, ...) to monte_carlo"
            raise NotRecordedError(f"no gradients were computed: {advice}")
        return self._gradients

    def _read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {name: self._columns[name] for name in names}

    def _rows_of(self, runs: Numbers) -> Rows:
        return self._rows.select(np.searchsorted(self.run, runs))

    def chunks(self) -> Iterator[Ensemble]:
        """Yields this ensemble."""
        yield self

    def _add_trajectory(self, run: int, path: Run) -> None:
        self.trajectories[run] = path

    def failures(self) -> list[Capsule]:
        """The runs that did not complete, as capsules, each of which can be replayed alone."""
        return self._capsules(self._rows.select(self.status != "completed"))

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for column in self._columns.values():
            read_only(column)

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {name}" for name, count in self.counts().items()) or "no runs"
        cut = f" of {self.requested} requested" if self.requested != self.runs else ""
        stopped = ", interrupted" if self.interrupted else ""
        summaries = ", ".join(self._spec.summaries) or "no summaries"
        return f"<Ensemble of {self.runs} runs{cut}: {counts}{stopped}; {summaries}>"
