"""`monte_carlo` with a store: begins a study in a folder, or continues the study found there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .. import _core
from ..study.columns import HOLDS
from ..study.engine import RunBlock, compute
from ..study.job import MOST_BLOCKS, EarlyStopping, Job
from ..study.outcome import Outcome
from ..study.results import Results
from ..study.rows import Rows
from ..study.sampling import Plan
from ..study.sources import BLOCK
from ..study.spans import Spans
from ..support import checks
from ..support.disk import reason
from ..support.errors import StoreError
from ..support.interrupt import CtrlC
from . import arrays, manifest
from .files import MANIFEST
from .folder import Folder, Writer, locked, refuse_other_content
from .table import arrow

StudyT = TypeVar("StudyT", bound=Results)

# The number of blocks per call of the core is doubled or halved until one call takes about this
# long, s.
PACE_SECONDS = 0.5


class _Pace:
    """Adapts the number of blocks per call, so that rows reach the disk often enough."""

    def __init__(self) -> None:
        self.blocks = 1
        self._since = time.monotonic()

    def note_arrival(self) -> None:
        """Adapts the number of blocks to the time since rows last arrived."""
        now = time.monotonic()
        spent, self._since = now - self._since, now
        if spent < PACE_SECONDS:
            self.blocks = min(2 * self.blocks, MOST_BLOCKS)
        elif spent > 2 * PACE_SECONDS:
            self.blocks = max(1, self.blocks // 2)


def compute_in_folder(
    job: Job, store: str | Path, opened: Callable[[Folder, dict[str, Any], Outcome], StudyT]
) -> StudyT:
    """Computes the runs that the folder's study lacks, and writes them there.

    Args:
        job: The checked study, and how to compute it.
        store: The study's folder.
        opened: Makes the study object from its folder, its manifest and the outcome of computing.

    Returns:
        The object that `opened` makes.

    Raises:
        ValueError: The folder holds another study, a function in `vary` does not repeat its draws,
            or an input of a run breaks its rule.
        StoreError: The folder cannot be written, is damaged or locked, holds other files, or holds
            rows with other bits than this process computes.
    """
    spec, plan, setup = job.spec, job.spec.plan, job.setup
    path = checks.path("store", store, "the path of a folder")
    arrow()
    vary, given_arrays = arrays.described(spec.vary, plan.describe()["vary"])
    given = manifest.describe(spec, vary)
    there = _matching_manifest(path, given)
    done = Spans.upto(0)
    if there is None:
        refuse_other_content(path)
    else:
        done = Folder(path, setup, manifest.identity(there)).done
    missing = job.wanted.without(done)
    if any(entry["kind"] == "function" for entry in given["vary"].values()):
        _refuse_unrepeatable_draws(plan, missing)
    job.check(missing)

    lock = locked(path)
    try:
        # Another process may have begun the study before this process took the lock.
        there = _matching_manifest(path, given)
        if there is None:
            refuse_other_content(path)
        arrays.write(path, given_arrays)
        if there is None:
            manifest.write(path, given)
        folder = Folder(path, setup, manifest.identity(there or given))
        writer = Writer(folder, lock)
        described = given
        if there is not None:
            # The manifest may name this process as a writer only after its bits are verified.
            if folder.parts:
                _verify_same_bits(job, folder, there, plan)
            described = _continued(there, given)
            if described != there:
                manifest.write(path, described)
    except BaseException:
        lock.release()
        raise
    pace = _Pace()
    stopping = EarlyStopping(spec.stop_when, job.wanted)

    def accept(rows: Rows) -> bool:
        writer.add(rows)
        pace.note_arrival()
        return stopping.enough(rows)

    try:
        enough = bool(spec.stop_when) and any(map(stopping.enough, _events(folder)))
        alone = bool(spec.stop_when) or job.executor is not None
        missing = Spans.upto(0) if enough else job.wanted.without(folder.done)
        outcome = job.compute(missing, accept, lambda: BLOCK * (1 if alone else pace.blocks))
        writer.flush()
        study = opened(folder, described, outcome)
        # This writes trajectories into the folder, so the lock is still needed.
        job.finish(study)
        return study
    finally:
        with CtrlC() as ctrl_c:
            ctrl_c.held = True
            writer.close()


def _refuse_unrepeatable_draws(plan: Plan, missing: Spans) -> None:
    """Refuses functions in `vary` whose draws do not repeat.

    A study draws the numbers of a run again whenever it continues or replays that run.

    Raises:
        ValueError: A second draw of the first missing block differs from the first draw.
    """
    for numbers in islice(missing.aligned_chunks(lambda: BLOCK), 1):
        again = plan.rows(numbers)
        for path, values in plan.rows(numbers).items():
            if values.tobytes() != again[path].tobytes():
                raise ValueError(
                    f"vary: {path!r}: a second draw gave other numbers. A study in a folder draws "
                    "again to resume, so its function may use only the generator that it is given"
                )


def _events(folder: Folder) -> Iterator[Rows]:
    """Yields the columns that determine the events of computed runs (`EVENTS`), part by part."""
    entries = ("run", "status", HOLDS, *(f"first_{name}" for name in _core.VIOLATIONS))
    for part in folder.parts:
        yield Rows(columns=folder.read(part, entries))


def _matching_manifest(path: Path, given: Mapping[str, Any]) -> dict[str, Any] | None:
    """The manifest of a folder that holds the given study; None if there is no manifest.

    Raises:
        ValueError: The folder holds another study.
        StoreError: The manifest is damaged, or the folder cannot be read.
    """
    try:
        if not (path / MANIFEST).exists():
            return None
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {reason(error)}") from None
    there = manifest.read(path)
    manifest.compare(path, there, given)
    return there


def _continued(there: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The manifest of a continued study, from the one in its folder and the given one.

    Settings that decide the rows keep their old spelling: 1 equals 1.0, but the parts' footers have
    a hash of the manifest's text.
    """
    ours = given["made_by"][0]
    known = there["made_by"]
    kept = {name: v for name, v in there["study"].items() if name not in manifest.FREE}
    free = {name: v for name, v in given["study"].items() if name in manifest.FREE}
    free["runs"] = max(there["study"]["runs"], given["study"]["runs"])
    paths = {each for data in (there, given) for each in data["study"].get("trajectories", ())}
    if paths:
        free["trajectories"] = sorted(paths)
    return {
        **there,
        "study": {**kept, **free},
        "made_by": known if ours in known else [*known, ours],
    }


