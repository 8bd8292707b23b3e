"""What a measurement was taken on, printed beside it."""

import os
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from softpinch import _core


def processor() -> str:
    """The processor's name and family, as the operating system tells them."""
    facts: dict[str, str] = {}
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            name, _, value = line.partition(":")
            facts.setdefault(name.strip(), value.strip())
    name = facts.get("model name", platform.processor() or platform.machine())
    family = facts.get("cpu family")
    return f"{name} (family {family}, model {facts.get('model')})" if family else name


def describe(threads: str = "1 thread") -> str:
    """Processor, instructions, threads and versions, one a line."""
    return "\n".join(
        [
            f"processor  {processor()}, {os.cpu_count()} cores",
            f"level      {_core.simd_level()}, {threads}",
            f"versions   softpinch {sp.__version__}, Python {platform.python_version()}, "
            f"NumPy {np.__version__}",
        ]
    )


def median_time(work: Callable[[], object], repeats: int, budget: float = 10.0) -> float:
    """Median wall time of `work` in seconds, warm, over `repeats`; `budget` s end it early."""
    work()
    times: list[float] = []
    while len(times) < repeats and (len(times) < 3 or sum(times) < budget):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def clock(
    works: Sequence[Callable[[], object]], rounds: int, budget: float = 1.5
) -> list[NDArray[np.float64]]:
    """Wall times of each, taken in turns, each after a call that warms up; s."""
    spent: list[list[float]] = [[] for _ in works]
    for _ in range(rounds):
        for work, times in zip(works, spent, strict=True):
            if len(times) >= 3 and 2 * sum(times) > budget:
                continue
            work()
            begin = time.perf_counter()
            work()
            times.append(time.perf_counter() - begin)
    return [np.array(times) for times in spent]
