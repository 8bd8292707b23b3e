"""The results of many runs: `Results` for any storage, and `Ensemble` in memory."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..run.run import Run
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.choices import Recordable
from ..support.record import plain
from .capsule import Capsule
from .estimates import Discretisation, Estimate, Mean
from .estimates import plain as number_or_array
from .gradients import Gradients, WithGradients
from .outcome import Lost, Outcome
from .results_tables import status_counts
from .rows import Rows, checked_event, event_columns, happened, is_friction
from .run_table import RunTable, booleans
from .setup import Setup
from .spans import Numbers

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


class Results(RunTable):
    """The results of many runs, with one row for each run, and statistics of them.

    Arrays are read-only, and their rows are sorted by the numbers of the runs. For a study on disk,
    probabilities and counts need no more memory than one part of it. Means and quantiles read one
    column and need up to 40 bytes for each run, 4 GB for 10^8 runs.

    Attributes:
        requested: The number of requested runs.
        interrupted: Whether Ctrl-C stopped the computation early.
        lost: Runs that an executor's workers failed to compute.
        trajectories: Run number -> `Run`, the recorded trajectories.
        discretisation: Summary, "completed" or "holds" -> `Discretisation`; None without
            `check_dt`.
        scene: The scene that all runs share, apart from the varied values.
        seed: Seed of the draws and of held noise.
        sampler: How numbers were drawn: "random", "sobol" or "latin_hypercube".
    """

    requested: int
    interrupted: bool
    # The number of unfinished runs that Ctrl-C discards, in words.
    _under_way: str
    lost: tuple[Lost, ...]
    trajectories: Mapping[int, Run]
    discretisation: dict[str, Discretisation] | None

    def __init__(self, setup: Setup, sampling: Mapping[str, Any]) -> None:
        """For internal use: users get results from `monte_carlo`."""
        super().__init__(setup, sampling)

    @abstractmethod
    def chunks(self) -> Iterator[Ensemble]:
        """Yields all rows as ensembles; a study on disk gives one ensemble for each part."""

    @property
    def interruption(self) -> str:
        """The effect of Ctrl-C in words; empty if the results were not interrupted."""
        if not self.interrupted:
            return ""
        kept = f"interrupted: {self.runs} of {self.requested} runs are kept"
        if self.runs == self.requested:
            return f"{kept}; the work after the runs is not complete"
        return (
            f"{kept}; unfinished runs ({self._under_way}) are missing, and a long run is more "
            "likely to be missing than a short one"
        )

    @abstractmethod
    def _add_trajectory(self, run: int, path: Run) -> None:
        """Adds the trajectory `path` of a run to `trajectories`."""

    def probability(
        self,
        what: str | NDArray[np.bool_] | Callable[[Any], Any] = "completed",
        confidence: float = 0.95,
    ) -> Estimate:
        """The probability of an event, with Wilson's confidence interval (see `Estimate`).

        "completed" means that the run reached its end. In the paper's bilateral contact a tip may
        pull and never slips, so a completed run need not be a held grasp. "holds" means that, in
        addition, no tip pulled from `summaries_after` on and, with limited friction, no tip needed
        more friction. In unilateral contact "holds" means that the run completed and no tip is free
        at its end, whatever slipped or opened before (`Run.holds`). `model` describes the contact
        and the friction. Violations count over the whole run, regardless of `summaries_after`. In
        bilateral contact the probability for another coefficient of friction needs no new runs:
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
            what = checked_event("what", what, self.scene, self._setup.shapes)
            found = [happened(part, what) for part in self._read_by_part(event_columns(what))]
        elif callable(what):
            found = [booleans("what", what(some), len(some)) for some in self.chunks()]
        else:
            found = [booleans("what", what, self.runs)]
        count = sum(int(np.count_nonzero(part)) for part in found)
        return Estimate.counted(count, self.runs, confidence)

    def counts(self) -> dict[str, int]:
        """Status -> the number of runs with this status, the most frequent status first."""
        return status_counts(part["status"] for part in self._read_by_part(("status",)))

    @property
    def model(self) -> str:
        """The contact model in words, for reports of probabilities.

        For example "bilateral contact, friction 0.8" or "unilateral contact, friction 0.5 right and
        0.8 left"; "any friction" if the scene has no coefficient, and "varied friction" if a
        coefficient differs between runs.
        """
        friction = self.scene.friction
        if any(map(is_friction, self._setup.shapes)):
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

        Sums are exact and rounded once (`math.fsum`). The memory is up to 40 bytes for each run.

        Args:
            name: A summary or varied value ("peak_rotation"); one number of an entry with several
                ("final_state.theta", "disturbances.0.force.1"); or "holds" or booleans (runs,),
                whose mean is the share of true values.

        Raises:
            ValueError: The name is unknown, has several numbers, or is a summary that was not
                computed; the message lists the computed columns.
        """
        if not isinstance(name, str):
            return Mean.of(booleans("name", name, self.runs).astype(np.float64))
        return Mean.of(self._numbers(name))

    def quantile(self, name: str, q: float | Sequence[float]) -> Any:
        """Quantiles of a column over the runs in which it is finite, by `numpy.quantile`.

        The memory is up to 40 bytes for each run.

        Args:
            name: As for `mean`.
            q: One probability or several, from 0 to 1.

        Returns:
            A float, or an array (len(q),); NaN if the column is finite in no run.

        Raises:
            ValueError: As for `mean`, or a probability in `q` is outside 0 to 1.
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
        entry, place = self._setup.schema.locate(name)
        values = self._column(entry)
        return values.reshape(len(values), -1)[:, place].astype(np.float64)

    def replay(
        self, run: int, record: Recordable | Sequence[Recordable] = _core.RECORDABLE, every: int = 1
    ) -> Run:
        """Simulates one run again with the same bits, and returns it with its trajectory.

        Args:
            run: The number of the run.
            record: As for `simulate`.
            every: As for `simulate`.

        Raises:
            IndexError: There is no such run.
        """
        run = checks.integer("run", run, 0)
        values = self._varied_values(run)
        recorded = (record,) if isinstance(record, str) else record
        return self._setup.replay(run, values, recorded, every)

    def scene_of(self, run: int) -> Scene:
        """The scene of one run with its varied values, for `simulate`.

        Raises:
            IndexError: There is no such run.
        """
        run = checks.integer("run", run, 0)
        return self._setup.varied.at(self._varied_values(run), run)

    @abstractmethod
    def failures(self) -> Sequence[Capsule]:
        """The runs that did not complete, as capsules, each of which can be replayed alone."""

    def provenance(self) -> dict[str, Any]:
        """The settings and software versions behind these results, as plain data."""
        setup, options = self._setup, self._setup.options
        return {
            "softpinch": _core.__version__,
            "results_version": _core.RESULTS_VERSION,
            "numpy": np.__version__,
            "simd": _core.simd_level(),
            "scene": setup.scene.to_dict(),
            "seed": setup.seed,
            "sampling": self._sampling,
            "runs": self.runs,
            "requested": self.requested,
            "interrupted": self.interrupted,
            **{name: plain(value) for name, value in options.numerics().items()},
            "summaries": list(setup.summaries),
            "summaries_after": setup.after if math.isfinite(setup.after) else None,
            "settling_band": setup.band,
        }

    def to_pandas(self) -> DataFrame:
        """A pandas DataFrame with a row for each run; needs the extra `study`.

        An entry with several numbers has one column for each number. `attrs` has "units" (column ->
        unit) and "provenance".
        """
        from .export import to_pandas

        return to_pandas(self._setup.schema, self.to_dict(), self.provenance())

    def to_xarray(self) -> Dataset:
        """An xarray Dataset over the runs; needs the extra `study`.

        Every variable has its unit in `attrs`; the dataset's `attrs` have the provenance.
        """
        from .export import to_xarray

        return to_xarray(self._setup.schema, self.to_dict(), self.provenance())


