"""Studies that are kept in a folder: looked into, gone on with, extended, replayed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from ..run.run import Run
from ..study import columns
from ..study.capsule import Capsule
from ..study.estimates import Discretisation
from ..study.outcome import Outcome
from ..study.request import request
from ..study.results import Ensemble, Results
from ..study.rows import Rows
from ..study.spans import Numbers, Spans
from ..study.study_file import StudyFile
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.errors import StoreError
from ..support.interrupt import handlers_waiting
from ..support.progress import Report
from . import arrays
from . import manifest as manifests
from .files import MANIFEST
from .folder import Folder
from .paths import Trajectories
from .table import arrow

if TYPE_CHECKING:
    from ..study.executor import Engine


class Study(Results):
    """A study in a folder. Rows are read as they are asked for; nothing is kept in memory.

    It shows what there was when it was opened; open it again to see what another process has
    written since. Arrays have a row for each run, so for a large study take `probability`, `counts`
    or `chunks`, which read part by part, or `mean` and `quantile`, which read one column.

    Attributes:
        path: The folder.
        requested: How many runs it is to have.
        missing: Those that it has not, as intervals (k, 2), first and one past the last.
        complete: Whether there are none. Not where `stop_when` found fewer to be enough: then there
            are some, and `resume` computes none of them.
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
        super().__init__(folder.setup, manifests.sampling_of(manifest))
        self._folder = folder
        self.interrupted, self.lost, self._under_way = outcome
        self.path = folder.path
        self.requested: int = manifest["study"]["runs"]
        self.missing = read_only(Spans.upto(self.requested).without(folder.done).edges)
        self.complete = not len(self.missing)
        self.made_by: list[dict[str, Any]] = manifest["made_by"]
        self.trajectories = Trajectories(folder, self.scene_of)
        self.discretisation = None

    @classmethod
    def open(cls, path: str | Path) -> Study:
        """A study's folder, also while another process writes it.

        Raises:
            TypeError: It is no path.
            ValueError: It is empty, or no path can be so.
            StoreError: There is no study, or it is damaged.
            ImportError: pyarrow is not installed.
        """
        arrow()
        path = checks.path("path", path, "the path of a folder")
        manifest = manifests.read(path)
        folder = Folder(path, manifests.setup_of(path, manifest), manifests.identity(manifest))
        return cls(folder, manifest)

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
        data = manifests.read(self.path)
        for wrong in arrays.damaged(self.path, data["vary"]):
            raise StoreError(wrong)
        try:
            file = StudyFile.of(data, self.path / MANIFEST)
        except (TypeError, ValueError) as error:
            if any(entry["kind"] == "function" for entry in data["vary"].values()):
                raise
            raise StoreError(str(error)) from None
        with handlers_waiting():
            from .driver import keep
        asked = request(
            **file.changed(runs=runs).arguments(),
            only=None,
            threads=threads,
            executor=executor,
            progress=progress,
        )
        return keep(asked, self.path, Study)

    @property
    def runs(self) -> int:
        """How many rows there are."""
        return self._folder.done.count

    def _in_parts(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        for part in self._folder.parts:
            yield self._folder.read(part, names)

    def _numbers(self, name: str) -> Floats:
        columns.place(self, name)  # refuses what is no column
        # The one column: of a state's 18 the others would take most of the time.
        parts = [part[name].astype(np.float64, copy=False) for part in self._in_parts((name,))]
        return np.concatenate([np.empty(0), *parts])

    def _take(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        parts = list(self._in_parts(("run", *names)))
        empty = {name: self._empty()[name] for name in ("run", *names)}
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
        run = checks.integer("run", run)
        return 0 <= run < self.requested and bool(self._folder.done.within(run, run + 1).count)

    def _values_of(self, run: int) -> dict[str, Any]:
        if not self.has(run):
            raise IndexError(
                f"run {checks.shown(run)} is not among the {self.runs} runs of {self.path}"
            )
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
        """Reads the manifest, every part, array and kept path, and compares their checksums.

        Raises:
            StoreError: The message names each file that is gone or damaged, one a line.
        """
        data = manifests.read(self.path)
        found = [
            *self._other_study(data),
            *self._folder.damaged(),
            *self.trajectories.damaged(),
            *arrays.damaged(self.path, data["vary"]),
        ]
        if found:
            raise StoreError("\n".join(found))

    def _other_study(self, data: Mapping[str, Any]) -> Iterator[str]:
        if manifests.identity(data) != self._folder.identity:
            yield f"{self.path / MANIFEST}: describes another study than when this was opened"

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
            found = study._folder.read(part, ("run", "status"))
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