def _verify_same_bits(job: Job, folder: Folder, there: Mapping[str, Any], plan: Plan) -> None:
    """Verifies that this process draws and computes the bits that the folder already holds.

    Draws one stored block again. If the software or the processor differs from every earlier
    writer's, it also computes one stored run again.

    Raises:
        StoreError: The bits differ, because NumPy, SciPy, the processor or a function changed.
    """
    rows = folder.rows(min(folder.parts, key=lambda part: int(part.edges[0, 0])))
    # The folder may hold more runs than the caller asks for now.
    some = rows.select((rows.run // BLOCK == rows.run[0] // BLOCK) & (rows.run < plan.runs))
    drawn = plan.rows(some.run) if len(some) else {}
    ours, theirs = manifest.made_by(), there["made_by"][-1]
    changed = [f"{k} {theirs.get(k)} then, {v} now" for k, v in ours.items() if theirs.get(k) != v]
    how = "; ".join(changed) or "the versions are the same: was a function of vary changed?"
    for name, values in drawn.items():
        if values.tobytes() != some.columns[name].tobytes():
            raise StoreError(
                f"{folder.path}: {name}: a new draw differs from the stored one ({how})"
            )
    if ours in there["made_by"]:
        return
    first = rows.select(np.array([0]))
    block = RunBlock(first.run, {path: first.columns[path] for path in job.setup.shapes})
    again = compute(job.setup, block, 1, lambda done: False)
    for name, values in again.columns.items():
        # NaN does not equal itself, so values that differ as lists are compared as bytes.
        before = first.columns[name].astype(values.dtype)
        if values.tolist() != before.tolist() and values.tobytes() != before.tobytes():
            raise StoreError(
                f"{folder.path}: {name} of run {first.run[0]}: computing it again gives another "
                f"result than the stored one ({how})"
            )
