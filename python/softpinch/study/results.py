"""What many runs came to: `Results` wherever their rows are, `Ensemble` in memory."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..run.run import Run
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.record import plain
from .capsule import Capsule
from .estimates import Discretisation, Estimate, Mean
from .estimates import plain as number_or_array
from .outcome import Lost, Outcome
from .rows import Rows, checked_event, event_columns, happened
from .run_table import RunTable, booleans
from .setup import Setup
from .spans import Numbers


class Results(RunTable):
    """Rows of runs, and what is asked of them.

    Arrays have a row for each run, in the order of their numbers, and are read-only. Probabilities
    and counts of a study on disk take no more memory than one of its parts. Means and quantiles
    read one column: with what they compute from it they take up to 40 bytes a run, 4 GB for 10^8.

    Attributes:
        requested: How many runs were asked for.
        interrupted: Whether Ctrl-C ended it early.
        lost: Runs that an executor's workers failed to bring back.
        trajectories: Number -> `Run`, those kept.
        discretisation: Summary, or "completed" -> `Discretisation`; None without `check_dt`.
        scene: What all runs share.
        seed: Of the draws and of held noise.
        sampler: How numbers were drawn: "random", "sobol" or "latin_hypercube".
    """

    requested: int
    interrupted: bool
    # What Ctrl-C leaves out, in words.
    _under_way: str
    lost: tuple[Lost, ...]
    trajectories: Mapping[int, Run]
    discretisation: dict[str, Discretisation] | None

    def __init__(self, setup: Setup, sampling: Mapping[str, Any]) -> None:
        """Users get them from `monte_carlo`."""
        super().__init__(setup, sampling)

    @abstractmethod
    def chunks(self) -> Iterator[Ensemble]:
        """All rows, as ensembles of some; those of a study on disk one part after the other."""

    @property
    def interruption(self) -> str:
        """What Ctrl-C left, in words; empty where it did not come."""
        if not self.interrupted:
            return ""
        kept = f"interrupted: {self.runs} of {self.requested} runs are kept"
        if self.runs == self.requested:
            return f"{kept}; the work after the runs is not complete"
        return (
            f"{kept}; the runs under way ({self._under_way}) are missing, and long runs are more "
            "likely to be among them than short ones"
        )

    @abstractmethod
    def _add_trajectory(self, run: int, path: Run) -> None:
        """Keeps the path of a run, in `trajectories`."""

    def probability(
        self,
        what: str | NDArray[np.bool_] | Callable[[Any], Any] = "completed",
        confidence: float = 0.95,
    ) -> Estimate:
        """How likely something is, with Wilson's interval for independent draws (see `Estimate`).

        "completed" says that the equations of the paper's bilateral contact went on to the end, in
        which a tip may pull and never slips. "holds" says that in addition, from `summaries_after`
        on, no tip pulled and, where there is friction, none needed more (`Run.holds`). `model` says
        of which contact and friction the numbers are. Violations are noted over the whole run,
        whatever `summaries_after` is; for another coefficient of friction, without running again:
        `study.probability(lambda some: some["peak_friction_ratio"] <= mu)`.

        Args:
            what: "holds", a status ("completed"), a violation ("pulling": seen at any time),
                whether it happened in each run (runs,), or a function that says so of an ensemble:
                of a study on disk it is asked part by part.
            confidence: Of the interval.

        Raises:
            ValueError: The name is unknown, the array has another length, or it is "slipping" and
                no run has a coefficient of friction.
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
        """Status -> how many runs have it, the most frequent first."""
        total: Counter[str] = Counter()
        for part in self._read_by_part(("status",)):
            found, counts = np.unique(part["status"], return_counts=True)
            total.update({str(name): int(n) for name, n in zip(found, counts, strict=True)})
        return dict(sorted(total.items(), key=lambda item: (-item[1], item[0])))

    @property
    def model(self) -> str:
        """The model of the contact in words, for what is printed beside a probability.

        "bilateral contact, friction 0.8"; "any friction" without a coefficient, "varied friction"
        where runs differ in it.
        """
        friction = self.scene.friction
        if "friction" in self._setup.shapes:
            return "bilateral contact, varied friction"
        return (
            f"bilateral contact, {'any friction' if friction is None else f'friction {friction:g}'}"
        )

    def mean(self, name: str | NDArray[np.bool_]) -> Mean:
        """The mean of a number over the runs in which it is finite, with its standard error.

        Sums are those of `math.fsum`, rounded once. It takes up to 40 bytes of memory a run.

        Args:
            name: A summary or parameter of one number ("peak_rotation"), or one of several
                ("final_state.theta", "disturbances.0.force.1"); "holds" or booleans (runs,), whose
                mean is the share of true ones.

        Raises:
            ValueError: It was not computed (the message says how to ask for it, and what there is),
                the name is unknown, or stands for several numbers.
        """
        if not isinstance(name, str):
            return Mean.of(booleans("name", name, self.runs).astype(np.float64))
        return Mean.of(self._numbers(name))

    def quantile(self, name: str, q: float | Sequence[float]) -> Any:
        """Quantiles of a number over the runs in which it is finite, by `numpy.quantile`.

        It takes up to 40 bytes of memory a run.

        Args:
            name: As for `mean`.
            q: One or several, from 0 to 1.

        Returns:
            A float, or (len(q),); NaN where it is finite in no run.

        Raises:
            ValueError: It was not computed (the message says how to ask for it, and what there is),
                the name is unknown or stands for several numbers, or a q is outside 0 to 1.
        """
        wanted = checks.array("q", np.atleast_1d(checks.numbers("q", q)), ("k",))
        if ((wanted < 0) | (wanted > 1)).any():
            raise ValueError(f"q = {checks.shown(q)}: must be from 0 to 1")
        values = self._numbers(name)
        # Adding 0.0 takes the sign off a zero: which of 0.0 and -0.0 comes out is chance.
        kept = values[np.isfinite(values)] + 0.0
        found = np.full(len(wanted), np.nan)
        if len(kept):
            # Between neighbours further apart than the largest double it is infinite or NaN.
            with np.errstate(over="ignore", invalid="ignore"):
                found = np.quantile(kept, wanted)
        return float(found[0]) if np.ndim(q) == 0 else read_only(found)

    def _numbers(self, name: str) -> Floats:
        """A column of single numbers (runs,), in no special order."""
        entry, place = self._setup.schema.locate(name)
        values = self._column(entry)
        return values.reshape(len(values), -1)[:, place].astype(np.float64)

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
        run = checks.integer("run", run, 0)
        values = self._varied_values(run)
        recorded = (record,) if isinstance(record, str) else record
        return self._setup.replay(run, values, recorded, every)

    def scene_of(self, run: int) -> Scene:
        """The scene of one run, as `simulate` takes it.

        Raises:
            IndexError: There is no such run.
        """
        run = checks.integer("run", run, 0)
        return self._setup.varied.at(self._varied_values(run), run)

    @abstractmethod
    def failures(self) -> Sequence[Capsule]:
        """The runs that did not complete, each replayable alone."""

    def provenance(self) -> dict[str, Any]:
        """What made these results, as plain data."""
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

    def to_pandas(self) -> Any:
        """A pandas DataFrame with a row for each run; needs the extra `study`.

        A field or summary of several numbers has a column for each. `attrs` has "units" (column ->
        unit) and "provenance".
        """
        from .export import to_pandas

        return to_pandas(self._setup.schema, self.to_dict(), self.provenance())

    def to_xarray(self) -> Any:
        """An xarray Dataset over the runs; needs the extra `study`.

        Every variable has its unit in `attrs`; the dataset's `attrs` have the provenance.
        """
        from .export import to_xarray

        return to_xarray(self._setup.schema, self.to_dict(), self.provenance())


