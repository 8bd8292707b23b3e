"""`monte_carlo` with a store: begins a study in a folder, or continues the one that is there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .. import _core
from ..study.engine import Piece, compute
from ..study.job import MOST_BLOCKS, Job, Until
from ..study.outcome import Outcome
from ..study.request import Request
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

Kept = TypeVar("Kept", bound=Results)

# The number of blocks that threads compute at a time is doubled or halved to take about so long, s.
PACE_SECONDS = 0.5


class _Pace:
    """How many blocks threads take at a time, so that rows come often enough to be kept."""

    def __init__(self) -> None:
        self.blocks = 1
        self._since = time.monotonic()

    def note_arrival(self) -> None:
        """Some blocks are done."""
        now = time.monotonic()
        spent, self._since = now - self._since, now
        if spent < PACE_SECONDS:
            self.blocks = min(2 * self.blocks, MOST_BLOCKS)
        elif spent > 2 * PACE_SECONDS:
            self.blocks = max(1, self.blocks // 2)


def keep(
    asked: Request, store: str | Path, opened: Callable[[Folder, dict[str, Any], Outcome], Kept]
) -> Kept:
    """Computes what the folder's study lacks, and keeps it there.

    Args:
        asked: The work.
        store: The folder.
        opened: Makes a study of a folder, its manifest, and how the computing ended.
    """
    job, plan, vary = asked
    path = checks.path("store", store, "the path of a folder")
    arrow()
    setup, sampling = job.setup, plan.describe()
    sampling["vary"], given_arrays = arrays.described(vary, sampling["vary"])
    given = manifest.describe(setup, sampling, job.narrow, job.check_dt, job.kept)
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
        # A process that had the lock may have begun the study meanwhile.
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
            # Before the manifest names this process among those that can continue the study.
            if folder.parts:
                _verify_same_bits(job, folder, there, plan)
            described = _continued(there, given)
            if described != there:
                manifest.write(path, described)
    except BaseException:
        lock.release()
        raise
    pace = _Pace()
    until = Until(job.narrow, job.wanted)

    def accept(rows: Rows) -> bool:
        writer.add(rows)
        pace.note_arrival()
        return until.enough(rows)

    try:
        enough = bool(job.narrow) and any(map(until.enough, _events(folder)))
        alone = bool(job.narrow) or job.executor is not None
        missing = Spans.upto(0) if enough else job.wanted.without(folder.done)
        outcome = job.compute(missing, accept, lambda: BLOCK * (1 if alone else pace.blocks))
        writer.flush()
        study = opened(folder, described, outcome)
        # Paths are written too, so the lock is released after them.
        job.finish(study)
        return study
    finally:
        with CtrlC() as ctrl_c:
            ctrl_c.held = True
            writer.close()


def _refuse_unrepeatable_draws(plan: Plan, missing: Spans) -> None:
    """Refuses functions that give other numbers when they are called again: a study draws twice.

    Raises:
        ValueError: One does.
    """
    for numbers in islice(missing.pieces(lambda: BLOCK), 1):
        again = plan.rows(numbers)
        for path, values in plan.rows(numbers).items():
            if values.tobytes() != again[path].tobytes():
                raise ValueError(
                    f"vary: {path!r} has other numbers when it is drawn again, as a study in a "
                    "folder is: its function must draw from the generator that it is given alone"
                )


def _events(folder: Folder) -> Iterator[Rows]:
    """The statuses and violations of the runs that there are, part by part."""
    entries = ("run", "status", *(f"first_{name}" for name in _core.VIOLATIONS))
    for part in folder.parts:
        yield Rows(columns=folder.read(part, entries))


def _matching_manifest(path: Path, given: Mapping[str, Any]) -> dict[str, Any] | None:
    """The manifest of a folder that holds the given study; None where it has none.

    Raises:
        ValueError: It holds another study.
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
    """The manifest of a study that is continued.

    What rows depend on stays as it is written there: 1 equals 1.0, but the identity in the footers
    of the parts is of the text.
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
    """Draws some numbers and, with other software than before, computes a run that is there again.

    Raises:
        StoreError: The bits differ: NumPy, SciPy or the processor is another.
    """
    rows = folder.rows(min(folder.parts, key=lambda part: int(part.edges[0, 0])))
    # There may be more runs than are asked for now.
    some = rows.at((rows.run // BLOCK == rows.run[0] // BLOCK) & (rows.run < plan.runs))
    drawn = plan.rows(some.run) if len(some) else {}
    ours, theirs = manifest.made_by(), there["made_by"][-1]
    changed = [f"{k} {theirs.get(k)} then, {v} now" for k, v in ours.items() if theirs.get(k) != v]
    how = "; ".join(changed) or "the versions are the same: was a function of vary changed?"
    for name, values in drawn.items():
        if values.tobytes() != some.columns[name].tobytes():
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
