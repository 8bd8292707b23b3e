"""Studies kept in a folder: beginning, reading, resuming and extending them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..run.run import Run
from ..study import Capsule, Ensemble, Results, study_file
from ..study.compute import MOST_BLOCKS, Computation, EarlyStopping
from ..study.engine import Engine, compute
from ..study.rows import HOLDS, Numbers, Rows, Spans
from ..study.sampling import Draws
from ..study.sources import BLOCK
from ..study.spec import RECORDING, StudySpec
from ..support import Floats, LostRunsWarning, Report, StoreError, checks, read_only, warn
from ..support.interrupt import CtrlC
from . import manifest as manifests
from .files import MANIFEST, arrow
from .folder import Folder, Trajectories, Writer, locked, refuse_other_content

# A call of the core is to take about this long, s.
PACE_SECONDS = 0.5
T = TypeVar("T")


class Study(Results):
    """A study in a folder. It reads rows on access and keeps none in memory.

    The object shows the folder as it was when it was opened; open the folder again to see rows that
    another process has added. Arrays have a row for each run. For a large study use `probability`,
    `counts` or `chunks`, which read part by part, or `mean` and `quantile`, which read one column.

    It has the attributes of `Results`, of which `interrupted`, `lost` and `discretisation` are of
    the call that returned this object, and these:

    Attributes:
        path: The folder.
        missing: Runs not computed yet, as intervals (k, 2), first and one past the last.
        complete: Whether no run is missing. A study that `stop_when` ended early is not complete,
            although `resume` computes none of its missing runs.
        made_by: Versions, SIMD level and package hash of each kind of writer, in order of writing.
    """

    trajectories: Trajectories

    def __init__(self, folder: Folder, manifest: Mapping[str, Any]) -> None:
        super().__init__(manifests.spec_of(folder.path, manifest))
        self._folder, self._computed = folder, folder.done
        self.path = folder.path
        self.requested: int = manifest["study"]["runs"]
        self.missing = read_only(Spans.upto(self.requested).without(folder.done).edges)
        self.complete = not len(self.missing)
        self.made_by: list[dict[str, Any]] = manifest["made_by"]
        self.trajectories = Trajectories(folder, self.scene_of)
        self.discretisation = None

    @classmethod
    def open(cls, path: str | Path) -> Study:
        """Opens a study's folder, even while another process writes to it.

        Raises:
            StoreError: The folder has no study, or the study is damaged.

        Warns:
            LostRunsWarning: Runs, or files of trajectories, are missing; the message names them.
        """
        study = cls._opened(path)
        missing = []
        # `stop_when` leaves out runs on purpose.
        if not study.complete and not study._spec.stop_when:
            spans = [f"{first} to {end - 1}" for first, end in study.missing[:4].tolist()]
            missing.append(f"runs {_some(spans)} of {study.requested}")
        if deleted := study.trajectories.missing():
            missing.append(f"trajectories of runs {_some(list(map(str, deleted)))}")
        for what in missing:
            advice = "`resume()` computes them, unless another process is doing so"
            warn(f"{study.path}: {what} are missing; {advice}", LostRunsWarning)
        return study

    @classmethod
    def _opened(cls, path: str | Path) -> Study:
        """Opens a study's folder, without a warning of missing runs."""
        arrow()
        path = checks.path("path", path, "the path of a folder")
        manifest = manifests.read(path)
        folder = Folder(path, manifests.spec_of(path, manifest), manifests.identity(manifest))
        return cls(folder, manifest)

    def resume(
        self,
        *,
        threads: int | None = None,
        executor: Engine | None = None,
        progress: bool | Report = True,
    ) -> Study:
        """Computes the missing runs, and returns the study, opened again.

        The rows equal those of a study never stopped. The arguments are those of `monte_carlo`.

        Raises:
            ValueError: `vary` has a function, which no file can hold: call `monte_carlo` again with
                all of its arguments.
            StoreError: The folder cannot be written, a file is damaged, or this machine or software
                gives other bits than the rows in the folder have.

        Warns:
            LostRunsWarning: Runs failed on the executor's workers.
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
        """Raises the number of requested runs to `runs` and computes the missing ones.

        Where the study already requests more than `runs`, it keeps that number, and only missing
        runs below `runs` are computed. Returns the study, opened again.

        Raises:
            ValueError: As `resume`; or the number of runs is fixed, by arrays in `vary` or by a
                Latin hypercube. Other errors and warnings are those of `resume`.
        """
        data = manifests.read(self.path)
        for wrong in manifests.damaged_arrays(self.path, data):
            raise StoreError(wrong)
        drawn = any(entry["kind"] == "function" for entry in data["vary"].values())
        with checks.reworded(kind=None if drawn else StoreError):
            parsed = study_file.parse(data, self.path / MANIFEST)
        spec = study_file.spec_of(*parsed, runs=runs)
        computation = Computation(spec, threads=threads, executor=executor, progress=progress)
        return compute_in_folder(computation, self.path)

    def _read_by_part(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        for part in self._folder.parts:
            yield self._folder.read(part, names)

    def _numbers(self, name: str) -> Floats:
        self._spec.schema.locate(name)  # refuses an unknown name
        # Read this column alone: the other 17 of a state would take most of the time.
        parts = [part[name].astype(np.float64, copy=False) for part in self._read_by_part((name,))]
        return np.concatenate([np.empty(0), *parts])

    def _read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        entries = self._spec.schema.entries
        parts = [{name: entries[name].empty() for name in ("run", *names)}]
        parts += self._read_by_part(("run", *names))
        rows = Rows.joined([Rows(columns=part) for part in parts]).in_order()
        return {name: read_only(rows.columns[name]) for name in names}

    def chunks(self) -> Iterator[Ensemble]:
        """Yields the rows of one part after the other, each as an ensemble."""
        for part in self._folder.parts:
            yield self._ensemble(self._folder.rows(part))

    def ensemble(self) -> Ensemble:
        """Reads all rows into memory, as an ensemble."""
        rows = [self._folder.rows(part) for part in self._folder.parts]
        return self._ensemble(Rows.joined([self._spec.empty(), *rows]).in_order())

    def _ensemble(self, rows: Rows) -> Ensemble:
        return Ensemble(self._spec, rows, requested=len(rows))

    def _rows_of(self, runs: Numbers) -> Rows:
        found = [self._spec.empty()]
        for part in self._folder.parts:
            mine = runs[Spans(part.edges).contains(runs)]
            if len(mine):
                rows = self._folder.rows(part)
                found.append(rows.select(np.searchsorted(rows.run, mine)))
        return Rows.joined(found).in_order()

    def _add_trajectory(self, run: int, path: Run) -> None:
        self.trajectories.add(run, path)

    def failures(self) -> Failures:
        """The runs that did not complete, each replayable alone; read on access."""
        return Failures(self)

    def provenance(self) -> dict[str, Any]:
        """Settings and versions behind these results, as plain data; the last writer counts."""
        maker = self.made_by[-1]
        versions = ("softpinch", "results_version", "numpy", "simd")
        known = {name: maker[name] for name in versions if name in maker}
        return {**super().provenance(), **known}

    def verify(self) -> None:
        """Reads manifest, parts, arrays and trajectories, and compares them with their digests.

        Raises:
            StoreError: A file is missing or damaged; the message has a line for each.
        """
        data = manifests.read(self.path)
        entries = self._spec.schema.entries
        found = [
            *_faults(self._folder.parts, lambda part: self._folder.read(part, tuple(entries))),
            *_faults([*self.trajectories, *self.trajectories.missing()], self.trajectories.read),
            *manifests.damaged_arrays(self.path, data),
        ]
        if manifests.identity(data) != self._folder.identity:
            file = self.path / MANIFEST
            found.append(f"{file}: describes another study than when this was opened")
        if found:
            raise StoreError("\n".join(found))

    def __reduce__(self) -> tuple[Any, ...]:
        # The path is opened again on unpickling.
        kept = ("interrupted", "lost", "_under_way", "discretisation")
        return Study._opened, (self.path.absolute(),), {name: getattr(self, name) for name in kept}

    def __repr__(self) -> str:
        there = f"all {self.runs}" if self.complete else f"{self.runs} of {self.requested}"
        parts = len(self._folder.parts)
        return f"<Study {str(self.path)!r}: {there} runs, in {parts} part{'s' * (parts != 1)}>"


def _faults(files: Iterable[T], read: Callable[[T], object]) -> Iterator[str]:
    """Reads each file, and yields one line for each damaged or missing one."""
    for file in files:
        try:
            read(file)
        except StoreError as error:
            yield str(error)


def _some(names: Sequence[str]) -> str:
    """The first three names, and whether there are others."""
    return ", ".join(names[:3]) + (" and others" if len(names) > 3 else "")


class Failures(Sequence[Capsule]):
    """The runs of a study that did not complete, in the order of their numbers."""

    def __init__(self, study: Study) -> None:
        self._study = study
        parts = study._read_by_part(("run", "status"))
        runs = [part["run"][part["status"] != "completed"] for part in parts]
        self._runs = np.sort(np.concatenate([np.empty(0, np.uint64), *runs]))

    def __len__(self) -> int:
        return len(self._runs)

    @overload
    def __getitem__(self, index: int) -> Capsule: ...

    @overload
    def __getitem__(self, index: slice) -> list[Capsule]: ...

    def __getitem__(self, index: int | slice) -> Capsule | list[Capsule]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"failure {index} of {len(self)}")
        maker = self._study.made_by[-1]
        made_by = {"version": maker["softpinch"], "results_version": maker["results_version"]}
        (capsule,) = self._study._capsules(self._study._rows_of(self._runs[[index]]))
        return replace(capsule, **made_by)

    def __repr__(self) -> str:
        return f"<{len(self)} failures of {self._study!r}>"


def compute_in_folder(computation: Computation, store: str | Path) -> Study:
    """Begins a study in a folder or continues the one found there, and writes the missing runs."""
    spec = computation.spec
    path = checks.path("store", store, "the path of a folder")
    arrow()
    vary, given_arrays = manifests.with_files(spec.draws)
    given = manifests.describe(spec, vary)
    there = _matching_manifest(path, given)
    done = Folder(path, spec, manifests.identity(there)).done if there else Spans.upto(0)
    missing = computation.wanted.without(done)
    if any(entry["kind"] == "function" for entry in given["vary"].values()):
        _refuse_unrepeatable_draws(spec.draws, missing)
    computation.check(missing)

    lock = locked(path)
    try:
        # Another process may have begun the study before this process took the lock.
        there = _matching_manifest(path, given)
        manifests.write_arrays(path, given_arrays)
        folder = Folder(path, spec, manifests.identity(there or given))
        writer = Writer(folder, lock)
        # The manifest may name this process as a writer only after its bits are verified.
        if there and folder.parts:
            _verify_same_bits(spec, folder, there)
        described = _continued(there, given) if there else given
        if described != there:
            manifests.write(path, described)
    except BaseException:
        lock.release()
        raise
    stopping = EarlyStopping(spec.stop_when, computation.wanted)
    # The number of blocks per call is adapted, so that rows reach the disk often enough.
    blocks, since = 1, time.monotonic()

    def accept(rows: Rows) -> bool:
        nonlocal blocks, since
        writer.add(rows)
        spent, since = time.monotonic() - since, time.monotonic()
        if spent < PACE_SECONDS:
            blocks = min(2 * blocks, MOST_BLOCKS)
        elif spent > 2 * PACE_SECONDS:
            blocks = max(1, blocks // 2)
        return stopping.enough(rows)

    try:
        enough = bool(spec.stop_when) and any(map(stopping.enough, _events(folder)))
        alone = bool(spec.stop_when) or computation.executor is not None
        missing = Spans.upto(0) if enough else computation.wanted.without(folder.done)
        computation.compute(missing, accept, lambda: BLOCK * (1 if alone else blocks))
        writer.flush()
        study = Study(folder, described)
        # This writes trajectories into the folder, so the lock is still needed.
        computation.finish(study)
        return study
    finally:
        with CtrlC() as ctrl_c:
            ctrl_c.held = True
            writer.close()


def _refuse_unrepeatable_draws(draws: Draws, missing: Spans) -> None:
    """Refuses functions in `vary` whose draws do not repeat, as resuming and replaying need."""
    for numbers in islice(missing.aligned_chunks(lambda: BLOCK), 1):
        again = draws.rows(numbers)
        for path, values in draws.rows(numbers).items():
            if values.tobytes() != again[path].tobytes():
                rule = "may use only the generator that it is given"
                why = f"A study in a folder draws again to resume, so its function {rule}"
                raise ValueError(f"vary: {path!r}: a second draw gave other numbers. {why}")


def _events(folder: Folder) -> Iterator[Rows]:
    """Yields the columns that determine the events of computed runs (`EVENTS`), part by part."""
    entries = ("run", "status", HOLDS, *(f"first_{name}" for name in _core.VIOLATIONS))
    for part in folder.parts:
        yield Rows(columns=folder.read(part, entries))


def _matching_manifest(path: Path, given: Mapping[str, Any]) -> dict[str, Any] | None:
    """The manifest of a folder that holds the given study; None if the folder is empty."""
    if not (path / MANIFEST).exists():
        refuse_other_content(path)
        return None
    there = manifests.read(path)
    manifests.compare(path, there, given)
    return there


def _continued(there: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The manifest of a continued study; what decides its rows keeps its old, hashed spelling."""
    ours = given["made_by"][0]
    known = there["made_by"]
    kept = {name: v for name, v in there["study"].items() if name not in manifests.FREE}
    free = {name: v for name, v in given["study"].items() if name in manifests.FREE}
    free["runs"] = max(there["study"]["runs"], given["study"]["runs"])
    paths = {each for data in (there, given) for each in data["study"].get("trajectories", ())}
    if paths:
        free["trajectories"] = sorted(paths)
    if "trajectories" not in given["study"]:
        free |= {name: there["study"][name] for name in RECORDING if name in there["study"]}
    makers = known if ours in known else [*known, ours]
    return {**there, "study": {**kept, **free}, "made_by": makers}


