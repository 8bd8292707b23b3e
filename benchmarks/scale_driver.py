"""Cost of the process that draws and keeps, with workers that take no time."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, NamedTuple

from scale_work import push, stopwatch
from softpinch.scene.template import SceneTemplate
from softpinch.store.folder import Writer
from softpinch.study.rows import Rows
from softpinch.study.sampling import Draws
from softpinch.study.sources import BLOCK
from softpinch.study.spec import StudySpec


class Instant(Executor):
    """Its one worker has done every block before: pickles travel, and nothing is computed."""

    def __init__(self) -> None:
        self._answer: bytes | None = None
        self.computing = self.pickling = 0.0

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        (block,) = (one for one in args if isinstance(one, Rows))
        begin = time.perf_counter()
        if self._answer is None:
            self._answer = pickle.dumps(call(*args))
            self.computing = time.perf_counter() - begin
            begin = time.perf_counter()
        pickle.dumps((call, args))
        rows: Rows = pickle.loads(self._answer)
        self.pickling += time.perf_counter() - begin
        # The rows of another block, under these numbers.
        rows.columns["run"] = block.run
        future: Future[Any] = Future()
        future.set_result(rows)
        return future


class Driver(NamedTuple):
    """Time of the driver for a block of 1024 runs of `push`, s."""

    draw: float
    check: float
    travel: float
    store: float
    rest: float

    @property
    def before(self) -> float:
        """The time before the first run begins, in which everything is drawn and checked."""
        return self.draw / 2 + self.check

    @property
    def total(self) -> float:
        return sum(self)

    @property
    def during(self) -> float:
        return self.total - self.before


def driver(blocks: int, dt: float, folder: Path) -> Driver:
    """With a store, on average over so many blocks; `dt` plays no part, as nothing is computed."""
    push(BLOCK, dt, executor=Instant(), store=folder / "warm")
    instant = Instant()
    with stopwatch(
        ("draw", Draws, "rows"),
        ("check", SceneTemplate, "check"),
        ("check", StudySpec, "batch"),
        ("store", Writer, "flush"),
    ) as spent:
        begin = time.perf_counter()
        push(blocks * BLOCK, dt, executor=instant, store=folder / "driver")
        total = time.perf_counter() - begin - instant.computing
    parts = (spent["draw"], spent["check"], instant.pickling, spent["store"])
    return Driver(*(seconds / blocks for seconds in (*parts, total - sum(parts))))
