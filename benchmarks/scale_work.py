"""The studies of `scale.py`, the executors that compute them, and the clocks."""

from __future__ import annotations

import multiprocessing
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import softpinch as sp

VARY = {
    "grasped.mass": sp.Normal(0.1, 0.01),
    "hand.tip.youngs_modulus": sp.LogUniform(2e5, 5e5),
    "disturbances.0.force": sp.Uniform((-300, -300), (300, 300)),
}


def push(runs: int, dt: float = 2e-4, **how: Any) -> Any:
    """The README's study: the paper's disturbance (ii), 1.5 s, 7500 steps a run."""
    return sp.monte_carlo(
        sp.paper.disturbance("ii", duration=1.5),
        runs=runs,
        seed=7,
        dt=dt,
        vary=VARY,
        summaries=("peak_rotation", "min_compression", "settling_time"),
        summaries_after=1.0,
        **{"progress": False, **how},
    )


def short(runs: int, duration: float = 0.1, **how: Any) -> Any:
    """Very short runs, by which what surrounds them shows: 1000 steps a run, or fewer."""
    return sp.monte_carlo(
        sp.paper.disturbance("ii", duration=duration),
        runs=runs,
        seed=1,
        dt=1e-4,
        vary={"grasped.mass": VARY["grasped.mass"]},
        summaries=("peak_rotation", "min_compression"),
        **{"progress": False, **how},
    )


@contextmanager
def engines() -> Iterator[dict[str, dict[str, Any]]]:
    """Name -> arguments of `monte_carlo` that say who computes. They live on between studies."""
    from distributed import Client, LocalCluster

    context = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        one, two = (stack.enter_context(ProcessPoolExecutor(n, mp_context=context)) for n in (1, 2))
        cluster = stack.enter_context(
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
        )
        dask = stack.enter_context(Client(cluster)).get_executor()
        yield {
            "one process": {"executor": one, "threads": 1},
            "two processes": {"executor": two, "threads": 1},
            "one thread": {"threads": 1},
            "two threads": {"threads": 2},
            "Dask, two workers": {"executor": dask, "threads": 1},
        }


class Timed(NamedTuple):
    """Wall times of one among several that took turns, s."""

    times: Sequence[float]
    # CPU times of this process, which neighbours on the machine stretch less.
    cpu: Sequence[float]
    # Its own over the first one's, round by round.
    ratios: Sequence[float]

    @property
    def median(self) -> float:
        return statistics.median(self.times)

    @property
    def span(self) -> str:
        return f"({min(self.times):.2f}, {max(self.times):.2f})"

    @property
    def ratio(self) -> float:
        return statistics.median(self.ratios)


def in_turns(works: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Timed]:
    """All of them, one after the other, so many times: what else the machine does falls on all."""
    spent: dict[str, list[float]] = {name: [] for name in works}
    cpu: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            begin, busy = time.perf_counter(), time.process_time()
            work()
            spent[name].append(time.perf_counter() - begin)
            cpu[name].append(time.process_time() - busy)
    first = next(iter(spent.values()))
    return {
        name: Timed(times, cpu[name], [a / b for a, b in zip(times, first, strict=True)])
        for name, times in spent.items()
    }


@contextmanager
def stopwatch(*places: tuple[str, Any, str]) -> Iterator[Counter[str]]:
    """Adds up what functions take, s: (label, what has it, its name). Inner ones count for both."""
    spent: Counter[str] = Counter()

    def timed(label: str, inner: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        begin = time.perf_counter()
        try:
            return inner(*args, **kwargs)
        finally:
            spent[label] += time.perf_counter() - begin

    with ExitStack() as stack:
        for label, owner, name in places:
            inner = getattr(owner, name)
            # A method wants its object, which a partial would not pass on.
            if isinstance(owner, type) and not hasattr(inner, "__self__"):
                wrapped: Any = _method(partial(timed, label, inner))
            else:
                wrapped = partial(timed, label, inner)
            stack.enter_context(mock.patch.object(owner, name, wrapped))
        yield spent


def _method(call: Callable[..., Any]) -> Callable[..., Any]:
    return lambda self, *args, **kwargs: call(self, *args, **kwargs)


def size(folder: Path) -> int:
    """Size of a study's parts, bytes."""
    return sum(file.stat().st_size for file in (folder / "parts").iterdir())


def file_system(path: Path) -> str:
    """The kind of file system that a path is on; empty where the system does not say."""
    mounts = Path("/proc/self/mounts")
    if not mounts.exists():
        return ""
    where = path.resolve()
    found = [line.split()[1:3] for line in mounts.read_text().splitlines()]
    _, kind = max((len(at), kind) for at, kind in found if where.is_relative_to(at))
    return kind
