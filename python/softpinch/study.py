"""Studies that are kept in a folder: looked into, gone on with, extended, replayed."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from . import _core, _manifest, _parts
from ._engine import Piece, compute
from ._folder import MANIFEST, Folder, Part, Writer, locked, refuse_remains
from ._interrupt import CtrlC
from ._job import MOST_BLOCKS, Job, Until
from ._progress import Report
from ._record import read_only
from ._rows import Rows
from ._sources import BLOCK, Key
from ._spans import Numbers, Spans
from ._trajectories import Trajectories
from .capsule import Capsule
from .ensemble import Ensemble
from .estimates import Discretisation
from .results import Outcome, Results, StoreError
from .run import Run
from .sampling import Plan

if TYPE_CHECKING:
    from ._executor import Engine

# The blocks that threads compute at a time are doubled and halved to take about so long, s.
_PACE = 0.5


class Study(Results):
    """A study in a folder. Rows are read as they are asked for; nothing is kept in memory.

    It shows what there was when it was opened; open it again to see what another process has
    written since. Arrays have a row for each run, so for a large study take `probability`, `mean`,
    `quantile`, `counts` or `chunks`, which read part by part.

    Attributes:
        path: The folder.
        requested: How many runs it is to have.
        missing: Those that it has not, as intervals (k, 2), first and one past the last.
        complete: Whether there are none.
        lost: Runs that an executor's workers failed to bring back, in the call that gave this.
        trajectories: Number -> `Run`, the paths that it keeps.
        discretisation: As of an `Ensemble`, where the call that gave this had `check_dt`.
        made_by: What has written it: versions, SIMD level, a hash of the package.
    """

    trajectories: Trajectories

    def __init__(
        self,
        folder: Folder,
        manifest: Mapping[str, Any],
        outcome: Outcome = Outcome(),  # noqa: B008
    ) -> None:
        """Users get studies from `monte_carlo` and `Study.open`."""
        super().__init__(folder.setup, _manifest.sampling_of(manifest))
        self._folder = folder
        self._manifest = manifest
        self.interrupted, self.lost, self._under_way = outcome
        self.path = folder.path
        self.requested: int = manifest["study"]["runs"]
        self.missing = read_only(Spans.upto(self.requested).without(folder.done).edges)
        self.complete = not len(self.missing)
        self.made_by: list[dict[str, Any]] = manifest["made_by"]
        self.trajectories = Trajectories(folder.path, folder.setup, self.scene_of)
        self.discretisation = None

    @classmethod
    def open(cls, path: str | Path) -> Study:
        """A study's folder, also while another process writes it.

        Raises:
            StoreError: There is no study, or it is damaged.
            ImportError: pyarrow is not installed.
        """
        _parts.arrow()
        path = Path(path)
        manifest = _manifest.read(path)
        return cls(Folder(path, _manifest.setup_of(path, manifest)), manifest)

    def resume(
        self,
        *,
        threads: int | None = None,
        executor: Engine | None = None,
        progress: bool | Report = True,
    ) -> Study:
        """Computes what is missing. The rows are those of a study that was never stopped.

        Arguments are those of `monte_carlo`.

        Raises:
            ValueError: Something in `vary` was a function, which no file can hold: call
                `monte_carlo` again, with all of its arguments.
            StoreError: The folder cannot be written, or numbers would be drawn or rows be computed
                with other bits than those that are there.
        """
        return self.extend(self.requested, threads=threads, executor=executor, progress=progress)

    def extend(
        self,
        runs: int,
        *,
        threads: int | None = None,
        executor: Engine | None = None,
        progress: bool | Report = True,
    ) -> Study:
        """Computes what is missing of so many runs; a study that is to have more is to have them.

        Raises:
            ValueError: As `resume`; or the numbers of runs cannot change: those of arrays and of a
                Latin hypercube.
            StoreError: As `resume`.
        """
        from .study_file import StudyFile

        file = StudyFile.read(self.path / MANIFEST).changed(runs=runs)
        study = file.run(threads=threads, executor=executor, progress=progress, store=self.path)
        assert isinstance(study, Study)
        return study

    @property
    def runs(self) -> int:
        """How many rows there are."""
        return self._folder.done.count

    def _in_parts(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        for part in self._folder.parts:
            yield self._read(part, names)

    def _read(self, part: Part, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        return self._folder.read(part, names)

    def _take(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        parts = list(self._in_parts(("run", *names)))
        empty = self._nothing()._take(("run", *names))
        found = {name: np.concatenate([p[name] for p in [empty, *parts]]) for name in empty}
        order = np.argsort(found["run"], kind="stable")
        if (order[1:] < order[:-1]).any():
            found = {name: values[order] for name, values in found.items()}
        return {name: read_only(found[name]) for name in names}

    def chunks(self) -> Iterator[Ensemble]:
        """All rows, as ensembles of those of one part after the other."""
        for part in self._folder.parts:
            yield self._ensemble(self._folder.rows(part))

    def ensemble(self) -> Ensemble:
        """All rows in memory."""
        rows = [self._folder.rows(part) for part in self._folder.parts]
        return self._ensemble(Rows.joined([self._setup.empty(), *rows]).in_order())

    def _ensemble(self, rows: Rows) -> Ensemble:
        return Ensemble(self._setup, self._sampling, rows, requested=len(rows))

    def _some(self, runs: Numbers) -> Rows:
        found = [self._setup.empty()]
        for part in self._folder.parts:
            mine = runs[Spans(part.edges).have(runs)]
            if len(mine):
                rows = self._folder.rows(part)
                found.append(rows.at(np.searchsorted(rows.run, mine)))
        return Rows.joined(found).in_order()

    def _spread_out(self, most: int) -> Numbers:
        edges = self._folder.done.edges
        ends = np.cumsum(edges[:, 1] - edges[:, 0])
        places = np.unique(np.linspace(0, self.runs - 1, min(most, self.runs)).astype(np.int64))
        span = np.searchsorted(ends, places, side="right")
        numbers: Numbers = (edges[span, 1] - (ends[span] - places)).astype(np.uint64)
        return numbers

    def _keep(self, run: int, path: Run) -> None:
        self.trajectories.keep(run, path)

    def has(self, run: int) -> bool:
        """Whether there is a row of this run."""
        return 0 <= run < self.requested and bool(self._folder.done.within(run, run + 1).count)

    def _values_of(self, run: int) -> dict[str, Any]:
        if not self.has(run):
            raise IndexError(f"run {run} is not among the {self.runs} runs of {self.path}")
        rows = self._some(np.array([run], np.uint64))
        return {path: rows.columns[path][0] for path in self._setup.shapes}

    def failures(self) -> Failures:
        """The runs that did not complete, each replayable alone; read as they are asked for."""
        return Failures(self)

    def provenance(self) -> dict[str, Any]:
        """What made these results, as plain data; the versions are those of the last writer."""
        maker = self.made_by[-1]
        versions = ("softpinch", "results_version", "numpy", "simd")
        known = {name: maker[name] for name in versions if name in maker}
        return {**super().provenance(), **known}

    def verify(self) -> None:
        """Reads every part and compares it with its checksum.

        Raises:
            StoreError: The message names each file that is gone, cut short or altered.
        """
        found = self._folder.damaged()
        if found:
            raise StoreError("\n".join(found))

    def __reduce__(self) -> tuple[Any, ...]:
        """As its path, to be opened where it is unpickled, and what only the call knew."""
        outcome = Outcome(self.interrupted, self.lost, self._under_way)
        return _reopened, (self.path.absolute(), outcome, self.discretisation)

    def __repr__(self) -> str:
        """Where it is, and how far."""
        there = f"all {self.runs}" if self.complete else f"{self.runs} of {self.requested}"
        parts = len(self._folder.parts)
        return f"<Study {str(self.path)!r}: {there} runs, in {parts} part{'s' * (parts != 1)}>"


def _reopened(
    path: Path, outcome: Outcome, discretisation: dict[str, Discretisation] | None
) -> Study:
    study = Study.open(path)
    study.interrupted, study.lost, study._under_way = outcome
    study.discretisation = discretisation
    return study


# What a capsule says of whoever computed it, and what the manifest calls it.
_VERSIONS = {"version": "softpinch", "results_version": "results_version"}


class Failures(Sequence[Capsule]):
    """The runs of a study that did not complete, in the order of their numbers."""

    def __init__(self, study: Study) -> None:
        """Finds them."""
        self._study = study
        runs, parts = [np.empty(0, np.uint64)], [np.empty(0, np.int64)]
        for place, part in enumerate(study._folder.parts):
            found = study._read(part, ("run", "status"))
            runs.append(found["run"][found["status"] != "completed"])
            parts.append(np.full(len(runs[-1]), place))
        self._runs, self._parts = np.concatenate(runs), np.concatenate(parts)
        order = np.argsort(self._runs, kind="stable")
        self._runs, self._parts = self._runs[order], self._parts[order]
        self._open: tuple[int, Ensemble] | None = None

    def __len__(self) -> int:
        """How many."""
        return len(self._runs)

    @overload
    def __getitem__(self, index: int) -> Capsule: ...

    @overload
    def __getitem__(self, index: slice) -> list[Capsule]: ...

    def __getitem__(self, index: int | slice) -> Capsule | list[Capsule]:
        """One, or several."""
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"failure {index} of {len(self)}")
        place = int(self._parts[index])
        if self._open is None or self._open[0] != place:
            folder = self._study._folder
            self._open = place, self._study._ensemble(folder.rows(folder.parts[place]))
        ensemble = self._open[1]
        (capsule,) = ensemble._capsules(np.searchsorted(ensemble.run, self._runs[[index]]))
        maker = self._study.made_by[-1]
        versions = {name: maker[key] for name, key in _VERSIONS.items()}
        return replace(capsule, **versions)

    def __repr__(self) -> str:
        """How many of how many."""
        return f"<{len(self)} failures of {self._study!r}>"


class _Pace:
    """How many blocks threads take at a time, so that rows come often enough to be kept."""

    def __init__(self) -> None:
        self.blocks = 1
        self._since = time.monotonic()

    def came(self) -> None:
        """Some blocks are done."""
        now = time.monotonic()
        spent, self._since = now - self._since, now
        if spent < _PACE:
            self.blocks = min(2 * self.blocks, MOST_BLOCKS)
        elif spent > 2 * _PACE:
            self.blocks = max(1, self.blocks // 2)


def keep(job: Job, plan: Plan, vary: Mapping[Key, Any], store: str | Path) -> Study:
    """`monte_carlo` with a store: begins a study in a folder, or goes on with it."""
    if not isinstance(store, str | Path):
        raise TypeError(f"store = {store!r}: must be the path of a folder")
    if not str(store):
        # For Python this is the folder one is in.
        raise ValueError("store is empty: must be the path of a folder")
    path = Path(store)
    _parts.arrow()
    setup, sampling = job.setup, plan.describe()
    sampling["vary"], arrays = _manifest.arrays_of(vary, sampling["vary"])
    given = _manifest.describe(setup, sampling, job.narrow, job.check_dt)
    _manifest.dumps(given)
    there = _there(path, given)
    done = Spans.upto(0) if there is None else Folder(path, setup).done
    job.check(job.wanted.without(done))

    lock = locked(path)
    try:
        # Whoever had the lock may have begun it meanwhile.
        there = _there(path, given)
        if there is None:
            refuse_remains(path)
        manifest = given if there is None else _continued(there, given)
        if manifest != there:
            _manifest.write_arrays(path, arrays)
            _manifest.write(path, manifest)
        folder = Folder(path, setup)
        writer = Writer(folder, lock)
    except BaseException:
        lock.release()
        raise
    pace = _Pace()
    until = Until(job.narrow, job.wanted)

    def accept(rows: Rows) -> bool:
        writer.add(rows)
        pace.came()
        return until.enough(rows)

    try:
        if there is not None and folder.parts:
            _trust(job, folder, there, plan)
        enough = bool(job.narrow) and any(map(until.enough, _noted(folder)))
        alone = bool(job.narrow) or job.executor is not None
        missing = Spans.upto(0) if enough else job.wanted.without(writer.done)
        outcome = job.compute(missing, accept, lambda: BLOCK * (1 if alone else pace.blocks))
        writer.flush()
        study = Study(folder, manifest, outcome)
        # Paths are written too, so the lock stays.
        job.finish(study)
        return study
    finally:
        with CtrlC() as ctrl_c:
            ctrl_c.held = True
            writer.close()


def _noted(folder: Folder) -> Iterator[Rows]:
    """What happened in the runs that there are, part by part."""
    entries = ("run", "status", *(f"first_{name}" for name in _core.VIOLATIONS))
    for part in folder.parts:
        yield Rows(columns=folder.read(part, entries))


def _there(path: Path, given: Mapping[str, Any]) -> dict[str, Any] | None:
    """The manifest of a folder that holds this study; None where it holds none."""
    if not (path / MANIFEST).exists():
        return None
    there = _manifest.read(path)
    _manifest.compare(path, there, given)
    return there


def _continued(there: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The manifest of a study that is gone on with."""
    ours = given["made_by"][0]
    known = there["made_by"]
    runs = max(there["study"]["runs"], given["study"]["runs"])
    return {
        **given,
        "study": {**given["study"], "runs": runs},
        "made_by": known if ours in known else [*known, ours],
    }


