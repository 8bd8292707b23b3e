"""The clocks of all benchmarks, and the machine on which a measurement was taken."""

import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from softpinch import _core

Timer: TypeAlias = Callable[[], float]


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


def without_mujoco() -> dict[str, str]:
    """For `missing` of `describe`: MuJoCo and why it does not take part, or nothing."""
    return {} if find_spec("mujoco") else {"MuJoCo": "not installed"}


def median_time(
    work: Callable[[], object], repeats: int, budget: float = 10.0, timer: Timer = time.perf_counter
) -> float:
    """Median time of `work` in seconds, warm, over `repeats`; `budget` s end it early."""
    work()
    times: list[float] = []
    while len(times) < repeats and (len(times) < 3 or sum(times) < budget):
        start = timer()
        work()
        times.append(timer() - start)
    return statistics.median(times)


def evaluation_time(work: Callable[[], object], n: int) -> float:
    """The quickest of eleven rounds of n evaluations, s for each evaluation."""
    (times,) = clock([work], 11, math.inf)
    return float(times.min()) / n


def clock(
    works: Sequence[Callable[[], object]],
    rounds: int,
    budget: float = 1.5,
    timer: Timer = time.perf_counter,
    begins: Sequence[Callable[[], object]] = (),
) -> list[NDArray[np.float64]]:
    """Times of works that take turns, each after a call that warms up; s.

    All take turns, so that the machine's other work falls on each alike.

    Args:
        works: The works.
        rounds: Number of turns.
        budget: A work that has taken so long, s, is not repeated more than three times.
        timer: Wall time, or `time.process_time` where other programs compute.
        begins: Called before each call of the work of this place, and not timed.
    """
    spent: list[list[float]] = [[] for _ in works]
    for _ in range(rounds):
        for k, (work, times) in enumerate(zip(works, spent, strict=True)):
            if len(times) >= 3 and 2 * sum(times) > budget:
                continue
            for _ in range(2):
                if begins:
                    begins[k]()
                start = timer()
                work()
                took = timer() - start
            times.append(took)
    return [np.array(times) for times in spent]


def cores(work: Callable[[], object]) -> float:
    """Processor time by wall time of a warm `work`: how many cores it keeps busy.

    More than one tells that a library started threads; less, that the machine was busy.
    """
    wall, processor_time = time.perf_counter(), time.process_time()
    work()
    return (time.process_time() - processor_time) / (time.perf_counter() - wall)
