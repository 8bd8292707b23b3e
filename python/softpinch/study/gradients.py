"""The derivatives of the summaries of many runs by numbers of their scenes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from .. import _core
from ..run.options import names
from ..scene import directions
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.display import Shown, ShownTable
from ..support.errors import StabilityWarning, warn
from .rows import Rows
from .sources import Shapes
from .spec import StudySpec

GRADIENTS = ("final_state", *_core.GRADIENTS)
_STATE = 18
# The numbers in a reason, and the words around it.
_WHERE = re.compile(r"^sensitivities: (at t = \S+ s )?| before t = \S+ s|, (so|the corr)[^:]*")
# Runs that are computed in one call, between which there is time for Ctrl-C in a slow one.
_BLOCK = 1024


class Gradients(Shown, Mapping[str, Mapping[str, Floats]]):
    """The derivatives of summaries: `gradients[summary][path]`, (runs, ...), a row for each run.

    The last axes are those of the value at the path; "final_state" has 18 columns before them, q
    and p. They are the derivatives of the numbers that the runs computed, as in `Sensitivity`, at
    the instant of each run's own peak or end. A run that ended early has those at its end, but none
    of its margin, and none at all in unilateral contact, where the end is at an event. NaN marks
    them, a summary that is not finite or saw no instant, what comes after an event of a contact
    without a derivative, and a run whose equations were not solved again.
    """

    def __init__(self, summaries: tuple[str, ...], shapes: Shapes, whole: Floats) -> None:
        """Takes the numbers (runs, directions, 18 + summaries); users get them from ensembles."""
        self._summaries = summaries
        self._shapes = shapes
        self._whole = read_only(whole)

    def __getitem__(self, summary: str) -> dict[str, Floats]:
        if summary not in self._summaries:
            known = checks.quoted(self._summaries)
            raise KeyError(f"{summary!r}: there are gradients of {known}")
        others = [name for name in self._summaries if name != "final_state"]
        columns = slice(0, _STATE) if summary == "final_state" else _STATE + others.index(summary)
        return directions.by_path(np.moveaxis(self._whole[:, :, columns], 1, -1), self._shapes)

    def __iter__(self) -> Iterator[str]:
        return iter(self._summaries)

    def __len__(self) -> int:
        return len(self._summaries)

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor, because an unpickled array would be writable.
        return Gradients, (self._summaries, self._shapes, self._whole)

    def _tables(self) -> Iterator[ShownTable]:
        rows = [(summary, *entry) for summary, found in self.items() for entry in found.items()]
        yield ShownTable(("summary", "by", "derivatives"), rows)

    def __repr__(self) -> str:
        names = f"{', '.join(self._summaries)} by {', '.join(self._shapes)}"
        return f"<Gradients of {names}: {len(self._whole)} runs>"


def checked_gradients(
    scene: Scene,
    gradients: str | Sequence[str],
    sensitivities: str | Sequence[str],
    varied: Sequence[str],
    **others: object,
) -> tuple[tuple[str, ...], Shapes]:
    """Checks `gradients` and `sensitivities`, by default the `varied` paths: path -> shape."""
    summaries = names("gradients", gradients, GRADIENTS)
    paths = directions.listed(sensitivities)
    if not summaries:
        if paths:
            raise ValueError("sensitivities: goes with gradients, the summaries to differentiate")
        return (), {}
    for name, value in others.items():
        if value is not None:
            why = "gradients are computed on threads of this process and kept in memory"
            raise ValueError(f"gradients and {name}: give one of them; {why}")
    directions.require_derivatives(scene)
    paths = paths or list(varied)
    if not paths:
        raise ValueError("gradients: give sensitivities, the paths to differentiate by, or vary")
    return summaries, directions.shapes(scene, paths, list(varied))


def differentiated(
    spec: StudySpec, rows: Rows, summaries: tuple[str, ...], by: Shapes, threads: int
) -> Gradients:
    """Computes the gradients of all runs with these rows, which have their varied values."""
    wanted = [name for name in summaries if name != "final_state"]
    spec = replace(spec, summaries=tuple(wanted))
    paths, varied = list(by), list(spec.shapes)
    along = partial(directions.directions, paths=paths, shared=spec.scene, varied=varied)
    # Directions of the inputs depend on each run's own inputs.
    differ = any(path.split(".")[0] in ("schedule", "disturbances", "motion") for path in paths)
    shared = [] if differ else [along(spec.scene)]
    # The columns that jump where a run begins to end early.
    events = spec.scene.contact == "unilateral"
    jumping = np.array([events] * _STATE + [events or name == "margin" for name in wanted])
    parts, failed = [], Counter[str]()
    for first in range(0, len(rows), _BLOCK):
        some = rows.select(np.arange(first, min(first + _BLOCK, len(rows))))
        values = spec.values(some)
        for path in (path for path in by if path.endswith(".law.foot")):
            directions.require_foot(path, values.get(path, 1.0))
        own = shared or [
            along(spec.varied.at({path: values[path][k] for path in varied}, run))
            for k, run in enumerate(some.run.tolist())
        ]
        until = some.columns["end_time"]
        found, lost = _core.gradients(spec.batch(some), own, until, wanted, threads)
        early = (some.columns["status"] != "completed")[:, None, None] & jumping
        parts.append(np.where(early, np.nan, found))
        ended = np.flatnonzero(early.any(axis=(1, 2))).tolist()
        reasons = dict(lost) | dict.fromkeys(ended, "the run ends early")
        failed.update(_WHERE.sub("", why) for why in reasons.values())
    if failed:
        many = f"{failed.total()} of {len(rows)} runs have NaN among their gradients"
        counts = "; ".join(f"{why} ({count})" for why, count in failed.most_common())
        warn(f"{many}: {counts}", StabilityWarning)
    none = np.zeros((0, directions.count(by), _STATE + len(wanted)))
    return Gradients(summaries, by, np.concatenate([none, *parts]))
