"""`monte_carlo` with a store: begins a study in a folder, or continues the study found there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .. import _core
from ..study.compute import MOST_BLOCKS, EarlyStopping, Job
from ..study.engine import Outcome, RunBlock, compute
from ..study.results import Results
from ..study.rows import HOLDS, Rows, Spans
from ..study.sampling import Plan
from ..study.sources import BLOCK
from ..study.spec import RECORDING
from ..support import checks
from ..support.errors import StoreError
from ..support.interrupt import CtrlC
from . import manifest
from .files import MANIFEST, arrow
from .folder import Folder, Writer, locked, refuse_other_content

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

    `opened` makes the study object from its folder, its manifest and the outcome of computing.
    """
    spec, plan = job.spec, job.spec.plan
    path = checks.path("store", store, "the path of a folder")
    arrow()
    vary, given_arrays = manifest.with_files(plan)
    given = manifest.describe(spec, vary)
    there = _matching_manifest(path, given)
    done = Spans.upto(0)
    if there is None:
        refuse_other_content(path)
    else:
        done = Folder(path, spec, manifest.identity(there)).done
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
        manifest.write_arrays(path, given_arrays)
        if there is None:
            manifest.write(path, given)
        folder = Folder(path, spec, manifest.identity(there or given))
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
    """The manifest of a folder that holds the given study; None if there is no manifest."""
    if not (path / MANIFEST).exists():
        return None
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
    if "trajectories" not in given["study"]:
        free |= {name: there["study"][name] for name in RECORDING if name in there["study"]}
    return {
        **there,
        "study": {**kept, **free},
        "made_by": known if ours in known else [*known, ours],
    }


def _verify_same_bits(job: Job, folder: Folder, there: Mapping[str, Any], plan: Plan) -> None:
    """Verifies that this process draws and computes the bits that the folder already holds.

    Draws one stored block again. If the software or the processor differs from every earlier
    writer's, it also computes one stored run again.
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
    block = RunBlock(first.run, {path: first.columns[path] for path in job.spec.shapes})
    again = compute(job.spec, block, 1, lambda done: False)
    for name, values in again.columns.items():
        # NaN does not equal itself, so values that differ as lists are compared as bytes.
        before = first.columns[name].astype(values.dtype)
        if values.tolist() != before.tolist() and values.tobytes() != before.tobytes():
            raise StoreError(
                f"{folder.path}: {name} of run {first.run[0]}: computing it again gives another "
                f"result than the stored one ({how})"
            )
