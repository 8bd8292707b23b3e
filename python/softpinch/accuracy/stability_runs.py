"""The runs behind a stability map, grouped into batches of the core and computed on threads.

A batch has many scenes with one step, formulation and method. Batches give the same bits as
`simulate` and use SIMD lanes. Their results are read as `study.rows.Rows`, as those of a study.

`study.setup.Setup` does not make these batches: it varies the numbers at some paths of one scene.
The scenes of an axis may differ in everything (schedule, disturbances, gains, start), and each
keeps the seed and run number of its own noise.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .. import _core
from ..scene.compilation import inputs
from ..scene.scene import Scene, State
from ..scene.stabilization import Stabilization
from ..study.rows import Rows
from ..support.arrays import Floats
from ..support.interrupt import CtrlC
from ..support.record import Record


class Case(NamedTuple):
    """One run's scene and the gains of "csm"."""

    scene: Scene
    stabilization: Stabilization


class Ended(NamedTuple):
    """The end of one run: its status, and its final q and p (18,)."""

    status: str
    final: Floats


@dataclass(frozen=True, kw_only=True)
class Job:
    """A batch of runs.

    Attributes:
        batch: The core's batch; its parameters have been checked.
        places: For each run of the batch, the numbers of the cases that it stands for.
        tag: A value with which the caller recognises the job.
    """

    batch: _core.Batch
    places: tuple[tuple[int, ...], ...]
    tag: Any


def jobs(
    cases: Mapping[int, Case],
    pair: tuple[str, str],
    dt: float,
    stop_on: Sequence[str],
    tag: Any,
) -> Iterator[Job]:
    """Groups cases into jobs; equal cases share one run.

    Args:
        cases: Number -> case.
        pair: Formulation and method.
        dt: The longest step, s.
        stop_on: The violations that end a run.
        tag: The tag of the jobs.

    Raises:
        ValueError: A case breaks a rule, such as a start off the constraints.
    """
    groups: dict[Hashable, dict[Case, list[int]]] = {}
    for number, case in cases.items():
        if pair[0] != "csm":
            # Other formulations have no gains, so cases that differ only in gains become equal.
            case = Case(case.scene, Stabilization())
        groups.setdefault(_form(case), {}).setdefault(case, []).append(number)
    for group in groups.values():
        scenes = [case.scene for case in group]
        yield Job(
            batch=_batch(scenes, next(iter(group)).stabilization, pair, dt, stop_on),
            places=tuple(tuple(numbers) for numbers in group.values()),
            tag=tag,
        )


def run(
    todo: Sequence[Job], threads: int, report: Callable[[int], object]
) -> Iterator[tuple[Job, int, Ended]]:
    """Runs all jobs, and yields job, case number and end of each case as jobs complete.

    Args:
        todo: The jobs.
        threads: The number of threads.
        report: Called after each job with the number of cases that are done.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    done = 0
    for job in todo:
        with CtrlC() as ctrl_c:
            ctrl_c.held = True
            result = job.batch.run(min(threads, len(job.places)), lambda _: ctrl_c.pending)
            if ctrl_c.pending:
                raise KeyboardInterrupt
        rows = Rows.of(result, np.arange(len(job.places), dtype=np.uint64), ("final_state",))
        found = rows.columns
        ends = map(Ended, found["status"].tolist(), found["final_state"])
        for place, ended in zip(rows.run.tolist(), ends, strict=True):
            for number in job.places[place]:
                done += 1
                yield job, number, ended
        report(done)


def _form(case: Case) -> Hashable:
    """A key of all that the runs of one batch must share, such as the inputs' structure."""
    scene, start = case.scene, case.scene.start()
    linearized = None if start.linearized is None else start.linearized.tobytes()
    records = (scene.schedule, *scene.disturbances)
    forms = tuple(
        (type(record), *((name, _kind(value)) for name, value in record._values().items()))
        for record in records
    )
    contacts = scene.contact, start.contact is None
    sampled = scene.control if scene.law == "sampled" else None
    controller = None if start.controller is None else start.controller.tobytes()
    law = scene.law, sampled, controller
    return law, contacts, forms, start.check, start.grid, linearized, case.stabilization


def _kind(value: Any) -> Hashable:
    if isinstance(value, float | tuple | np.ndarray):
        return np.shape(value)
    return value  # type: ignore[no-any-return]


def _differing(records: Sequence[Record]) -> dict[str, Floats]:
    """Field name -> values (runs, ...), for the numeric fields in which the records differ."""
    found = {}
    for name in records[0]._values():
        values = [getattr(record, name) for record in records]
        if isinstance(values[0], float | tuple | np.ndarray):
            stacked = np.array(values)
            if (stacked != stacked[:1]).any():
                found[name] = stacked
    return found


def _contacts(starts: Sequence[State]) -> Floats | None:
    """The contacts of the starts (runs, 4), or None if they follow from q and p."""
    rows = [start.contact for start in starts if start.contact is not None]
    return np.array(rows) if rows else None


def _batch(
    scenes: Sequence[Scene],
    stabilization: Stabilization,
    pair: tuple[str, str],
    dt: float,
    stop_on: Sequence[str],
) -> _core.Batch:
    """Converts scenes with one `_form` to a batch of the core."""
    first = scenes[0]
    parameters = np.array([scene.parameters() for scene in scenes])
    slots = np.flatnonzero((parameters != parameters[:1]).any(axis=0)).tolist()
    disturbances = zip(*(scene.disturbances for scene in scenes), strict=True)
    starts: list[State] = [scene.start() for scene in scenes]
    return _core.Batch(
        first.parameters(),
        [(slot, np.ascontiguousarray(parameters[:, slot])) for slot in slots],
        inputs(
            first.schedule,
            first.disturbances,
            first.law,
            first.control,
            moves=_differing([scene.schedule for scene in scenes]),
            loads=[_differing(one) for one in disturbances],
        ),
        runs=len(scenes),
        start="state",
        time=np.array([start.time for start in starts]),
        q=np.array([start.q for start in starts]),
        p=np.array([start.p for start in starts]),
        integral=np.array([start.integral for start in starts]),
        grid=starts[0].grid,
        linearized=starts[0].linearized,
        contacts=_contacts(starts),
        controller=starts[0].controller,
        contact=first.contact,
        check=starts[0].check,
        duration=np.array([scene.duration for scene in scenes]),
        dt=dt,
        tolerance=None,
        max_steps=_core.MAX_STEPS,
        formulation=pair[0],
        method=pair[1],
        alpha=stabilization.alpha,
        beta=stabilization.beta,
        summaries=[],
        after=0.0,
        band=0.1,
        stop_on=list(stop_on),
    )