class Ensemble(WithGradients, Results):
    """The result of `monte_carlo` without a store: read-only arrays with a row for each run.

    Attributes:
        requested: The number of requested runs. There are fewer rows if Ctrl-C, `stop_when` or lost
            workers ended the computation early.
        interrupted: Whether Ctrl-C stopped the runs, or the work on `discretisation` or
            `trajectories`.
    """

    def __init__(
        self,
        setup: Setup,
        sampling: Mapping[str, Any],
        rows: Rows,
        *,
        requested: int,
        outcome: Outcome = Outcome(),  # noqa: B008, it never changes
        trajectories: Mapping[int, Run] | None = None,
        discretisation: dict[str, Discretisation] | None = None,
    ) -> None:
        """For internal use: users get ensembles from `monte_carlo`."""
        super().__init__(setup, sampling)
        self._rows = rows
        self.requested = requested
        self.interrupted, self.lost, self._under_way = outcome
        self.trajectories: dict[int, Run] = dict(trajectories or {})
        self.discretisation = discretisation
        columns = rows.entries()
        self._columns = {name: read_only(columns[name]) for name in self._names}

    @property
    def runs(self) -> int:
        """The number of rows."""
        return len(self._rows)

    def _read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {name: self._columns[name] for name in names}

    def _read_by_part(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        yield self._read(names)

    def _rows_of(self, runs: Numbers) -> Rows:
        return self._rows.select(np.searchsorted(self.run, runs))

    def chunks(self) -> Iterator[Ensemble]:
        """Yields this ensemble."""
        yield self

    def _evenly_spaced(self, most: int) -> Numbers:
        rows = np.linspace(0, self.runs - 1, min(most, self.runs)).astype(int)
        chosen: Numbers = self.run[np.unique(rows)]
        return chosen

    def _add_trajectory(self, run: int, path: Run) -> None:
        self.trajectories[run] = path

    def has(self, run: int) -> bool:
        """Whether the ensemble has a row of this run."""
        if not 0 <= checks.integer("run", run) < 2**64:
            return False
        row = int(np.searchsorted(self.run, np.uint64(run)))
        return row < self.runs and bool(self.run[row] == run)

    def _varied_values(self, run: int) -> dict[str, Any]:
        if not self.has(run):
            raise IndexError(
                f"run {checks.shown(run)} is not among the {self.runs} runs of this ensemble"
            )
        row = int(np.searchsorted(self.run, np.uint64(run)))
        return {path: self._columns[path][row] for path in self._setup.shapes}

    def failures(self) -> list[Capsule]:
        """The runs that did not complete, as capsules, each of which can be replayed alone."""
        return self._capsules(np.flatnonzero(self.status != "completed"))

    def _capsules(self, rows: NDArray[np.intp]) -> list[Capsule]:
        varied, options = self._setup.varied, self._setup.options
        return [
            Capsule(
                run=int(self.run[row]),
                status=str(self.status[row]),
                time=float(self.end_time[row]),
                message=str(self.message[row]),
                parameters={
                    path: number_or_array(self._columns[path][row]) for path in self._setup.shapes
                },
                varied=varied,
                options=options,
            )
            for row in rows.tolist()
        ]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles through the constructor, because unpickled arrays would be writable."""
        return _rebuild, (
            (self._setup, self._sampling, self._rows),
            {
                "requested": self.requested,
                "outcome": Outcome(self.interrupted, self.lost, self._under_way),
                "trajectories": self.trajectories,
                "discretisation": self.discretisation,
            },
            self._gradients,
        )

    def __repr__(self) -> str:
        """The counts of the statuses, and the names of the summaries."""
        counts = ", ".join(f"{count} {name}" for name, count in self.counts().items()) or "no runs"
        cut = f" of {self.requested} requested" if self.requested != self.runs else ""
        stopped = ", interrupted" if self.interrupted else ""
        return (
            f"<Ensemble of {self.runs} runs{cut}: {counts}{stopped}; "
            f"{', '.join(self._setup.summaries) or 'no summaries'}>"
        )


def _rebuild(
    args: tuple[Any, ...], kwargs: Mapping[str, Any], gradients: Gradients | None
) -> Ensemble:
    ensemble = Ensemble(*args, **kwargs)
    ensemble._gradients = gradients
    return ensemble