def _verify_same_bits(spec: StudySpec, folder: Folder, there: Mapping[str, Any]) -> None:
    """Verifies that this process draws the bits of a stored block, and computes those of a run."""
    rows = folder.rows(min(folder.parts, key=lambda part: int(part.edges[0, 0])))
    # The folder may hold more runs than the caller asks for now.
    some = rows.select((rows.run // BLOCK == rows.run[0] // BLOCK) & (rows.run < spec.draws.runs))
    drawn = spec.draws.rows(some.run) if len(some) else {}
    ours, theirs = manifests.made_by(), there["made_by"][-1]
    changed = [f"{k} {theirs.get(k)} then, {v} now" for k, v in ours.items() if theirs.get(k) != v]
    how = "; ".join(changed) or "the versions are the same: was a function of vary changed?"
    for name, values in drawn.items():
        if values.tobytes() != some.columns[name].tobytes():
            why = f"a new draw differs from the stored one ({how})"
            raise StoreError(f"{folder.path}: {name}: {why}")
    if ours in there["made_by"]:  # an earlier writer had this software and processor
        return
    first = rows.select(np.array([0]))
    again = compute(spec, first, 1, lambda done: False)
    for name, values in again.columns.items():
        # NaN does not equal itself, so values that differ as lists are compared as bytes.
        before = first.columns[name].astype(values.dtype)
        if values.tolist() != before.tolist() and values.tobytes() != before.tobytes():
            why = f"computing it again gives another result than the stored one ({how})"
            raise StoreError(f"{folder.path}: {name} of run {first.run[0]}: {why}")