class Ensemble(Results):
    """The result of `monte_carlo` without a store: arrays with a row for each run, read-only.

    Attributes:
        requested: How many runs were asked for; more than there are rows where Ctrl-C, `stop_when`
            or lost workers ended it.
        interrupted: Whether Ctrl-C did, or cut short `discretisation` or `trajectories`.
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
        """Users get ensembles from `monte_carlo`."""
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
        """How many rows there are."""
        return len(self._rows)

    def _read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {name: self._columns[name] for name in names}

    def _read_by_part(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        yield self._read(names)

    def _rows_of(self, runs: Numbers) -> Rows:
        return self._rows.select(np.searchsorted(self.run, runs))

    def chunks(self) -> Iterator[Ensemble]:
        """All rows, at once."""
        yield self

    def _evenly_spaced(self, most: int) -> Numbers:
        rows = np.linspace(0, self.runs - 1, min(most, self.runs)).astype(int)
        chosen: Numbers = self.run[np.unique(rows)]
        return chosen

    def _add_trajectory(self, run: int, path: Run) -> None:
        self.trajectories[run] = path

    def has(self, run: int) -> bool:
        """Whether there is a row of this run."""
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
        """The runs that did not complete, each with all that replays it alone."""
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
        """Through the constructor: unpickled arrays would be writable."""
        return _rebuild, (
            (self._setup, self._sampling, self._rows),
            {
                "requested": self.requested,
                "outcome": Outcome(self.interrupted, self.lost, self._under_way),
                "trajectories": self.trajectories,
                "discretisation": self.discretisation,
            },
        )

    def __repr__(self) -> str:
        """Counts of the statuses, and what was computed."""
        counts = ", ".join(f"{count} {name}" for name, count in self.counts().items()) or "no runs"
        cut = f" of {self.requested} requested" if self.requested != self.runs else ""
        stopped = ", interrupted" if self.interrupted else ""
        return (
            f"<Ensemble of {self.runs} runs{cut}: {counts}{stopped}; "
            f"{', '.join(self._setup.summaries) or 'no summaries'}>"
        )


def _rebuild(what: tuple[Any, ...], how: Mapping[str, Any]) -> Ensemble:
    return Ensemble(*what, **how)
