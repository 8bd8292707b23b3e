"""What many runs came to, wherever their rows are: in memory (`Ensemble`) or on disk (`Study`)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..run.run import Run
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.record import plain
from .columns import place as place_of
from .estimates import Discretisation, Estimate, Mean
from .rows import Rows, happened, noted
from .setup import Setup
from .spans import Numbers, Spans

if TYPE_CHECKING:
    from .capsule import Capsule
    from .ensemble import Ensemble

# Messages are texts; NumPy keeps them as objects.
Texts = NDArray[np.object_]


class Lost(NamedTuple):
    """Runs that no worker brought back.

    Attributes:
        first: The first of them.
        last: The last of them.
        runs: How many of those between are lost.
        reason: What the last attempt met.
    """

    first: int
    last: int
    runs: int
    reason: str

    @classmethod
    def of(cls, spans: Spans, reason: str) -> Lost:
        """Of some runs."""
        return cls(int(spans.edges[0, 0]), int(spans.edges[-1, 1]) - 1, spans.count, reason)

    def __str__(self) -> str:
        """Which, and why."""
        return f"runs {self.first} to {self.last} ({self.runs}): {self.reason}"


class Outcome(NamedTuple):
    """How the computing ended.

    Attributes:
        interrupted: By Ctrl-C.
        lost: What no worker brought back.
        under_way: What Ctrl-C leaves out, in words.
    """

    interrupted: bool = False
    lost: tuple[Lost, ...] = ()
    under_way: str = ""


def event(field: str, name: object, scene: Scene, varied: Iterable[str]) -> str:
    """A status or a violation that runs of a scene can have; `field` is what errors call it.

    Raises:
        ValueError: It is unknown, or "slipping" where no run has a coefficient of friction: that
            nothing was noted then would pass for a grasp that never slips.
        TypeError: It is no text.
    """
    name = checks.choice(field, name, (*_core.STATUSES, *_core.VIOLATIONS))
    if name == "slipping" and scene.friction is None and "friction" not in varied:
        raise ValueError(
            f'{field} = "slipping": is noted only where there is a coefficient of friction; give '
            'Scene.friction, or vary "friction"'
        )
    return name


class Results(ABC):
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
        self._setup = setup
        self._sampling = dict(sampling)
        self.scene = setup.scene
        self.seed = setup.seed
        self.sampler: str = sampling["sampler"]
        self._names = names(setup)

    @property
    @abstractmethod
    def runs(self) -> int:
        """How many rows there are."""

    @abstractmethod
    def _take(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Some entries of `to_dict`, each (runs, ...)."""

    @abstractmethod
    def _in_parts(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        """Some entries of `to_dict`, some rows at a time, in no special order."""

    @abstractmethod
    def chunks(self) -> Iterator[Ensemble]:
        """All rows, as ensembles of some; those of a study on disk one part after the other."""

    @abstractmethod
    def _values_of(self, run: int) -> dict[str, Any]:
        """What a run had of its own; an error where there is no such run."""

    @property
    def interruption(self) -> str:
        """What Ctrl-C left, in words; empty where it did not come."""
        if not self.interrupted:
            return ""
        kept = f"interrupted: {self.runs} of {self.requested} runs are kept"
        if self.runs == self.requested:
            return f"{kept}; what was to follow them is not complete"
        return (
            f"{kept}; those under way, {self._under_way}, are missing, and long runs "
            "are more often among these than short ones"
        )

    @abstractmethod
    def _spread_out(self, most: int) -> Numbers:
        """The numbers of some runs, evenly among all, not more than so many."""

    @abstractmethod
    def _keep(self, run: int, path: Run) -> None:
        """Keeps the path of a run, in `trajectories`."""

    @abstractmethod
    def has(self, run: int) -> bool:
        """Whether there is a row of this run."""

    @abstractmethod
    def _some(self, runs: Numbers) -> Rows:
        """The rows of some runs, increasing, all of them there."""

    def _column(self, name: str) -> NDArray[Any]:
        return self._take((name,))[name]

    def __len__(self) -> int:
        """How many rows there are."""
        return self.runs

    @property
    def run(self) -> NDArray[np.uint64]:
        """(runs,), their numbers."""
        return self._column("run")

    @property
    def status(self) -> NDArray[np.str_]:
        """(runs,), how each ended: see `Run.status`."""
        return self._column("status")

    @property
    def message(self) -> Texts:
        """(runs,), the same in words."""
        return self._column("message")

    @property
    def end_time(self) -> Floats:
        """(runs,), s, the last instant of each run on the clock of the scene."""
        return self._column("end_time")

    @property
    def failure_time(self) -> Floats:
        """(runs,), s, the same of those that did not complete; NaN for the others."""
        return self._column("failure_time")

    @property
    def steps(self) -> NDArray[np.uint64]:
        """(runs,), counted."""
        return self._column("steps")

    @property
    def violations(self) -> dict[str, Floats]:
        """Name -> (runs,), s, when each was first seen; NaN for never."""
        found = self._take([f"first_{name}" for name in _core.VIOLATIONS])
        return {name.removeprefix("first_"): times for name, times in found.items()}

    @property
    def parameters(self) -> dict[str, Floats]:
        """Path -> (runs, ...), what each run had of its own."""
        return self._take(tuple(self._setup.shapes))

    @property
    def summaries(self) -> dict[str, Floats]:
        """Name -> (runs, ...), those asked for; `results["peak_rotation"]` is the same.

        Of the ends of steps (and, where steps are free, of instants inside a step at which a tip
        seemed to leave and to come back). NaN where a run ended before `summaries_after`.

        - final_state: (runs, 18), q then p at the last instant.
        - peak_rotation: The largest |theta|, rad.
        - min_compression: The least d_n of both tips, m.
        - peak_friction_angle: The largest atan2(|lambda^N|, lambda^H) of both contacts, rad: above
          90 degrees where a tip pulls.
        - settling_time: How long after `summaries_after` (or the start) the faces of the object
          went on moving faster than `settling_band`, s: the root mean square of both faces'
          middles. Infinite where they still did at the end, or the run did not complete.
        - max_residual: The largest |C| of the four constraints, C^H in m and C^N in m/s.
        - energy_closure: The largest error of the energy ledger, J.
        - peak_torque: The largest torque on either finger, N m: of the PID, or what drives it.
        """
        return self._take(self._setup.summaries)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A summary, the values of a path, or another entry of `to_dict`, (runs, ...).

        Raises:
            KeyError: It is none; the message says how to ask for a summary.
        """
        if name in self._names:
            return self._column(name)
        if name in ("final_state", *_core.SUMMARIES):
            wanted = (*self._setup.summaries, name)
            raise KeyError(f"{name} was not computed: pass summaries={wanted!r}")
        known = checks.quoted((*self._setup.summaries, *self._setup.shapes))
        raise KeyError(f"{checks.shown(name)}: must be one of {known}")

    def happened(self, what: str) -> NDArray[np.bool_]:
        """Whether each run has this status, or saw this violation at any time, (runs,).

        Raises:
            ValueError: The name is unknown, or "slipping" and no run has a coefficient of friction.
        """
        what = event("what", what, self.scene, self._setup.shapes)
        return read_only(happened(self._take(noted(what)), what))

    def probability(
        self,
        what: str | NDArray[np.bool_] | Callable[[Any], Any] = "completed",
        confidence: float = 0.95,
    ) -> Estimate:
        """How likely something is, with Wilson's interval for independent draws (see `Estimate`).

        Violations are noted over the whole run, whatever `summaries_after` is. With that, whether a
        tip slips or pulls later is in "peak_friction_angle": `study.probability(
        lambda some: some["peak_friction_angle"] > math.atan(mu))`, and pi/2 for pulling.

        Args:
            what: A status ("completed"), a violation ("pulling": seen at any time), whether it
                happened in each run (runs,), or a function that says so of an ensemble: of a study
                on disk it is asked part by part.
            confidence: Of the interval.

        Raises:
            ValueError: The name is unknown, the array has another length, or it is "slipping" and
                no run has a coefficient of friction.
        """
        confidence = checks.share("confidence", confidence)
        if isinstance(what, str):
            what = event("what", what, self.scene, self._setup.shapes)
            found = [happened(part, what) for part in self._in_parts(noted(what))]
        elif callable(what):
            found = [_booleans(what(some), len(some)) for some in self.chunks()]
        else:
            found = [_booleans(what, self.runs)]
        count = sum(int(np.count_nonzero(part)) for part in found)
        return Estimate.counted(count, self.runs, confidence)

    def counts(self) -> dict[str, int]:
        """Status -> how many runs have it, the most frequent first."""
        total: Counter[str] = Counter()
        for part in self._in_parts(("status",)):
            found, counts = np.unique(part["status"], return_counts=True)
            total.update({str(name): int(n) for name, n in zip(found, counts, strict=True)})
        return dict(sorted(total.items(), key=lambda item: (-item[1], item[0])))

    def mean(self, name: str) -> Mean:
        """The mean of a number over the runs in which it is finite, with its standard error.

        Sums are those of `math.fsum`, rounded once. It takes up to 40 bytes of memory a run.

        Args:
            name: A summary or parameter of one number ("peak_rotation"), or one of several
                ("final_state.theta", "disturbances.0.force.1").

        Raises:
            ValueError: It was not computed (the message says how to ask for it, and what there is),
                the name is unknown, or stands for several numbers.
        """
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
        entry, place = place_of(self, name)
        values = self._column(entry)
        return values.reshape(len(values), -1)[:, place].astype(np.float64)

    def _nothing(self) -> Ensemble:
        """The same without a row."""
        from .ensemble import Ensemble

        return Ensemble(self._setup, self._sampling, self._setup.empty(), requested=0)

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
        values = self._values_of(run)
        recorded = (record,) if isinstance(record, str) else record
        return self._setup.replay(run, values, recorded, every)

    def scene_of(self, run: int) -> Scene:
        """The scene of one run, as `simulate` takes it.

        Raises:
            IndexError: There is no such run.
        """
        run = checks.integer("run", run, 0)
        return self._setup.varied.at(self._values_of(run), run)

    @abstractmethod
    def failures(self) -> Sequence[Capsule]:
        """The runs that did not complete, each replayable alone."""

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """Every column by its name, each (runs, ...).

        They are run, status, message, end_time, failure_time, steps, the parameters by their paths,
        the violations as first_pulling, ..., and the summaries by their names.
        """
        return self._take(self._names)

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

        return to_pandas(self)

    def to_xarray(self) -> Any:
        """An xarray Dataset over the runs; needs the extra `study`.

        Every variable has its unit in `attrs`; the dataset's `attrs` have the provenance.
        """
        from .export import to_xarray

        return to_xarray(self)


def names(setup: Setup) -> tuple[str, ...]:
    """The entries of `Results.to_dict`, in order."""
    violations = (f"first_{name}" for name in _core.VIOLATIONS)
    always = ("run", "status", "message", "end_time", "failure_time", "steps")
    return (*always, *setup.shapes, *violations, *setup.summaries)


def failure_time(columns: Mapping[str, NDArray[Any]]) -> Floats:
    """When runs that did not complete ended; NaN for the others."""
    return np.where(columns["status"] == "completed", np.nan, columns["end_time"])


def _booleans(given: Any, runs: int) -> NDArray[np.bool_]:
    found = checks.read("what", given)
    if found.dtype != bool or found.shape != (runs,):
        raise ValueError(
            f"what: must be a status, a violation or booleans ({runs},), not "
            f"{found.dtype} {found.shape}"
        )
    return cast("NDArray[np.bool_]", found)
