"""A folder of very many parts with gaps between them, and what it takes to go on with it."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

import softpinch as sp
from scale_work import short, stopwatch
from softpinch.store.folder import Folder, Writer, locked
from softpinch.study.compute import Computation
from softpinch.study.rows import Spans
from softpinch.study.sources import BLOCK

# Rows of a part, and runs missing after each.
ROWS, GAP = 60, 4


def make(path: Path, parts: int) -> None:
    """A study of which every so many runs are missing, written by the package's own writer.

    Only the first part is computed. The others have its rows under their own numbers: whoever looks
    for what is missing reads none of them.
    """
    runs = parts * (ROWS + GAP)
    study = short(runs, only=np.arange(ROWS), store=path)
    rows = study._folder.rows(study._folder.parts[0])
    folder = Folder(path, study._spec, study._folder.identity)
    # The disk is not what is measured here, and would take minutes.
    with mock.patch.object(os, "fsync", lambda fd: None):
        writer = Writer(folder, locked(path))
        for part in range(1, parts):
            numbers = np.arange(ROWS, dtype=np.uint64) + np.uint64(part * (ROWS + GAP))
            writer.add(replace(rows, columns={**rows.columns, "run": numbers}))
            writer.flush()
        writer.close()


class Found(NamedTuple):
    """Wall times, s."""

    parts: int
    rows: int
    missing: int
    # `Study.open`, which says what is missing.
    opened: float
    # From that to the numbers of the first piece of it.
    piece: float
    # `Study.resume` until the first run would begin, and what of it is drawing and checking.
    resumed: float
    checked: float
    # `probability` and `mean`, digests included.
    probability: float
    mean: float


def found(path: Path) -> Found:
    begin = time.perf_counter()
    study = sp.Study.open(path)
    opened = time.perf_counter() - begin
    begin = time.perf_counter()
    next(Spans(study.missing).aligned_chunks(lambda: BLOCK))
    piece = time.perf_counter() - begin
    reads = [reading(study, name) for name in ("probability", "mean")]
    with stopwatch(("check", Computation, "check")) as spent:
        resumed = _until_the_first_run(study)
    missing = int((study.missing[:, 1] - study.missing[:, 0]).sum())
    parts = len(study._folder.parts)
    return Found(parts, study.runs, missing, opened, piece, resumed, spent["check"], *reads)


def reading(study: Any, name: str) -> float:
    """Time to read one number from all parts, s."""
    begin = time.perf_counter()
    getattr(study, name)("peak_rotation" if name == "mean" else "completed")
    return time.perf_counter() - begin


def _until_the_first_run(study: Any) -> float:
    heard: list[float] = []

    def stop(done: int, total: int) -> None:
        heard.append(time.perf_counter())
        raise KeyboardInterrupt

    begin = time.perf_counter()
    study.resume(progress=stop)
    return heard[0] - begin
