"""What a measurement was taken on, printed beside it."""

import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType

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


def describe(
    threads: str = "1 thread",
    libraries: Sequence[str] = (),
    missing: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Processor, instructions, threads, versions and what is left out, one a line.

    Args:
        threads: How many compute.
        libraries: Distributions whose versions matter too, as their line shall spell them.
        missing: Name of what does not take part -> why.
    """
    reasons: dict[str, list[str]] = {}
    for name, reason in missing.items():
        reasons.setdefault(reason, []).append(name)
    return "\n".join(
        [
            f"processor  {processor()}, {os.cpu_count()} cores",
            f"level      {_core.simd_level()}, {threads}",
            f"versions   softpinch {sp.__version__}, Python {platform.python_version()}, "
            f"NumPy {np.__version__}",
            *(f"           {name} {version(name)}" for name in libraries),
            *(f"left out   {', '.join(names)}: {reason}" for reason, names in reasons.items()),
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


def cores(work: Callable[[], object]) -> float:
    """Processor time by wall time of a warm `work`: how many cores it keeps busy.

    More than one tells that a library started threads; less, that the machine was busy.
    """
    wall, processor_time = time.perf_counter(), time.process_time()
    work()
    return (time.process_time() - processor_time) / (time.perf_counter() - wall)
