"""A study that is begun in a folder, or gone on with: `monte_carlo` with a store."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from . import _core, _manifest, _parts, _record
from ._engine import Piece, compute
from ._folder import MANIFEST, Folder, Writer, locked, refuse_foreign, refuse_remains
from ._interrupt import CtrlC
from ._job import MOST_BLOCKS, Job, Until
from ._rows import Rows
from ._sources import BLOCK, Key
from ._spans import Spans
from .results import StoreError
from .sampling import Plan
from .study import Study

# The blocks that threads compute at a time are doubled and halved to take about so long, s.
_PACE = 0.5


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
    path = _record.path("store", store, "the path of a folder")
    _parts.arrow()
    setup, sampling = job.setup, plan.describe()
    sampling["vary"], arrays = _manifest.arrays_of(vary, sampling["vary"])
    given = _manifest.describe(setup, sampling, job.narrow, job.check_dt, job.kept)
    refuse_foreign(path)
    there = _there(path, given)
    done = Spans.upto(0)
    if there is not None:
        done = Folder(path, setup, _manifest.identity(there)).done
    missing = job.wanted.without(done)
    if any(entry["kind"] == "function" for entry in given["vary"].values()):
        _refuse_state(plan, missing)
    job.check(missing)

    lock = locked(path)
    try:
        # Whoever had the lock may have begun it meanwhile.
        there = _there(path, given)
        if there is None:
            refuse_remains(path)
            _manifest.write_arrays(path, arrays)
            _manifest.write(path, given)
        folder = Folder(path, setup, _manifest.identity(there or given))
        writer = Writer(folder, lock)
        manifest = given
        if there is not None:
            # Before the manifest counts this process among those that can go on with it.
            if folder.parts:
                _trust(job, folder, there, plan)
            manifest = _continued(there, given)
            if manifest != there:
                _manifest.write(path, manifest)
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
        enough = bool(job.narrow) and any(map(until.enough, _noted(folder)))
        alone = bool(job.narrow) or job.executor is not None
        missing = Spans.upto(0) if enough else job.wanted.without(folder.done)
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


def _refuse_state(plan: Plan, missing: Spans) -> None:
    """Refuses functions that give other numbers when they are asked again, as is done here.

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
    """The manifest of a study that is gone on with.

    What rows depend on stays as it is written there: 1 is 1.0, but not in the parts' identity.
    """
    ours = given["made_by"][0]
    known = there["made_by"]
    kept = {name: v for name, v in there["study"].items() if name not in _manifest.FREE}
    free = {name: v for name, v in given["study"].items() if name in _manifest.FREE}
    free["runs"] = max(there["study"]["runs"], given["study"]["runs"])
    paths = {each for data in (there, given) for each in data["study"].get("trajectories", ())}
    if paths:
        free["trajectories"] = sorted(paths)
    return {
        **there,
        "study": {**kept, **free},
        "made_by": known if ours in known else [*known, ours],
    }


def _trust(job: Job, folder: Folder, there: Mapping[str, Any], plan: Plan) -> None:
    """Sees that numbers would be drawn and rows be computed with the bits that are there.

    Raises:
        StoreError: They would not: NumPy, SciPy or the processor is another.
    """
    rows = folder.rows(min(folder.parts, key=lambda part: int(part.edges[0, 0])))
    # There may be more runs than are asked for now.
    some = rows.at((rows.run // BLOCK == rows.run[0] // BLOCK) & (rows.run < plan.runs))
    drawn = plan.rows(some.run) if len(some) else {}
    ours, theirs = _manifest.made_by(), there["made_by"][-1]
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