def _trust(job: Job, folder: Folder, there: Mapping[str, Any], plan: Plan) -> None:
    """Sees that numbers would be drawn and rows be computed with the bits that are there.

    Raises:
        StoreError: They would not: NumPy, SciPy or the processor is another.
    """
    rows = folder.rows(folder.parts[0])
    rows = rows.at(rows.run // BLOCK == rows.run[0] // BLOCK)
    drawn = plan.rows(rows.run)
    ours, theirs = _manifest.made_by(), there["made_by"][-1]
    changed = [f"{k} {theirs.get(k)} then, {v} now" for k, v in ours.items() if theirs.get(k) != v]
    how = "; ".join(changed) or "the versions are the same: was a function of vary changed?"
    for name, values in drawn.items():
        if values.tobytes() != rows.columns[name].tobytes():
            raise StoreError(f"{folder.path}: {name} is drawn with other bits than before ({how})")
    if ours in there["made_by"]:
        return
    first = rows.at(np.array([0]))
    piece = Piece(first.run, {path: first.columns[path] for path in job.setup.shapes})
    again = compute(job.setup, piece, 1, lambda done: False)
    for name, values in again.columns.items():
        # NaN, which equals nothing, has bytes.
        before = first.columns[name].astype(values.dtype)
        if values.tolist() != before.tolist() and values.tobytes() != before.tobytes():
            raise StoreError(
                f"{folder.path}: {name} of run {first.run[0]} comes out with other bits than "
                f"before ({how})"
            )
